"""All rules, by their names, the report of what they find, and the file of findings that are expected."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from functools import cached_property

from rpil.data.arrays import Id
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath, check_extension, check_readable
from rpil.data.memory import LARGEST_TABLE, read_json
from rpil.data.text import DataFrame, counted, data_frame, one_line, printable
from rpil.faults import conventions, motion, recorded, settings, still, whole_rules  # noqa: F401  their rules
from rpil.faults.rule import Fault, Grouping, Rule, in_words
from rpil.formats import write_columns

OF_AUDIT = {
    "outlier": "the demonstration acts differently from the rest; it need not be worse",
    "bad": "the demonstration is bad, by the answers that were given",
    "adversary": "the demonstration is like the adversary that was named",
    "two groups": "two groups act differently; without an answer nobody can say which is good",
    "a group apart": "a few act alike, and differ from the rest; without an answer nobody can say if they are worse",
    "nothing could be learned": "the observations do not help to predict the actions",
}
"""Findings of an audit, and what they are; the rules of `RULES` have words of their own."""

_OF_RECORDINGS = (
    "missing values, frame count, dropped frames, repeated frames, frozen sensor, frozen action, saturation, spike, "
    "jump, scale, lag, sign, exchanged, offset, shifted action, reversed, frame rate, next state, two episodes, "
    "never moves, idle head, idle tail, duplicate, length, action is state, wraps, pause, constant, "
    "outside range, two conventions, two units, constant state, unrelated"
)
_OF_FOLDERS = "timestamps, totals, episode table, statistics, metadata, missing episodes, named files"
_OF_VIDEOS = (
    "video file, video frames, frame times, black frames, frozen picture, repeated pictures, exchanged cameras, "
    "turned camera, video time, other video"
)
_GROUPS = {"RPIL-1": _OF_RECORDINGS, "RPIL-2": _OF_FOLDERS, "RPIL-3": _OF_VIDEOS, "RPIL-4": ", ".join(OF_AUDIT)}

NUMBERS: dict[str, str] = {
    name: f"{group}{k:02}" for group, names in _GROUPS.items() for k, name in enumerate(names.split(", "), start=1)
}
"""The number of each finding, by its name: RPIL-101 and so on. It stays with its finding: a new one is added
at the end of its group, and a number is not given again."""

RULE_NAMES = {number: name for name, number in NUMBERS.items()}

RULES: dict[str, type[Rule]] = {name: Rule.named[name] for name in NUMBERS if name in Rule.named}
"""Every rule, in the order of the numbers."""

ALL = "all"  # stands for all demonstrations, where findings are expected
MAX_SHOWN = 10  # findings in the text of a report


@dataclass(frozen=True, repr=False)
class FaultReport:
    """Faults in M demonstrations; `to_frame` has a row for each finding.

    Attributes
    ----------
    findings : tuple of Fault
        The worst first; also of the files beside the demonstrations, and of videos.
    not_checked : mapping of rule to str
        The rules that could not be applied, and why.
    unknown : mapping of rule to names of columns
        The columns about which a rule says nothing, because they rest for long or clean demonstrations differ too much
        in them.
    usual : mapping of rule to str
        What is usual in these data, in words, such as the lag between action and state.
    trims : mapping of id to (int, int)
        Demonstrations with idle ends, usual or not: the first step to keep, and the first after those to keep.
    n_demonstrations, n_steps : int
    set_aside : tuple of ids
        Demonstrations that were left out, because values are missing.
    n_expected : int
        Findings that were left out, because ``--expected`` lists them.
    ids, groups : tuple of ids, and the groups in which a file or folder has them
    """

    findings: tuple[Fault, ...]
    not_checked: Mapping[str, str]
    unknown: Mapping[str, tuple[str, ...]]
    usual: Mapping[str, str]
    trims: Mapping[Id, tuple[int, int]]
    n_demonstrations: int
    n_steps: int
    set_aside: tuple[Id, ...] = ()
    n_expected: int = 0
    ids: tuple[Id, ...] = ()
    groups: Grouping = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "findings", tuple(sorted(self.findings, key=lambda found: found.order)))

    @cached_property
    def lines(self) -> tuple[Fault, ...]:
        """The findings, the worst first; those of a rule in more than a quarter of the demonstrations are one, which
        says in how many and in which."""
        of_rule: dict[str, list[Fault]] = {}
        for found in self.findings:
            of_rule.setdefault(found.rule, []).append(found)
        lines = []
        for same in of_rule.values():
            inside = [found for found in same if found.id != ""]
            if len(inside) <= max(1, settings.MOST_FEW * self.n_demonstrations) or not self.ids:
                lines += same
                continue
            worst, names = inside[0], {found.id for found in inside}
            where = tuple(name for name in self.ids if name in names)
            alike = len({found.column for found in inside}) == 1
            worst_in = f", the worst in {printable(worst.id)}" * (len({found.sentence for found in inside}) > 1)
            sentence = f"{in_words(where, self.ids, self.groups)}{worst_in}: {worst.sentence}"
            lines += [found for found in same if found.id == ""]
            lines.append(replace(worst, id="", column=worst.column * alike, sentence=sentence, ids=where))
        return tuple(sorted(lines, key=lambda found: found.order))

    @cached_property
    def counts(self) -> dict[str, int]:
        """The number of findings by rule, in the order of `RULES`; no rule without any."""
        counted = Counter(found.rule for found in self.findings)
        return {rule: counted[rule] for rule in RULES if counted[rule]}

    @property
    def reasons(self) -> dict[str, list[str]]:
        """The rules that could not be applied, by the reasons."""
        every = self.not_checked.items()
        return {reason: [rule for rule, why in every if why == reason] for _, reason in every}

    @property
    def odd(self) -> tuple[Id, ...]:
        """Ids of the demonstrations with a finding that at most a quarter of all have, the worst first."""
        return tuple(dict.fromkeys(found.id for found in self.lines if found.id != ""))

    @property
    def headline(self) -> str:
        """How much is found, one sentence."""
        size = f"{counted(self.n_demonstrations, 'demonstration')} ({counted(self.n_steps, 'step')})"
        n_other = sum(found.id == "" for found in self.findings)
        others, n_found = counted(n_other, "recording fault"), len({found.id for found in self.findings} - {""})
        if n_found:
            said = f"{counted(len(self.findings) - n_other, 'recording fault')} found in {n_found:,} of {size}"
            return f"{said}; {others} of the whole set." if n_other else f"{said}."
        if why := self.not_checked.get("duplicate"):  # which is looked for wherever anything is
            of = f" of {size}" if self.n_demonstrations else ""
            return f"The steps{of} were not checked: {why.rstrip('.')}.{f' Other files: {others}.' * bool(n_other)}"
        if n_other:
            return f"{others} of the whole set, of {size}."
        few = self.not_checked.get("jump", "")  # which needs what most rules need
        return f"No recording faults found in {size}{f'; most rules were not applied: {few}' * bool(few)}."

    def table(self) -> dict[str, list[object]]:
        """Columns with a row for each finding, the worst first: its number, and the fields of `Fault`; ids are text."""
        columns = {one.name: [getattr(found, one.name) for found in self.findings] for one in fields(Fault)}
        columns["id"] = [str(found.id) for found in self.findings]
        columns["ids"] = [" ".join(map(str, found.ids)) for found in self.findings]
        grades = {"grade": [found.grade for found in self.findings]}
        return {"number": [NUMBERS[found.rule] for found in self.findings]} | grades | columns

    def to_frame(self) -> DataFrame:
        """A data frame of `table`, as `rpil.Audit.to_frame` gives one."""
        return data_frame(self.table())

    def write(self, path: StrPath) -> None:
        """Write `table` to a .csv, .parquet or .json file, there a list of objects.

        Raises
        ------
        DataError
            Where the path has another extension, or cannot be written.
        """
        write_columns(path, self.table(), "findings")

    def __repr__(self) -> str:
        shown = self.lines[:MAX_SHOWN]
        lines = [f"  {printable(one.id) or 'the folder'}: {one_line(one.sentence)}" for one in shown]
        more = [f"  ... and {len(self.findings) - len(lines):,} more"] * (len(self.findings) > len(lines))
        return "\n".join([self.headline, *lines, *more, *(["All: to_frame(); idle ends: trims."] if lines else [])])

    def to_dict(self) -> dict[str, object]:
        """As plain numbers and text."""
        return {
            "demonstrations": self.n_demonstrations,
            "steps": self.n_steps,
            "counts": dict(self.counts),
            "findings": [{"number": NUMBERS[found.rule]} | found.to_dict() for found in self.findings],
            "lines": [{"number": NUMBERS[found.rule]} | found.to_dict() for found in self.lines],
            "trims": [{"id": name, "first": first, "end": end} for name, (first, end) in self.trims.items()],
            "usual": dict(self.usual),
            "not_checked": dict(self.not_checked),
            "unknown": {rule: list(names) for rule, names in self.unknown.items()},
            "set_aside": list(self.set_aside),
            "expected": self.n_expected,
        }


def rule_name(word: str, where: str) -> str:
    """The rule of `RULES` that a user names by its number, or with spaces, hyphens or underscores; a `DataError` where
    there is none."""
    name = RULE_NAMES.get(word.strip().upper(), word.strip().lower().replace("-", " ").replace("_", " "))
    if name not in RULES:
        near = get_close_matches(name, RULES, 1)
        remedy = f"perhaps it is {near[0]!r}" if near else f"the rules are {', '.join(RULES)}"
        raise DataError(f"{where}: there is no rule {word!r}; {remedy}.")
    return name


def read_expected(path: StrPath) -> dict[str, set[str]]:
    """Rule to the ids, as text, of the demonstrations in which its findings are so on purpose.

    The file is a JSON object of rule to a list of ids or ``"all"``: ``{"spike": [3, 7]}``.

    Raises
    ------
    DataError
        One sentence that names the file and the line: another form, or a rule that does not exist.
    """
    path = check_readable(check_extension(path, (".json",), "what is expected"))
    with guarded(path.name, "it is not valid JSON in UTF-8", "write rules with lists of ids"):
        content = read_json(path, LARGEST_TABLE)
    if not isinstance(content, dict):
        raise DataError(f'{path.name}: it holds no object of rule to list of ids; write, say, {{"spike": [3, 7]}}.')
    expected: dict[str, set[str]] = {}
    for word, names in content.items():
        listed = [names] if isinstance(names, str | int) else names
        if not isinstance(listed, list) or not all(isinstance(name, str | int) for name in listed):
            raise DataError(f"{path.name}: {word!r} needs a list of demonstration ids, or the word {ALL}.")
        expected.setdefault(rule_name(word, path.name), set()).update(map(str, listed))
    return expected
