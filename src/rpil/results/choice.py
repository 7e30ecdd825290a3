"""The demonstrations to keep, the rule by which each of the others is rejected, and what is lost with these.

What a person said is obeyed: labels, faults that were named, a share, and outcomes of 0 where they are 0 and 1, unless
other answers outweigh them. What the audit infers rejects only once two answers contrast.

Where a demonstration is left out, the policy never sees its states. That is no loss where kept demonstrations visit the
same places, and one where it alone starts behind the object.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter, defaultdict
from collections.abc import Collection, Hashable, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import chain, compress
from typing import Any, cast

import numpy as np

from rpil.data.arrays import Id
from rpil.data.copies import RUN_KEY
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, check_readable, replacing
from rpil.data.id_values import check_ids, parse_answers, read_answer_rows
from rpil.data.memory import LARGEST_TABLE, TooLargeError, read_text
from rpil.data.text import MAX_IDS, MAX_LISTED_NAMES, from_cell, listed, printable
from rpil.formats import write_columns
from rpil.formats.format import Dataset
from rpil.numerics.regression import ROUNDING, robust_scale
from rpil.numerics.types import Array, Bool, Float, Num
from rpil.results.judged import PROVENANCE_KEY
from rpil.results.result import AuditResult
from rpil.results.vocabulary import WORSE

Table = Mapping[str, Sequence[object]]

KEEP_RULES = {
    "labels": "by your labels",
    "outcome": "by {0}",
    "faults": "with a fault that was named",
    "answers": "by inference from {1}",
    "adversary": "like the adversary that was named",
    "threshold": "below --share",
}
"""The rules by which demonstrations are rejected, as text that follows a number; {0} is `failure`, {1} `told`."""


@dataclass(frozen=True)
class Choice:
    """Which demonstrations are kept, in the order of the table."""

    kept: tuple[Id, ...]
    rejected: Mapping[str, tuple[Id, ...]]
    """The others by the rule that rejects them, one of `KEEP_RULES`; no rule without any."""
    failure: str = "outcome = 0"
    """How those failed that an outcome rejects: its column, and the value there."""
    notes: tuple[str, ...] = ()
    """A sentence on each demonstration that is kept although it was called worse than another one."""
    told: str = "your answers"
    """From where it is inferred who is bad."""

    def words(self, rule: str) -> str:
        """The rule as text that follows a number."""
        return KEEP_RULES[rule].format(self.failure, self.told)

    def lines(self) -> list[str]:
        """How many are rejected by each rule, one sentence, and a line for each rule with their ids; then the notes."""
        counts = ", ".join(f"{len(ids):,} {self.words(rule)}" for rule, ids in self.rejected.items())
        lists = [f"  {self.words(rule)}: {listed(ids, MAX_IDS)}" for rule, ids in self.rejected.items()]
        return [*([f"Rejected: {counts}."] * bool(lists)), *lists, *self.notes]

    def to_dict(self) -> dict[str, object]:
        """The ids as lists; whole numbers stay such where all ids are, and the others are text."""
        every = [*self.kept, *chain(*self.rejected.values())]
        named = dict(zip(every, file_ids(every), strict=True))
        rejected = {rule: [named[name] for name in ids] for rule, ids in self.rejected.items()}
        return {"episodes": [named[name] for name in self.kept], "rejected": rejected}


def file_ids(ids: Sequence[Hashable]) -> list[Hashable]:
    """Ids as whole numbers where all are, else as text."""
    return list(ids if all(isinstance(name, int) for name in ids) else map(str, ids))


def choose(
    table: Table, share: float | None = None, faulty: Set[str] = frozenset(), spared: Set[str] = frozenset()
) -> Choice:
    """Which demonstrations of a table of verdicts are kept.

    Those that are `spared`, ids as text, are, whatever speaks against them. Of the others labels, outcomes of 0 and the
    `faulty` ones come first, then a share in (0, 1] of those with the largest log-odds, or where there is none the
    rules in the column rejected_by. A `DataError` where the table, which `AuditResult.table` or `read_verdicts` gave,
    has no numbers to choose by, or an unknown rule.
    """
    ids = cast(Sequence[Id], table["id"])
    labels, said = (table.get(name, [""] * len(ids)) for name in ("label", "said"))
    kept, rejected = list[Id](), {rule: list[Id]() for rule in KEEP_RULES}
    failure, notes, rules = Choice.failure, list[str](), [str(rule or "") for rule in table["rejected_by"]]
    every = zip(ids, labels, map(str, said), rules, _below(table, share), strict=True)
    for name, label, how, by_audit, below in every:
        if by_audit and by_audit not in KEEP_RULES:
            rest = f"{by_audit!r} is unknown; write one of {', '.join(KEEP_RULES)}"
            raise DataError(f"Demonstration {name!r}: the rejected by {rest}.")
        is_spared, rule = str(name) in spared, "" if label else by_audit
        if label == "bad":
            rule = "labels"
        elif by_audit == "outcome" and label != "good":
            rule = by_audit
        elif str(name) in faulty:
            rule = "faults"
        elif below is not None:
            rule = "threshold" * below
        rule = "" if is_spared else rule
        (rejected[rule] if rule else kept).append(name)
        if rule == "outcome":
            failure = how or failure
        elif how.startswith(WORSE) and not (rule or label or is_spared) and below is None:
            notes.append(f"{printable(name)} is kept though you called it {printable(how)}: one answer more decides.")
    by_outcomes = "label" in table and not any(labels) and not any(str(how).startswith(WORSE) for how in said)
    of_rule = {rule: tuple(own) for rule, own in rejected.items() if own}
    return Choice(tuple(kept), of_rule, failure, tuple(notes), "the outcomes" if by_outcomes else Choice.told)


def read_verdicts(path: StrPath) -> Table:
    """The columns of a table of verdicts that an audit wrote to CSV, or of labels, or of the demonstrations to keep
    that an audit or a review wrote, with the rules that reject the others. A `DataError` where the file is none."""
    path = check_readable(check_extension(path, (".csv", ".json"), "verdicts"))
    with guarded(path.name, f"it cannot be read as {path.suffix[1:].upper()}", "write it again"):
        text = read_text(path, LARGEST_TABLE)
        if path.suffix.lower() == ".json":
            kept: Any = json.loads(text)
            if not isinstance(kept, dict) or not {"episodes", "rejected"} <= kept.keys():
                remedy = "give that, the CSV of --verdicts, or labels"
                raise DataError(f"{path.name}: it is not the list of rpil audit --keep; {remedy}.")
            rules = dict.fromkeys(kept["episodes"], "")
            rules |= {name: rule for rule in KEEP_RULES for name in kept["rejected"].get(rule, ())}
            return {"id": [*rules], "rejected_by": [*rules.values()]}
        rows = [*csv.DictReader(io.StringIO(text))]
        columns = {name: [row[name] for row in rows] for name in (rows[0] if rows else ())}
    if "verdict" in columns and "rejected_by" not in columns:
        raise DataError(f"{path.name}: it has no column rejected_by; write it again with rpil audit --verdicts.")
    if not {"id", "rejected_by"} <= {*columns}:
        labels, _ = parse_answers(read_answer_rows(path), path.name)
        if not labels:
            raise DataError(f"{path.name}: it labels no demonstration; give at least one id and label.")
        return {"id": list(labels), "rejected_by": [""] * len(labels), "label": list(labels.values())}
    return columns | {"id": [from_cell(str(name)) for name in columns["id"]]}


def verdicts_about(path: StrPath, ids: Sequence[Hashable], every: Sequence[Hashable]) -> tuple[Table, set[str]]:
    """The rows of `read_verdicts` about the demonstrations `ids`, and those that it names, as text; None in the rows of
    the others. A `DataError` where the file names one that is none of `every` one, or one twice."""
    table = read_verdicts(path)
    check_ids(table["id"], every, str(path), "the ids")
    row = {str(name): k for k, name in enumerate(table["id"])}
    if len(row) < len(table["id"]):
        [(twice, _)] = Counter(map(str, table["id"])).most_common(1)
        raise DataError(f"{path}: {twice!r} has two rows; leave one of them.")
    places = [row.get(str(name)) for name in ids]
    columns = {name: [None if k is None else values[k] for k in places] for name, values in table.items()}
    return {**columns, "id": ids}, {*row}


def _below(table: Table, share: float | None) -> Sequence[bool | None]:
    """Whether each demonstration is below the share that is asked for; None where none is."""
    if share is None:
        return [None] * len(table["id"])
    try:
        values = np.array(cast(Sequence[float], table["log_odds"]), dtype=float)
    except (KeyError, ValueError, TypeError) as error:
        raise DataError("The verdicts have no numbers in log_odds; give those that rpil audit wrote.") from error
    if without := [*compress(cast(Sequence[Id], table["id"]), np.isnan(values))]:
        who = f"The verdicts have no number in log_odds for {listed(without, MAX_LISTED_NAMES)}"
        raise DataError(f"{who}; audit these too, or leave them out with --without.")
    ranks = np.argsort(np.argsort(-values, kind="stable"))
    return [*map(bool, ranks >= max(round(share * len(ranks)), 1))]


def write_verdicts(path: StrPath, audit: AuditResult, columns: Table) -> None:
    """Write the `AuditResult.table` of an audit to a .csv, .parquet or .json file.

    JSON holds a list of objects. Parquet has the run id and the provenance among its metadata too. A `DataError` where
    the path has another extension, or cannot be written.
    """
    made = {PROVENANCE_KEY: json.dumps(audit.provenance)} if audit.provenance else {}
    write_columns(path, {**columns, "id": file_ids(audit.ids)}, "verdicts", {RUN_KEY: audit.run_id, **made})


def write_kept(path: StrPath, audit: AuditResult, choice: Choice) -> None:
    """Write ``{"episodes": [...], "rejected": {...}, "run": ..., "provenance": ...}``: the ids that are kept, and those
    that are rejected by rule.

    Ids are in the order of the data. Whole numbers are written as such: then the list is what LeRobot takes as the
    episodes of a data set. A `DataError` where the path has another extension, or cannot be written.
    """
    content = choice.to_dict() | {"run": audit.run_id} | ({"provenance": audit.provenance} if audit.provenance else {})
    with replacing(check_extension(path, (".json",), "demonstrations to keep")) as temporary:
        temporary.write_text(json.dumps(content, allow_nan=False, indent=1) + "\n", encoding="utf-8")


MAX_STATES = 5000
"""States of the kept demonstrations that are compared, and of the others."""

SAME_PLACE, TIMES_FARTHER = 0.1, 2.0
"""Spreads up to which two states are the same place; than the farthest of the kept ones, as tails may be heavy."""

FALSE_ALARMS = 0.01
"""Probability of any sentence where all demonstrations are alike."""

MIN_KEPT = 3
"""Demonstrations whose distances from one another say what is usual, at least."""


def lost_places(demonstrations: Demonstrations | Dataset, kept: Collection[object]) -> tuple[str, ...]:
    """A sentence for each place that only demonstrations visit whose ids are not `kept`, most often none, such as "No
    kept demonstration starts with obs.3 above 0.41; 12 does." Of data that do not fit in memory, or whose observations
    are not finite, nothing is said.

    For each demonstration that is left out the distance of its start to the nearest start of a kept one is compared
    with what is usual among the kept ones, each left out in turn; and so is the median distance of its states.
    """
    names = {*map(str, kept)}
    is_kept = np.array([str(name) in names for name in demonstrations.ids])
    if is_kept.sum() < MIN_KEPT or is_kept.all():
        return ()
    if isinstance(demonstrations, Dataset):
        try:
            demonstrations = demonstrations.select(slice(None))
        except TooLargeError:
            return ()
    if not demonstrations.observations.size or not np.isfinite(demonstrations.observations).all():
        return ()
    episodes, chosen = [own for own, _ in demonstrations], [_thin(np.flatnonzero(is_kept == one)) for one in (1, 0)]
    some = [_thin(episodes[m], MAX_STATES // len(own)) for own in chosen for m in own.tolist()]
    members, of_kept = np.concatenate(chosen), np.repeat([True, False], [*map(len, chosen)])
    scale = robust_scale(np.concatenate(some), np.cumsum([0, *map(len, some)]))[1]
    starts, known, sentences = [own[:1] for own in episodes], np.zeros(len(members), dtype=bool), list[str]()
    for verb, near, visited, states in (
        ("starts with", "starts near the start", starts, [starts[m] for m in members.tolist()]),
        ("reaches", "comes near half of the states", episodes, some),
    ):
        far = _far([own / scale for own in states], of_kept) & ~known
        known |= far
        ends = np.array([(own.min(axis=0), own.max(axis=0)) for own in visited], dtype=float) * [[1], [-1]]
        reached, beyond = ends[is_kept].min(axis=0), defaultdict[int, dict[Id, float]](dict)
        for m in members[far].tolist():
            gaps = reached - ends[m]
            place = int((gaps / scale).argmax())
            beyond[place if gaps.flat[place] > 0 else -1][demonstrations.ids[m]] = gaps.flat[place]
        for place, gap in beyond.items():
            where = "" if place < 0 else _bound(place, reached, min(gap.values()), demonstrations.observation_names)
            ids = [*gap]
            does = f"{verb} {where}; {listed(ids)} do{'es' * (len(ids) == 1)}" if where else f"{near} of {listed(ids)}"
            sentences.append(f"No kept demonstration {does}.")
    return tuple(sentences)


def _thin(values: Num[Array, "R ..."], most: int = MAX_STATES) -> Num[Array, "S ..."]:
    """At most so many of the values, evenly spaced."""
    return values[:: -(-len(values) // most)]


def _far(states: Sequence[Float[Array, "_ D"]], is_kept: Bool[Array, " C"]) -> Bool[Array, " C"]:
    """Which of the demonstrations that are not kept are farther from the kept ones than these from one another: twice
    the largest distance, and above the 99 % point of the next one that is alike, were logarithms normal."""
    from scipy.spatial.distance import cdist
    from scipy.special import stdtrit

    distance, owner = np.zeros(len(is_kept)), np.repeat(np.arange(len(is_kept)), [*map(len, states)])
    every, of_kept = np.concatenate(states), is_kept[owner]
    for m, own in enumerate(states):
        distance[m] = np.median(cdist(own, every[of_kept & (owner != m)]).min(axis=1))
    size, n = np.log(np.maximum(distance[is_kept], ROUNDING)), int(is_kept.sum())
    level = FALSE_ALARMS / (2 * (~is_kept).sum())  # starts and states of each are compared
    limit = size.mean() + stdtrit(n - 1, 1 - level) * size.std(ddof=1) * np.sqrt(1 + 1 / n)
    return np.asarray(~is_kept & (distance > max(np.exp(limit), TIMES_FARTHER * distance[is_kept].max(), SAME_PLACE)))


def _bound(place: int, reached: Float[Array, "2 D"], gap: float, names: Sequence[str]) -> str:
    """The bound at a `place` in the lowest and, with a minus, the highest values that were `reached`: its digits tell
    it from what is farther by the `gap`, and no state that was reached passes it."""
    side, column = divmod(place, len(names))
    digits, name = max(0, 2 - math.floor(math.log10(gap))), names[column]
    outwards = (1, -1)[side] * math.floor(reached[side, column] * 10**digits) / 10**digits
    where = f"observation {name}" if name.isdigit() else printable(name)
    return f"{where} {('below', 'above')[side]} {outwards:.{digits}f}"
