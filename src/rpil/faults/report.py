"""What the rules find: one record for each fault of a demonstration, and the report of all."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field

from rpil.data.archive import NOT_STORED, stored
from rpil.data.arrays import Id

DIFFER = "demonstrations differ too much in this to know what is usual"
LAGS_DIFFER = "the lag between action and state is not the same in most demonstrations"
RESTS = "{} rest for long, or demonstrations differ too much in this"
NO_BETTER = "sound demonstrations fit the map between states and actions as well with this fault undone"


@dataclass(frozen=True)
class Rule:
    """A rule without a model; see docs/faults.md.

    Attributes
    ----------
    words : str
        What it finds.
    needs : tuple of str
        What must be there, names of `rpil.faults.checking.NEEDS`.
    unknown : str
        Why it says nothing where it applies and nothing can be known.
    """

    words: str
    needs: tuple[str, ...] = ()
    unknown: str = DIFFER


COLUMNS, MAPS = ("columns", "several"), ("map", "several")
RULES = {
    "missing values": Rule("a value is NaN or infinite"),
    "frame count": Rule("the recording says that it has more or fewer frames"),
    "dropped frames": Rule("the time between two frames is too long"),
    "repeated frames": Rule(
        "the time between two frames is too short, or a row repeats the one before while all moves", ("several",)
    ),
    "frozen sensor": Rule(
        "an observation stays the same for long while others change",
        ("observations", *COLUMNS),
        RESTS.format("observations"),
    ),
    "frozen action": Rule(
        "an action stays the same for long while others change", ("actions", *COLUMNS), RESTS.format("actions")
    ),
    "saturation": Rule("a column stays at its lowest or highest value for long", COLUMNS, RESTS.format("columns")),
    "spike": Rule("one value is far from both its neighbours", COLUMNS),
    "jump": Rule("a column leaps from one step to the next and stays there", COLUMNS),
    "scale": Rule("a column has another unit or scale than elsewhere", COLUMNS),
    "lag": Rule("the state follows the action sooner or later than elsewhere", ("lag", "several"), LAGS_DIFFER),
    "sign": Rule("a column has the other sign", MAPS, NO_BETTER),
    "exchanged": Rule("two columns are exchanged", MAPS, NO_BETTER),
    "offset": Rule("a constant is added to a column", MAPS, NO_BETTER),
    "shifted action": Rule("the actions are one step early or late", MAPS, NO_BETTER),
    "reversed": Rule("time runs backwards", MAPS, NO_BETTER),
    "frame rate": Rule("it has half the frame rate of the others", MAPS, NO_BETTER),
    "next state": Rule("the action is the next state", ("several",), "the action is the next state in most"),
    "two episodes": Rule(
        "it holds two episodes", ("observations", "several"), "beginnings and ends are not unlike the rest"
    ),
    "never moves": Rule("a column that moves in the others never does", COLUMNS),
    "idle head": Rule("nothing moves for long at the beginning", COLUMNS),
    "idle tail": Rule("nothing moves for long at the end", COLUMNS),
    "duplicate": Rule("another demonstration is the same, or nearly"),
    "length": Rule("it is far longer or shorter than the others", ("several",)),
}
"""Every rule."""


@stored()
@dataclass(frozen=True)
class Fault:
    """A fault of one demonstration, the worst of its kind there.

    Attributes
    ----------
    rule : str
        One of `RULES`.
    id : int or str
        The demonstration.
    first, last : int
        Its steps concerned, from 0, both included.
    column : str
        The observation or action, or "" where the demonstration as a whole is concerned.
    value, threshold : float
        What was measured, and from where on it is a fault, both in the unit that the sentence names.
    severity : float
        How many times beyond the threshold; findings are sorted by it.
    sentence : str
        The finding in words, without the id of the demonstration.
    """

    rule: str
    id: Id
    first: int
    last: int
    column: str
    value: float
    threshold: float
    severity: float
    sentence: str

    def to_dict(self) -> dict[str, object]:
        """As plain numbers and text; an infinite severity as None."""
        return asdict(self) | {"severity": self.severity if math.isfinite(self.severity) else None}


@stored()
@dataclass(frozen=True)
class FaultReport:
    """What was found in M demonstrations.

    Attributes
    ----------
    findings : tuple of Fault
        The worst first.
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
        Demonstrations that could not be read on, because values are missing, and were left out.
    n_expected : int
        Findings that were left out because they are so on purpose.
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
    counts: Mapping[str, int] = field(init=False, metadata=NOT_STORED)

    def __post_init__(self) -> None:
        object.__setattr__(self, "findings", tuple(sorted(self.findings, key=lambda found: -found.severity)))
        counted = Counter(found.rule for found in self.findings)
        object.__setattr__(self, "counts", {rule: counted[rule] for rule in RULES if counted[rule]})

    @property
    def absent(self) -> set[Id]:
        """Ids of the demonstrations that the recording names and does not hold."""
        return {found.id for found in self.findings if found.rule == "frame count" and not found.value}

    def to_dict(self) -> dict[str, object]:
        """As plain numbers and text."""
        return {
            "demonstrations": self.n_demonstrations,
            "steps": self.n_steps,
            "counts": dict(self.counts),
            "findings": [found.to_dict() for found in self.findings],
            "trims": [{"id": name, "first": first, "end": end} for name, (first, end) in self.trims.items()],
            "usual": dict(self.usual),
            "not_checked": dict(self.not_checked),
            "unknown": {rule: list(names) for rule, names in self.unknown.items()},
            "set_aside": list(self.set_aside),
            "expected": self.n_expected,
        }


def explain(findings: Iterable[Fault], name: object) -> str | None:
    """One clause on the worst fault of a demonstration, for a sentence on why its trust is low; None without one."""
    own = [found for found in findings if str(found.id) == str(name)]
    if not own:
        return None
    worst = max(own, key=lambda found: found.severity)
    more = f" (and {len(own) - 1} more)" if len(own) > 1 else ""
    return f"its recording has a fault that may explain this: {worst.rule}, {worst.sentence}{more}"
