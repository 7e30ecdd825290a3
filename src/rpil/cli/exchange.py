"""Findings of ``rpil check`` and ``rpil audit`` for others: SARIF for code scanning, Markdown for pull requests."""

from __future__ import annotations

import hashlib
import os
import re
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple
from urllib.parse import quote

import numpy as np

from rpil.cli.terminal import to_json, to_one_line
from rpil.data.text import counted, printable
from rpil.faults.report import NUMBERS, OF_AUDIT, RULE_NAMES, RULES
from rpil.inference.findings import FINDINGS

if TYPE_CHECKING:
    from rpil.faults.rule import Fault
    from rpil.formats.recording import Recording
    from rpil.results.record import Audit

MAX_TABLE_ROWS = 100
"""Findings in a table of Markdown: a comment on GitHub may have 65,536 characters."""

SARIF_LEVELS = {"broken": "error", "suspect": "warning", "odd": "note"}
"""Levels of SARIF, by the grade of a rule."""

RULES_PAGE = "https://github.com/rpil/rpil/blob/main/docs/faults.md"


class Numbered(NamedTuple):
    """A finding: the number of its rule, the demonstration or the part of a folder, what is seen, and in which line, or
    row, of which file of a folder."""

    number: str
    place: str
    sentence: str
    line: int = 1
    file: str = ""


def of_faults(faults: Iterable[Fault], recording: Recording | None = None) -> list[Numbered]:
    """Findings in recordings, their folder and videos; with the line or row of the recording at which they begin."""
    named = [(one, printable(one.id) or ("the set" if one.ids else "the folder")) for one in faults]
    where = [_line(recording, one.ids[0] if one.ids else one.id, one.first) for one, _ in named]
    return [Numbered(NUMBERS[f.rule], name, f.sentence, *at) for (f, name), at in zip(named, where, strict=True)]


def _line(recording: Recording | None, name: Hashable, first: int = 0) -> tuple[int, str]:
    """The line of a text file where a step of a demonstration is, or the row of another; and the file of a folder."""
    from rpil.formats.csv import TEXT_SUFFIXES

    if recording is None or name not in (ids := [*recording.steps.ids]):  # of the rows that were read
        return 1, ""
    row, sizes = recording.steps.offsets[ids.index(name)] + first, recording.steps.sizes
    number, ends = int(recording.steps.numbers(np.array([row]))[0]), np.cumsum([0, *sizes.values()])
    k = int(np.searchsorted(ends, number, side="right")) - 1 if sizes else 0
    return number - int(ends[k]) + 1 + recording.description.source.lower().endswith(TEXT_SUFFIXES), [*sizes, ""][k]


def of_audit(audit: Audit, recording: Recording) -> list[Numbered]:
    """Each demonstration with a low verdict, the lowest first, and what the audit as a whole leaves open."""
    lowest = ((m, audit.ids[m], audit.verdicts[m]) for m in audit.ranking()[::-1].tolist())
    low = [(m, name, NUMBERS[verdict]) for m, name, verdict in lowest if verdict in OF_AUDIT]
    found = [Numbered(rule, printable(name), audit.reasons[m], *_line(recording, name)) for m, name, rule in low]
    if audit.finding in OF_AUDIT:
        found.append(Numbered(NUMBERS[audit.finding], "all", " ".join([FINDINGS[audit.finding], *audit.doubts])))
    return found


def written(form: str, found: Sequence[Numbered], source: str, title: str, sentence: str) -> str:
    """The findings in the data at `source` as "sarif" or "markdown", there below a title and a sentence."""
    return to_json(sarif(found, source)) if form == "sarif" else markdown(f"{title}: {source}", sentence, found)


def sarif(found: Sequence[Numbered], source: str) -> dict[str, object]:
    """The findings in the data at `source` as SARIF 2.1.0.

    Fingerprints tell results apart there: of the rule, the demonstration, and how many came before of both.
    """
    rules, results, seen = dict[str, Mapping[str, object]](), [], Counter[tuple[str, str]]()
    for number, place, sentence, line, file in sorted(found, key=lambda one: one.number):
        name, rule = RULE_NAMES[number], RULES.get(RULE_NAMES[number])
        words = {"text": rule.words if rule else OF_AUDIT[name]}
        about = {"id": number, "name": name.title().replace(" ", ""), "shortDescription": words}
        rules.setdefault(number, about | {"helpUri": f"{RULES_PAGE}#the-rules"})
        mark = repr((number, place, seen[number, place]))
        seen[number, place] += 1
        at = {"artifactLocation": {"uri": _address(source, file)}, "region": {"startLine": line}}
        result = {
            "ruleId": number,
            "ruleIndex": len(rules) - 1,
            "level": SARIF_LEVELS[rule.grade] if rule else "note",
            "message": {"text": f"{place}: {to_one_line(sentence)}"},
            "locations": [{"physicalLocation": at, "logicalLocations": [{"name": place}]}],
            "partialFingerprints": {"primaryLocationLineHash": hashlib.sha256(mark.encode()).hexdigest()},
        }
        results.append(result)
    driver = {"name": "rpil", "version": version("rpil"), "informationUri": RULES_PAGE, "rules": [*rules.values()]}
    schema = "https://json.schemastore.org/sarif-2.1.0.json"
    return {"$schema": schema, "version": "2.1.0", "runs": [{"tool": {"driver": driver}, "results": results}]}


def _address(source: str, file: str) -> str:
    """A URI of the data, or a file in their folder: relative to the working directory, as scanning asks, if in it."""
    path = Path(os.path.abspath(source))
    places = path.rglob(file) if file and path.is_dir() else ()
    path = next((one for one in places if "meta" not in one.relative_to(path).parts), path)
    return quote(path.relative_to(Path.cwd()).as_posix()) if path.is_relative_to(Path.cwd()) else path.as_uri()


def markdown(title: str, headline: str, found: Sequence[Numbered]) -> str:
    """The findings as a table of Markdown below a title and a sentence."""
    lines, counts = [f"### {_plain(title)}", "", _plain(headline)], Counter(number for number, *_ in found)
    if found:
        by_rule = ", ".join(f"{counts[number]:,} {RULE_NAMES[number]} ({number})" for number in sorted(counts))
        lines += ["", f"{counted(len(found), 'finding')}: {by_rule}.", ""]
        lines += ["| rule | demonstration | what is seen |", "|---|---|---|"]
        lines += ["| " + " | ".join(map(_plain, one[:3])) + " |" for one in found[:MAX_TABLE_ROWS]]
    more = len(found) - MAX_TABLE_ROWS
    return "\n".join([*lines, *["", f"... and {more:,} more."] * (more > 0)])


def _plain(text: str) -> str:
    """Text of a file that Markdown shows as it is: no marks, no links, no names of users who would be notified."""
    marked = re.sub(r"([\\`*_{}\[\]<>#!|~&])", r"\\\1", to_one_line(text))
    return re.sub(r"@|:(?=//)|www(?=\.)", "\\g<0>\u200b", marked, flags=re.IGNORECASE)
