"""All rules for recording faults, applied to demonstrations in memory or on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import chain

from rpil.audit.faults.clock import Clock, find_frame_counts, find_frame_times, frame_time
from rpil.audit.faults.columns import Columns, describe_columns, pilot
from rpil.audit.faults.duplicates import find_duplicates
from rpil.audit.faults.expected import leave_out
from rpil.audit.faults.lag import Pair, find_pairs
from rpil.audit.faults.measure import measure
from rpil.audit.faults.record import FaultReport, Finding
from rpil.audit.faults.rules import COMPARISONS, Evidence, is_lag_known
from rpil.audit.faults.settings import FaultSettings
from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.formats.dataset import Dataset

FAULT_SETTINGS = FaultSettings()
"""The default."""

COLUMN_RULES = ("frozen sensor", "frozen action", "saturation", "spike", "jump", "scale", "idle head", "idle tail")
"""Rules that compare columns which measure something."""

WHOLE_RULES = ("lag", "length", "repeated frames")
"""Rules that compare demonstrations as a whole."""


def find_faults(
    demonstrations: Demonstrations | Dataset,
    clock: Clock = Clock(),
    expected: Mapping[str, Collection[str]] | None = None,
    missing: Iterable[Finding] = (),
    settings: FaultSettings = FAULT_SETTINGS,
) -> FaultReport:
    """Apply all rules to demonstrations in memory or on disk.

    Parameters
    ----------
    demonstrations : Demonstrations or Dataset
    clock : Clock
        Timestamps, frame rate and lengths that the recording states, as far as it does.
    expected : mapping of rule to ids, optional
        What is so on purpose (`read_expected`); these findings are counted and left out.
    missing : iterable of Finding
        Of demonstrations that were set aside when the data were read.
    settings : FaultSettings

    Returns
    -------
    FaultReport
    """
    missing = tuple(missing)
    sample = pilot(demonstrations, settings)
    columns = describe_columns(sample, settings)
    values = columns.of(sample.shards(1, sample.n_steps + 1)[0][0])
    pairs = find_pairs(values, sample.offsets, columns, settings)
    measured = measure(demonstrations, columns, pairs, settings)
    seen = Evidence(measured, columns, pairs, demonstrations.ids, demonstrations.lengths, settings)
    not_checked = _not_applicable(demonstrations, clock, columns, pairs, settings)
    found = [
        *missing,
        *find_frame_counts(clock, demonstrations),
        *find_frame_times(clock, demonstrations, settings),
        *find_duplicates(seen),
    ]
    unknown = {}
    for comparison in chain.from_iterable(compare(seen) for compare in COMPARISONS):
        rule = comparison.rule
        if rule not in not_checked:
            found += comparison.findings(demonstrations.ids)
            if comparison.unknown:
                unknown[rule] = comparison.unknown
    found, n_expected = leave_out(found, expected or {})
    return FaultReport(
        tuple(found),
        not_checked | _too_different(unknown, columns),
        {rule: names for rule, names in unknown.items() if names != ("",)},
        _usual(demonstrations, clock, seen),
        len(demonstrations),
        demonstrations.n_steps,
        tuple(dict.fromkeys(f.id for f in missing)),
        n_expected,
    )


def _not_applicable(
    demonstrations: Demonstrations | Dataset,
    clock: Clock,
    columns: Columns,
    pairs: tuple[Pair, ...],
    settings: FaultSettings,
) -> dict[str, str]:
    """The rules that do not apply to such data, and why."""
    n_actions = int(columns.is_action.sum())
    codes = "no {} column measures something: all are constant, codes or pixels"
    why = {}
    if clock.timestamps is None:
        why["dropped frames"] = "the recording has no timestamps"
    if not clock.frames:
        why["frame count"] = "the recording does not say how many frames there should be"
    if len(columns.names) == n_actions:
        why["frozen sensor"] = codes.format("observation")
    if not n_actions:
        why["frozen action"] = "actions are discrete" if demonstrations.is_discrete else codes.format("action")
    if not columns.names:
        why |= dict.fromkeys(COLUMN_RULES, codes.format("observation or action"))
    if not pairs:
        why["lag"] = "no observation follows an action"
    if len(demonstrations) < settings.min_demonstrations:
        few = f"it takes {settings.min_demonstrations} demonstrations to know what is usual"
        why |= {rule: few for rule in (*COLUMN_RULES, *WHOLE_RULES) if rule not in why}
    return why


def _too_different(unknown: dict[str, tuple[str, ...]], columns: Columns) -> dict[str, str]:
    """Why rules that apply were silent in all columns."""
    reasons = {"lag": "the lag between action and state is not the same in most demonstrations"}
    other = "demonstrations differ too much in this to tell what is usual"
    return {
        rule: reasons.get(rule, other)
        for rule, names in unknown.items()
        if names == ("",) or len(names) == len(columns.names)
    }


def _usual(demonstrations: Demonstrations | Dataset, clock: Clock, seen: Evidence) -> dict[str, str]:
    """What is usual in these data."""
    usual, seconds = {}, frame_time(clock, demonstrations)
    if is_lag_known(seen):
        best, names = max(seen.pairs, key=lambda pair: pair.correlation), seen.columns.names
        time = "" if seconds is None else f" ({1e3 * seconds * abs(best.lag):.0f} ms)"
        first, second = names[best.action], names[best.state]
        if best.lag < 0:
            first, second = second, first
        usual["lag"] = f"{second} follows {first} after {abs(best.lag)} steps{time}"
    if seconds is not None:
        usual["dropped frames"] = f"a frame every {1e3 * seconds:.4g} ms"
    return usual
