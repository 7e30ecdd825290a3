"""All rules for recording faults, applied to demonstrations in memory or on disk."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import chain

from rpil.audit.faults.clock import Clock, find_frame_counts, find_frame_times, frame_time
from rpil.audit.faults.columns import Columns, describe_columns, pilot
from rpil.audit.faults.duplicates import find_duplicates
from rpil.audit.faults.lag import Pair, find_pairs
from rpil.audit.faults.measure import measure
from rpil.audit.faults.record import FaultReport, Finding
from rpil.audit.faults.rules import COMPARISONS, Evidence
from rpil.audit.faults.settings import FaultSettings
from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations
from rpil.data.formats.dataset import Dataset

FAULT_SETTINGS = FaultSettings()
"""The default."""


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
    seen = Evidence(measured, columns, demonstrations.ids, demonstrations.lengths, settings)
    not_checked = _not_checked(demonstrations, clock, columns, pairs, settings)
    found = [
        *missing,
        *find_frame_counts(clock, demonstrations),
        *find_frame_times(clock, demonstrations, settings),
        *find_duplicates(seen),
        *chain.from_iterable(
            find(seen) for rules, find in COMPARISONS.items() if not all(rule in not_checked for rule in rules)
        ),
    ]
    on_purpose = {(rule, name) for rule, names in (expected or {}).items() for name in names}
    kept = [f for f in found if not {(f.rule, str(f.id)), (f.rule, "all"), ("any", str(f.id))} & on_purpose]
    return FaultReport(
        tuple(kept),
        not_checked,
        _usual(demonstrations, clock, columns, pairs),
        len(demonstrations),
        demonstrations.n_steps,
        tuple(dict.fromkeys(f.id for f in missing)),
        len(found) - len(kept),
    )


def _not_checked(
    demonstrations: Demonstrations | Dataset,
    clock: Clock,
    columns: Columns,
    pairs: tuple[Pair, ...],
    settings: FaultSettings,
) -> dict[str, str]:
    """The rules that cannot be applied, and why."""
    why = {}
    few = f"needs {settings.min_demonstrations} demonstrations to know what is usual"
    codes = "no {} column measures something: all are constant, codes or pixels"
    if clock.timestamps is None:
        why["dropped frames"] = "the recording has no timestamps"
    if not clock.frames:
        why["frame count"] = "the recording does not say how many frames there should be"
    n_actions = int(columns.is_action.sum())
    if len(columns.names) == n_actions:
        why |= dict.fromkeys(("frozen sensor", "idle head", "idle tail"), codes.format("observation"))
    if not n_actions:
        why["frozen action"] = "actions are discrete" if demonstrations.is_discrete else codes.format("action")
    if not columns.names:
        why |= dict.fromkeys(("saturation", "spike", "jump", "scale"), codes.format("observation or action"))
    if not pairs:
        why["lag"] = "no observation follows an action"
    if len(demonstrations) < settings.min_demonstrations:
        why |= {rule: few for rules in COMPARISONS for rule in rules if rule not in why}
    return why


def _usual(
    demonstrations: Demonstrations | Dataset, clock: Clock, columns: Columns, pairs: tuple[Pair, ...]
) -> dict[str, str]:
    """What is usual in these data."""
    usual, seconds = {}, frame_time(clock, demonstrations)
    if pairs:
        time = "" if seconds is None else f" ({1e3 * seconds * abs(pairs[0].lag):.0f} ms)"
        best = max(pairs, key=lambda pair: pair.correlation)
        usual["lag"] = (
            f"{columns.names[best.state]} is best aligned with {columns.names[best.action]} {best.lag} steps{time} later"
        )
    if seconds is not None:
        usual["dropped frames"] = f"a frame every {1e3 * seconds:.4g} ms"
    return usual


