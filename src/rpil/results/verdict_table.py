"""The verdicts of an audit as files: a table with one row for each demonstration, and the demonstrations to keep."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from rpil.data.files import StrPath, check_extension, replacing
from rpil.data.run import RUN_KEY
from rpil.faults.rule import Fault
from rpil.formats import write_columns
from rpil.results.choice import Asked, Choice, choose, file_ids
from rpil.results.provenance import PROVENANCE_KEY
from rpil.results.result import AuditResult


def verdict_columns(
    audit: AuditResult,
    demonstrators: Mapping[str, str],
    findings: Sequence[Fault] = (),
    tasks: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, Sequence[object]]:
    """The columns of the table, in the order of the data: a row for each demonstration.

    They are those of `Audit.table`, the parts of log_odds (from_actions, from_demonstrator, from_label), reliability,
    demonstrator, task, `Audit.facts` as fact_length and so on where they are known, faults (the rules of `findings`,
    the worst first), reason, and the run id. `demonstrators` and `tasks` are by ids as text; a demonstration that is
    not in them has an empty text.
    """
    names, faults = [*map(str, audit.ids)], defaultdict[str, list[str]](list)
    for found in findings:
        faults[str(found.id)].append(found.rule)
    return {
        **audit.table(),
        "id": file_ids(audit.ids),
        **{f"from_{part}": values.tolist() for part, values in audit.evidence.items()},
        "reliability": audit.reliability.tolist(),
        "demonstrator": [demonstrators.get(name, "") for name in names],
        "task": [tasks.get(name, "") for name in names],
        **{f"fact_{name.replace(' ', '_')}": values for name, values in audit.facts.items()},
        "faults": [", ".join(faults[name]) for name in names],
        "reason": list(audit.reasons),
        "run": [audit.run_id] * len(names),
    }


def write_verdicts(path: StrPath, audit: AuditResult, columns: Mapping[str, Sequence[object]]) -> None:
    """Write the `verdict_columns` of an audit to a .csv, .parquet or .json file.

    JSON holds a list of objects. Parquet has the run id and the provenance among its metadata too.

    Raises
    ------
    DataError
        Where the path has another extension, or cannot be written.
    """
    said = {RUN_KEY: audit.run_id}
    if audit.provenance is not None:
        said[PROVENANCE_KEY] = json.dumps(audit.provenance.to_dict())
    write_columns(path, columns, "verdicts", said)


def choice_of(audit: AuditResult, asked: Asked = Asked()) -> Choice:
    """Which demonstrations of an audit are kept."""
    return choose(audit.table(), asked)


def write_kept(path: StrPath, audit: AuditResult, choice: Choice) -> None:
    """Write ``{"episodes": [...], "rejected": {...}, "run": ..., "provenance": ...}``: the ids that are kept, and those
    that are rejected by rule.

    Ids are in the order of the data. Whole numbers are written as such: then the list is what LeRobot takes as the
    episodes of a data set.

    Raises
    ------
    DataError
        Where the path has another extension, or cannot be written.
    """
    made = {} if audit.provenance is None else {"provenance": audit.provenance.to_dict()}
    content = choice.to_dict() | {"run": audit.run_id} | made
    with replacing(check_extension(path, (".json",), "demonstrations to keep")) as temporary:
        temporary.write_text(json.dumps(content, allow_nan=False, indent=1) + "\n", encoding="utf-8")
