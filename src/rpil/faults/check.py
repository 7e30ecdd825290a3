"""All rules for recording faults, applied to demonstrations in memory or on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import chain

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.missing import allow_missing
from rpil.faults.columns import column_labels, describe_columns, pilot
from rpil.faults.duplicates import find_duplicates
from rpil.faults.expected import leave_out
from rpil.faults.frames import find_frame_counts, find_frame_times, frame_time
from rpil.faults.lag import find_pairs
from rpil.faults.measure import measure
from rpil.faults.naming import learn
from rpil.faults.record import RULES, FaultReport, Finding
from rpil.faults.rules import COMPARISONS, Evidence, is_lag_known
from rpil.faults.settings import FaultSettings
from rpil.formats.dataset import Dataset
from rpil.formats.times import Times

FAULT_SETTINGS = FaultSettings()
"""The default."""

TOO_DIFFERENT = {
    "": "demonstrations differ too much in this to know what is usual",
    "lag": "the lag between action and state is not the same in most demonstrations",
    "frozen action": "actions rest for long, or demonstrations differ too much in this",
    "frozen sensor": "observations rest for long, or demonstrations differ too much in this",
    "saturation": "columns rest for long, or demonstrations differ too much in this",
}
"""Why a rule that applies says nothing."""

COLUMN_RULES = ("frozen sensor", "frozen action", "saturation", "spike", "jump", "scale", "idle head", "idle tail")
"""Rules that compare columns which measure something."""

WHOLE_RULES = ("lag", "length", "repeated frames")
"""Rules that compare demonstrations as a whole."""


def find_faults(
    demonstrations: Demonstrations | Dataset,
    times: Times = Times(),
    expected: Mapping[str, Collection[str]] | None = None,
    skip_bad: bool = False,
    settings: FaultSettings = FAULT_SETTINGS,
) -> FaultReport:
    """Apply all rules to demonstrations in memory or on disk.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
        Values may be missing if they were read within `rpil.data.missing.allow_missing`.
    times : Times
        Timestamps, frame rate and lengths that the recording states, as far as it does.
    expected : mapping of rule to ids, optional
        What is so on purpose (`read_expected`); these findings are counted and left out.
    skip_bad : bool
        Where values are missing, set those demonstrations aside and apply the other rules to the rest; by default only
        the missing values are reported then.
    settings : FaultSettings

    Returns
    -------
    FaultReport
    """
    with allow_missing():
        labels = column_labels(demonstrations)
        sample, numbers = pilot(demonstrations, labels, settings)
        columns = describe_columns(sample, labels, settings)
        pairs, related = find_pairs(columns.of(sample), sample.offsets, columns, settings)
        namer = learn(sample, numbers, columns, pairs, related, len(demonstrations), settings)
        measured, kept, missing = measure(demonstrations, columns, pairs, namer, settings)
    found = [*missing, *find_frame_counts(times, demonstrations), *find_frame_times(times, demonstrations, settings)]
    seconds = frame_time(times, demonstrations)
    why, unknown, usual, trims = _no_times(times), {}, {}, {}
    if measured is None or (missing and not skip_bad):
        others = (rule for rule in RULES if rule not in ("missing values", "frame count", "dropped frames"))
        why |= dict.fromkeys(others, "values are missing; set these demonstrations aside with --skip-bad")
    else:
        ids = tuple(name for name, keep in zip(demonstrations.ids, kept, strict=True) if keep)
        seen = Evidence(measured, columns, pairs, ids, demonstrations.lengths[kept], seconds, settings)
        why |= _not_applicable(seen)
        found += find_duplicates(seen)
        for comparison in chain.from_iterable(compare(seen) for compare in COMPARISONS):
            if comparison.rule not in why:
                found += comparison.findings(ids)
                unknown[comparison.rule] = comparison.unknown
                if len(comparison.unknown) == len(comparison.names):
                    why[comparison.rule] = TOO_DIFFERENT.get(comparison.rule, TOO_DIFFERENT[""])
        usual, trims = _usual(seen), _trims(seen) if seen.columns.names else {}
    found, n_expected = leave_out(without_consequences(found), expected or {})
    return FaultReport(
        tuple(found),
        why,
        {rule: names for rule, names in unknown.items() if names and rule not in why},
        usual,
        trims,
        len(demonstrations),
        demonstrations.n_steps,
        tuple(f.id for f in missing) if skip_bad else (),
        n_expected,
    )


def without_consequences(found: Iterable[Finding]) -> list[Finding]:
    """The findings without the jumps at the ends of frozen and saturated stretches, which end with a leap."""
    found = list(found)
    held = [f for f in found if f.rule in ("frozen sensor", "frozen action", "saturation")]
    ends = {(f.id, f.column, step) for f in held for step in (f.first, f.last + 1)}
    return [f for f in found if f.rule != "jump" or (f.id, f.column, f.last) not in ends]


def _trims(seen: Evidence) -> dict[Id, tuple[int, int]]:
    """The steps to keep of each demonstration with idle ends, whether they are usual or not."""
    head, tail, least = seen.measured.head, seen.measured.tail, seen.settings.min_idle
    first, end = np.where(head >= least, head, 0), seen.lengths - np.where(tail >= least, tail, 0)
    idle = np.flatnonzero(((head >= least) | (tail >= least)) & (first < end)).tolist()
    return {seen.ids[m]: (int(first[m]), int(end[m])) for m in idle}


def _no_times(times: Times) -> dict[str, str]:
    """The rules that need what the recording does not say."""
    why = {}
    if times.timestamps is None:
        why["dropped frames"] = "the recording has no timestamps"
    if not times.frames:
        why["frame count"] = "the recording does not say how many frames there should be"
    return why


def _not_applicable(seen: Evidence) -> dict[str, str]:
    """The rules that do not apply to such data, and why."""
    columns, n_actions = seen.columns, int(seen.columns.is_action.sum())
    codes = "no {} measures something: they are constant, codes or pixels"
    why = {}
    if len(columns.names) == n_actions:
        why["frozen sensor"] = codes.format("observation")
    if not n_actions:
        why["frozen action"] = codes.format("action")
    if not columns.names:
        why |= dict.fromkeys(COLUMN_RULES, codes.format("observation or action"))
    if not seen.pairs:
        why["lag"] = "no observation goes with an action"
    if len(seen.ids) < seen.settings.min_demonstrations:
        few = f"it takes {seen.settings.min_demonstrations} demonstrations to know what is usual"
        why |= {rule: few for rule in (*COLUMN_RULES, *WHOLE_RULES) if rule not in why}
    return why


def _usual(seen: Evidence) -> dict[str, str]:
    """What is usual in these data."""
    usual = {}
    if is_lag_known(seen):
        best, names = max(seen.pairs, key=lambda pair: pair.correlation), seen.columns.names
        first, second = names[best.action], names[best.state]
        if best.lag < 0:
            first, second = second, first
        usual["lag"] = f"{second} follows {first} after {seen.duration(abs(best.lag))}"
    if seen.seconds is not None:
        usual["dropped frames"] = f"a frame every {1e3 * seen.seconds:.4g} ms"
    return usual
