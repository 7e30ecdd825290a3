"""The demonstrations to keep, and the rule by which each of the others is rejected.

What a person said is obeyed in full: labels, faults that were named, a share, a least probability. Without two answers
what the audit infers rejects no more than a fifth as outliers: the data cannot tell whether outliers are
worse.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Hashable, Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import chain, compress
from typing import Any, cast

import numpy as np

from rpil.data.arrays import Id
from rpil.data.cells import from_cell
from rpil.data.errors import DataError
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.guard import guarded
from rpil.data.id_values import read_labels
from rpil.data.json_files import LARGEST_TABLE, parse, read_text
from rpil.data.text import MAX_IDS, listed
from rpil.formats.parquet_file import read_table
from rpil.numerics.types import Array, Float
from rpil.results.settings import KeepSettings
from rpil.results.vocabulary import SIDES

TABLE_EXTENSIONS = (".csv", ".parquet", ".json")

Table = Mapping[str, Sequence[object]]

KEEP_RULES = {
    "labels": "by your labels",
    "faults": "with a fault that was named",
    "answers": "by inference from your answers",
    "outlier": "as outliers",
    "adversary": "like the adversary that was named",
    "threshold": "below --share or --at-least",
}
"""The rules by which demonstrations are rejected, as text that follows a number."""

RULES_OF_VERDICTS = {"bad": "answers", "outlier": "outlier", "adversary": "adversary"}
"""The rule by which a verdict rejects a demonstration without a label; the other verdicts keep it."""


@dataclass(frozen=True)
class Asked:
    """What a user asks for beside the verdicts of an audit."""

    share: float | None = None
    """Keep this share of the demonstrations, in (0, 1]; those with the largest log-odds."""
    at_least: float | None = None
    """Keep those whose probability is this or more."""
    ignored: Set[str] = frozenset()
    """Rules that reject nobody: labels, or some of `RULES_OF_VERDICTS`."""
    faulty: Set[str] = frozenset()
    """Ids, as text, of the demonstrations with a fault that was named."""
    spared: Set[str] = frozenset()
    """Ids, as text, of those that are kept whatever speaks against them."""


@dataclass(frozen=True)
class Choice:
    """Which demonstrations are kept, in the order of the table."""

    kept: tuple[Id, ...]
    rejected: Mapping[str, tuple[Id, ...]]
    """The others by the rule that rejects them, one of `KEEP_RULES`; no rule without any."""
    undecided: tuple[Id, ...] = ()
    """Those called outliers that are kept, because answers are too few to reject so many."""
    reason: str = ""
    """Why they are kept, one sentence; nothing where there are none."""
    asked: Asked = Asked()

    def lines(self) -> list[str]:
        """How many are rejected by each rule, one sentence, and a line for each rule with their ids; or nothing."""
        counts = ", ".join(f"{len(ids):,} {KEEP_RULES[rule]}" for rule, ids in self.rejected.items())
        lists = [f"  {KEEP_RULES[rule]}: {listed(ids, MAX_IDS)}" for rule, ids in self.rejected.items()]
        return [f"Rejected: {counts}.", *lists] if lists else []

    def to_dict(self) -> dict[str, object]:
        """The ids as lists; whole numbers stay such where all ids are, and the others are text."""
        every = [*self.kept, *chain(*self.rejected.values())]
        named = dict(zip(every, file_ids(every), strict=True))
        rejected = {rule: [named[name] for name in ids] for rule, ids in self.rejected.items()}
        kept, undecided = ([named[name] for name in ids] for ids in (self.kept, self.undecided))
        return {"episodes": kept, "rejected": rejected, "undecided": undecided}


def file_ids(ids: Sequence[Hashable]) -> list[Hashable]:
    """Ids as whole numbers where all are, else as text."""
    return list(ids if all(isinstance(name, int) for name in ids) else map(str, ids))


def choose(table: Table, settings: KeepSettings, asked: Asked = Asked()) -> Choice:
    """Which demonstrations of a table of verdicts are kept.

    Labels and named faults come first, then a share or a least probability, or where there is none the verdicts:
    outlier rejects where no more than `max_outliers` are, a column of the table, or of `settings` where it has none.

    Parameters
    ----------
    table : mapping of column to M values
        As `rpil.results.verdict_table.verdict_columns` and `read_verdicts` give it.

    Raises
    ------
    DataError
        Where the table has no numbers to choose by, or a verdict is none of an audit.
    """
    ids = cast(Sequence[Id], table["id"])
    labels = table.get("label", [""] * len(ids))
    is_by_number = asked.share is not None or asked.at_least is not None
    inferred = _by_threshold(table, asked) if is_by_number else _by_verdicts(table, labels, asked.ignored)
    reason = _too_many(inferred.count("outlier"), table, settings)
    rules = []
    for name, label, rule in zip(ids, labels, inferred, strict=True):
        by_label = label == "bad" and "labels" not in asked.ignored
        by_person = "labels" if by_label else "faults" if str(name) in asked.faulty else rule
        rules.append("" if str(name) in asked.spared else by_person)
    of_rule = {rule: tuple(compress(ids, map(rule.__eq__, rules))) for rule in ("", *KEEP_RULES)}
    undecided = of_rule.pop("outlier") if reason else ()
    kept = tuple(name for name, rule in zip(ids, rules, strict=True) if not rule or (reason and rule == "outlier"))
    rejected = {rule: of_rule[rule] for rule in KEEP_RULES if of_rule.get(rule)}
    return Choice(kept, rejected, undecided, reason if undecided else "", asked)


def rows_of(table: Table, ids: Set[str]) -> Table:
    """The rows of a table of verdicts about the demonstrations `ids`, which are texts."""
    there = [str(name) in ids for name in table["id"]]
    return {column: list(compress(values, there)) for column, values in table.items()}


def read_verdicts(path: StrPath, ids: Iterable[object] = ()) -> Table:
    """The columns of a table of verdicts that an audit wrote, or of labels of the `ids`, which become verdicts, or of
    the demonstrations to keep that an audit or a review wrote, with the rules that reject the others.

    Raises
    ------
    DataError
        Where the file cannot be read as such.
    """
    path = check_readable(check_extension(path, TABLE_EXTENSIONS, "verdicts"))
    columns: dict[str, list[object]]
    with guarded(path.name, f"it cannot be read as {path.suffix[1:].upper()}", "write it again"):
        if path.suffix.lower() == ".parquet":
            columns = read_table(path).to_pydict()
        else:
            text = read_text(path, LARGEST_TABLE, "utf-8-sig")
            is_csv = path.suffix.lower() == ".csv"
            found = csv.DictReader(io.StringIO(text, newline="")) if is_csv else parse(text, path.name, LARGEST_TABLE)
            if isinstance(found, dict) and isinstance(found.get("rejected"), dict):
                return _table_of_kept(found)
            rows = list(found)
            columns = {name: [row[name] for row in rows] for name in rows[0]} if isinstance(rows[0], dict) else {}
            if is_csv and "id" in columns:
                columns["id"] = [from_cell(str(name)) for name in columns["id"]]
    if {"id", "verdict"} <= {*columns}:
        return columns
    labels = read_labels(path, ids)
    return {"id": list(labels), "verdict": list(labels.values()), "label": list(labels.values())}


def _table_of_kept(kept: Mapping[str, Any]) -> Table:
    """A table of what `Choice.to_dict` gave."""
    rules = dict.fromkeys(kept["episodes"], "")
    rules |= {name: rule for rule in KEEP_RULES for name in kept["rejected"].get(rule, ())}
    n = len(rules)
    return {"id": [*rules], "verdict": ["open"] * n, "rejected_by": [*rules.values()], "max_outliers": [1.0] * n}


def _by_threshold(table: Table, asked: Asked) -> list[str]:
    """The rule that rejects each demonstration, or nothing, by the least probability or the share."""
    if asked.at_least is not None:
        is_kept = _numbers(table, "expert_proba") >= asked.at_least
    else:
        ranks = np.argsort(np.argsort(-_numbers(table, "log_odds"), kind="stable"))
        is_kept = ranks < max(round((asked.share or 0.0) * len(ranks)), 1)
    return ["" if kept else "threshold" for kept in is_kept.tolist()]


def _by_verdicts(table: Table, labels: Sequence[object], ignored: Set[str]) -> list[str]:
    """The rule by which its verdict rejects each demonstration, or nothing: a label stands above what is inferred."""
    if "rejected_by" in table:
        return [*map(str, table["rejected_by"])]
    verdicts = [*map(str, table["verdict"])]
    for name, verdict in zip(table["id"], verdicts, strict=True):
        if verdict not in SIDES:
            known = ", ".join(SIDES)
            raise DataError(f"Demonstration {name!r}: the verdict {verdict!r} is unknown; write one of {known}.")
    reject = {verdict: rule for verdict, rule in RULES_OF_VERDICTS.items() if rule not in ignored}
    return [
        "" if label in ("good", "bad") else reject.get(one, "") for one, label in zip(verdicts, labels, strict=True)
    ]


def _too_many(count: int, table: Table, settings: KeepSettings) -> str:
    """Why `count` outliers of a table are not rejected; nothing where they are."""
    n = len(table["id"])
    most = float(_numbers(table, "max_outliers").min()) if n and "max_outliers" in table else settings.max_outliers
    if count <= most * n:
        return ""
    outliers = f"{count:,} of {n:,} demonstrations are outliers, more than {most:.0%} of all"
    return f"{outliers}: they are kept, because without two answers nobody knows whether they are worse."


def _numbers(table: Table, column: str) -> Float[Array, " M"]:
    try:
        return np.array(cast(Sequence[float], table[column]), dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise DataError(f"The verdicts have no numbers in {column}; give those that rpil audit wrote.") from error
