"""All rules for recording faults, applied to demonstrations in memory or on disk."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import replace
from itertools import chain

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.missing import allow_missing
from rpil.faults.duplicates import find_duplicates
from rpil.faults.expected import leave_out
from rpil.faults.frame_times import find_frame_counts, find_frame_times, frame_time, recorded_time
from rpil.faults.lag import find_lag
from rpil.faults.maprules import MAP_COMPARISONS
from rpil.faults.measure import Learned, measure
from rpil.faults.measured_columns import column_labels, describe_columns, pilot
from rpil.faults.naming import learn
from rpil.faults.report import RULES, Fault, FaultReport
from rpil.faults.rules import COMPARISONS, Measurements, is_lag_known
from rpil.faults.settings import FaultSettings
from rpil.faults.whole import learn_ends
from rpil.formats.dataset import Dataset
from rpil.formats.recording import Recording
from rpil.formats.times import Times

FAULT_SETTINGS = FaultSettings()
"""The default."""

CODES = "no {} measures something: they are constant, codes or pixels"
HELD = ("frozen sensor", "frozen action", "saturation")
NEEDS: dict[str, Callable[[Measurements], str | None]] = {
    "observations": lambda seen: CODES.format("observation") if seen.columns.is_action.all() else None,
    "actions": lambda seen: None if seen.columns.is_action.any() else CODES.format("action"),
    "columns": lambda seen: None if seen.columns.names else CODES.format("observation or action"),
    "map": lambda seen: "no state corresponds to an action" if seen.learned.namer is None else None,
    "lag": lambda seen: None if seen.learned.lag.pairs else "no observation goes with an action",
    "several": lambda seen: _too_few(seen),
}
"""Why a rule does not apply, by what it needs."""


def check(
    recording: Recording | Demonstrations | Dataset,
    *,
    times: Times | None = None,
    fps: float | None = None,
    expected: Mapping[str, Collection[str]] | None = None,
    skip_bad: bool = False,
    settings: FaultSettings = FAULT_SETTINGS,
) -> FaultReport:
    """Find recording faults, as ``rpil check`` does: all rules, applied to demonstrations in memory or on disk.

    Parameters
    ----------
    recording : Recording, Demonstrations or Dataset
        What `rpil.open` gives, whose values may be missing, or demonstrations without times.
    times : Times, optional
        Timestamps, frame rate and lengths; by default those that the recording states, as far as it does.
    fps : float, optional
        Frames a second, where the recording does not say.
    expected : mapping of rule to ids, optional
        Findings that are declared expected; they are counted and left out.
    skip_bad : bool
        Where values are missing, set those demonstrations aside and apply the other rules to the rest; by default only
        the missing values are reported then.
    settings : FaultSettings, optional

    Returns
    -------
    FaultReport

    Examples
    --------
    >>> rpil.check(rpil.open("drive.parquet")).counts     # doctest: +SKIP
    """
    times = _times_of(recording, times, fps)
    demonstrations = _with_missing(recording) if isinstance(recording, Recording) else recording
    with allow_missing():
        labels = column_labels(demonstrations)
        sample, numbers = pilot(demonstrations, labels, settings)
        columns = describe_columns(sample, labels, settings)
        lag = find_lag(columns.of(sample), sample.offsets, columns, settings)
        namer = learn(sample, numbers, columns, lag, len(demonstrations), settings)
        learned = Learned(lag, namer, learn_ends(sample, columns, settings))
        measured, kept, missing = measure(demonstrations, columns, learned, settings)
    found = [*missing, *find_frame_counts(times, demonstrations), *find_frame_times(times, demonstrations, settings)]
    seconds = frame_time(times, demonstrations)
    usual, trims = {}, {}
    why = {"dropped frames": "the recording has no timestamps"} if times.timestamps is None else {}
    why |= {} if times.frames else {"frame count": "the recording does not say how many frames there should be"}
    unknown: dict[str, tuple[str, ...]] = {}
    if measured is None or (missing and not skip_bad):
        others = (rule for rule in RULES if rule not in ("missing values", "frame count", "dropped frames"))
        why |= dict.fromkeys(others, "values are missing; set these demonstrations aside: skip_bad=True, or --skip-bad")
    else:
        ids = tuple(name for name, keep in zip(demonstrations.ids, kept, strict=True) if keep)
        seen = Measurements(measured, columns, learned, ids, demonstrations.lengths[kept], seconds, settings)
        reasons = {need: reason for need, reason_of in NEEDS.items() if (reason := reason_of(seen))}
        why |= {name: reasons[need] for name, rule in RULES.items() for need in rule.needs[::-1] if need in reasons}
        found += find_duplicates(seen)
        compared, unknown = _compare(seen, why)
        found += compared
        usual = _usual(seen, recorded_time(times, demonstrations))
        trims = _trims(seen) if seen.columns.names else {}
    found, n_expected = leave_out(without_consequences(found), expected or {})
    return FaultReport(
        tuple(found),
        why,
        unknown,
        usual,
        trims,
        len(demonstrations),
        demonstrations.n_steps,
        tuple(f.id for f in missing) if skip_bad else (),
        n_expected,
    )


def _times_of(recording: Recording | Demonstrations | Dataset, times: Times | None, fps: float | None) -> Times:
    """The times that are given, or else those of the recording; what the user says of the frames a second is first."""
    fps = fps or (times.fps if times else None)
    if not isinstance(recording, Recording):
        return replace(times or Times(), fps=fps)
    times = times or recording.times()
    return replace(times, fps=fps or recording.description.fps or times.fps)


def _compare(seen: Measurements, why: dict[str, str]) -> tuple[list[Fault], dict[str, tuple[str, ...]]]:
    """The findings of the rules that compare demonstrations, and the columns in which nothing is known of a rule.

    Rules in `why` do not apply; one that knows nothing in any column is added to them.
    """
    found: list[Fault] = []
    known: dict[str, bool] = defaultdict(bool)
    unknown: dict[str, tuple[str, ...]] = {}
    for comparison in chain.from_iterable(compare(seen) for compare in (*COMPARISONS, *MAP_COMPARISONS)):
        if comparison.rule not in why:
            found += comparison.findings(seen.ids)
            silent = comparison.unknown
            unknown[comparison.rule] = tuple(n for n in unknown.get(comparison.rule, comparison.names) if n in silent)
            known[comparison.rule] |= len(silent) < len(comparison.names)
    why |= {name: RULES[name].unknown for name, is_known in known.items() if not is_known}
    return found, {rule: names for rule, names in unknown.items() if names and rule not in why}


def _with_missing(recording: Recording) -> Demonstrations | Dataset:
    """The demonstrations, where some values may be missing: these are reported, and not learned from later."""
    try:
        return recording.demonstrations
    except DataError:
        with allow_missing():
            return recording.load()


def without_consequences(found: Iterable[Fault]) -> list[Fault]:
    """The worst finding of each rule and demonstration, without what follows from another: jumps at the ends of frozen
    and saturated stretches and where two episodes meet, and lags and lengths that a change of time explains."""
    worst: dict[tuple[str, Id], Fault] = {}
    for f in sorted(found, key=lambda f: -f.severity):
        worst.setdefault((f.rule, f.id), f)
    found = list(worst.values())
    held = [f for f in found if f.rule in HELD]
    ends = {(f.id, f.column, step) for f in held for step in (f.first, f.last + 1)}
    meet = {(f.id, f.last) for f in found if f.rule == "two episodes"}
    remade = {f.id for f in found if f.rule in ("never moves", "next state", "two episodes")}
    timed = {f.id for f in found if f.rule in ("frame rate", "two episodes")}
    longer = {f.id for f in found if f.rule == "length" and f.value == f.last + 1 and f.value > f.threshold}
    return [
        f
        for f in found
        if not (f.rule == "jump" and ((f.id, f.column, f.last) in ends or (f.id, f.last) in meet))
        and not (f.rule == "length" and f.id in timed)
        and not (f.rule in (*HELD, "spike", "jump") and f.id in longer)
        and not ("map" in RULES[f.rule].needs and f.id in remade)
    ]


def _trims(seen: Measurements) -> dict[Id, tuple[int, int]]:
    """The steps to keep of each demonstration with idle ends, whether they are usual or not."""
    head, tail, least = seen.measured.head, seen.measured.tail, seen.settings.min_idle
    first, end = np.where(head >= least, head, 0), seen.lengths - np.where(tail >= least, tail, 0)
    idle = np.flatnonzero(((head >= least) | (tail >= least)) & (first < end)).tolist()
    return {seen.ids[m]: (int(first[m]), int(end[m])) for m in idle}


def _too_few(seen: Measurements) -> str | None:
    least = seen.settings.min_demonstrations
    return f"it takes {least} demonstrations to know what is usual" if len(seen.ids) < least else None


def _usual(seen: Measurements, recorded: float | None) -> dict[str, str]:
    """What is usual in these data, with a frame every `recorded` seconds by their timestamps."""
    usual = {}
    names = seen.columns.names
    if is_lag_known(seen):
        best = seen.learned.lag.pairs[0]
        first, second = names[best.action], names[best.state]
        if best.lag < 0:
            first, second = second, first
        usual["lag"] = f"{second} follows {first} after {seen.duration(abs(best.lag))}"
    if seen.seconds is not None:
        is_other = recorded and abs(recorded - seen.seconds) > 0.01 * seen.seconds
        declared = f", where {1e3 * seen.seconds:.4g} ms are declared" if is_other else ""
        usual["dropped frames"] = f"a frame every {1e3 * (recorded or seen.seconds):.4g} ms{declared}"
    return usual
