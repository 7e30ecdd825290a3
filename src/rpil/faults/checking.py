"""All rules for recording faults, applied to demonstrations in memory or on disk."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Unpack, cast

import numpy as np

from rpil.data.arrays import Id
from rpil.data.demonstrations import Demonstrations, DemonstrationSet
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath
from rpil.data.id_values import check_ids
from rpil.faults import recorded, settings
from rpil.faults.measured_columns import MovingBlock, column_labels, set_aside
from rpil.faults.report import ALL, RULES, FaultReport, rule_name
from rpil.faults.rule import ComparingRule, Fault, Grouping, Learned, Measure, Measurements
from rpil.faults.whole_rules import Duplicate, Length, OtherLag, trims
from rpil.formats import ReadOptions, opened
from rpil.formats.columns import ColumnOptions, check_options
from rpil.formats.format import Dataset, Frame
from rpil.formats.places import Times
from rpil.formats.recording import Recording
from rpil.formats.registry import find_format
from rpil.numerics.types import Array, Bool

COMPARING = [rule for rule in RULES.values() if issubclass(rule, ComparingRule)]


def check(
    data: StrPath | Frame | Demonstrations | Recording | Dataset | Iterable[object],
    *,
    times: Times | None = None,
    fps: float | None = None,
    expected: Mapping[str, Id | Collection[Id]] | None = None,
    video: bool = False,
    **columns: Unpack[ReadOptions],
) -> FaultReport:
    """Find recording faults, as ``rpil check`` does: all rules, on demonstrations in memory or on disk.

    Parameters
    ----------
    data : path, frame, Demonstrations, Recording, Dataset or iterable of trajectories
        As for `rpil.audit`; values may be missing. Demonstrations in memory have no times.
    times : Times, optional
        Timestamps, frame rate and lengths; by default those that the recording states.
    fps : float, optional
        Frames a second, where the recording does not say.
    expected : mapping of rule to ids, optional
        Expected findings, which are counted and left out. A rule or an id that does not exist is an error.
    video : bool
        Also look at the videos of a folder of LeRobot, which needs the extra video.
    **columns
        As for `rpil.read`. If values are missing, by default only these are reported; with ``skip_bad=True`` the other
        rules check the demonstrations without missing values.

    Returns
    -------
    FaultReport

    Examples
    --------
    >>> report = rpil.check("drive.csv", id="trip", action=["steer", "accel"])     # doctest: +SKIP
    >>> report.to_frame(), report.trims                                            # doctest: +SKIP
    """
    check_options(columns)
    skip_bad = columns.pop("skip_bad", False)
    options = ColumnOptions(**columns)
    is_open = isinstance(data, Recording | Demonstrations | Dataset) and options == ColumnOptions()
    if skip_bad and isinstance(data, str | os.PathLike):
        options = replace(options, skip_bad="damage")
    try:
        recording = cast("Recording | Demonstrations | Dataset", data) if is_open else opened(data, options)
    except DataError as error:
        return of_files(data, error, str(error))
    demonstrations, times, groups = _opened(recording, times, fps)
    there, known = recording.ids, dict[str, set[str]]()
    for rule, names in (expected or {}).items():
        texts = {*map(str, names if isinstance(names, Collection) and not isinstance(names, str) else [names])}
        if not skip_bad:  # else it may be the id of a demonstration that was skipped
            check_ids(sorted(texts), (*there, ALL), demonstrations.source, "--expected")
        known.setdefault(rule_name(rule, "--expected"), set()).update(texts)
    if isinstance(demonstrations, Dataset):
        layout = replace(demonstrations.layout, allows_missing=True, order="F")  # as rules go along columns
        demonstrations = replace(demonstrations, layout=layout)
    beside, why = _check_files(recording, demonstrations, video)
    if isinstance(recording, Recording) and recording.options.segment is not None:
        why[Length.name] = "--segment ends demonstrations by the clock"
    report = _check_steps(demonstrations, times, skip_bad, why, groups)
    if recorded.TIMESTAMPS not in {found.rule for found in beside}:
        beside += recorded.find_other_rate(times, demonstrations)
    every, ids = (*report.findings, *beside), tuple(demonstrations.ids)
    findings = tuple(found for found in every if not {str(found.id), ALL} & known.get(found.rule, set()))
    return replace(report, findings=findings, n_expected=len(every) - len(findings), ids=ids, groups=groups)


def of_files(data: object, error: DataError, why: str) -> FaultReport:
    """The report on the files that a recording names, where they are not sound, and its steps cannot be read, `why`;
    else the `error`."""
    found: tuple[Fault, ...] = ()
    with suppress(DataError), guarded(str(data)):
        claimed = find_format(data) if isinstance(data, str | os.PathLike) and Path(data).exists() else None
        if claimed is not None and claimed.find_defects is not None:
            defects = claimed.find_defects(Path(str(data)), False)
            found = tuple(recorded.fault_of(one) for one in defects if one.what == "named files")
    if not found:
        raise error
    return FaultReport(found, {rule: why for rule in RULES if rule != found[0].rule}, {}, {}, {}, 0, 0)


def _check_files(
    recording: Recording | Demonstrations | Dataset, demonstrations: DemonstrationSet, video: bool
) -> tuple[list[Fault], dict[str, str]]:
    """Faults in the files beside the demonstrations, and the rules that need a look at videos, without one."""
    read = recording if isinstance(recording, Recording) and recording.find_defects else None
    if video and not (read and read.description.format.startswith("LeRobot")):
        raise DataError(f"{demonstrations.source}: --video is for folders of LeRobot; leave it out.")
    if read is None or read.find_defects is None:
        return [], {}
    unseen = [] if video or not read.origin.metadata.videos else [rule.name for rule in recorded.BY_LOOKING]
    found = recorded.find_beside(read.find_defects(video), demonstrations)
    return found, dict.fromkeys(unseen, "videos are looked at with --video, or video=True")


def _check_steps(
    demonstrations: Demonstrations | Dataset, times: Times, skip_bad: bool, why: dict[str, str], groups: Grouping
) -> FaultReport:
    """The faults in the steps of the demonstrations; `why` tells which rules are not to be applied, and gets more."""
    seconds = 1.0 / times.fps if times.fps else recorded.recorded_time(times, demonstrations)
    measured, kept, missing = _measure(demonstrations, learned := Learned.of(demonstrations), seconds)
    of_times = recorded.find_frame_times(times, demonstrations, seconds)
    findings = [*missing, *recorded.FrameCount.find(times, demonstrations), *of_times]
    if not times.frames:
        why[recorded.FrameCount.name] = "the recording does not say how many frames there should be"
    if times.timestamps is None or not seconds:
        coarse = "the timestamps are coarser than the frames; give fps, or --fps"
        no_clock = "the recording has no timestamps" if times.timestamps is None else coarse
        why |= dict.fromkeys((recorded.DroppedFrames.name, recorded.FrameRate.name), no_clock)
    unknown, usual = dict[str, tuple[str, ...]](), dict[str, str]()
    idle_ends = dict[Id, tuple[int, int]]()
    if not kept.any() or (missing and not skip_bad):
        reason = "values are missing; set these demonstrations aside: skip_bad=True, or --skip-bad"
        why |= dict.fromkeys((Duplicate.name, *(rule.name for rule in COMPARING)), reason)
    else:
        ids = tuple(name for name, keep in zip(demonstrations.ids, kept, strict=True) if keep)
        data = Measurements(learned, measured, ids, demonstrations.lengths[kept], seconds, groups)
        lacking = {rule.name: [*filter(None, map(data.lacking.get, rule.needs))] for rule in COMPARING}
        why |= {name: reasons[0] for name, reasons in lacking.items() if reasons}
        findings += Duplicate.find(data)
        for rule in (kind(data) for kind in COMPARING if kind.name not in why):  # of which one at a time is in memory
            silent, is_known = rule.silent, rule.silent != rule.names or not rule.names
            why |= {} if is_known else {rule.name: rule.unknown}
            unknown |= {rule.name: silent} if silent and is_known else {}
            usual |= {rule.name: rule.usual()} if is_known and isinstance(rule, OtherLag) else {}
            findings += rule.findings()
        usual |= {recorded.DroppedFrames.name: f"a frame every {1e3 * seconds:.4g} ms"} if seconds else {}
        idle_ends = trims(data)
    found, left_out = tuple(without_consequences(findings)), tuple(f.id for f in missing) if skip_bad else ()
    return FaultReport(found, why, unknown, usual, idle_ends, len(demonstrations), demonstrations.n_steps, left_out)


def _opened(
    recording: Recording | Demonstrations | Dataset, times: Times | None, fps: float | None
) -> tuple[Demonstrations | Dataset, Times, Grouping]:
    """The demonstrations, where some values may be missing: these are reported, and not learned from later; their times
    and frames a second, those that are given, or else those of the recording; and the groups in which it has them."""
    fps = fps or (times.fps if times else None)
    if not isinstance(recording, Recording):
        return recording, replace(times or Times(), fps=fps), {}
    try:
        demonstrations = recording.demonstrations
    except DataError:
        demonstrations = recording.load(replace(recording.options, allow_missing=True))
    times = times or recording.times()
    groups = {"task": recording.tasks, "operator": {name: str(of) for name, of in recording.operators}}
    return demonstrations, replace(times, fps=fps or recording.description.fps or times.fps), groups


def _measure(
    demonstrations: Demonstrations | Dataset, learned: Learned, seconds: float | None
) -> tuple[dict[Measure, tuple[Array, ...]], Bool[Array, " M"], list[Fault]]:
    """Measures of the demonstrations without missing values, block by block; a mask of these demonstrations;
    and what is missing in the others."""
    measures = dict.fromkeys([Duplicate.measure, *(rule.measure for rule in COMPARING)])
    joined, n = dict[Measure, tuple[Array, ...]](), 0  # one array for all blocks: a list of theirs would leave gaps
    masks, missing = list[Bool[Array, " M"]](), list[Fault]()
    for shard in demonstrations.shards(1, settings.CACHE_STEPS):
        for whole in shard:
            block, kept = set_aside(whole)
            masks.append(kept)
            if not kept.all():
                labels = column_labels(demonstrations)
                missing += recorded.MissingValues.find(whole, demonstrations.ids, labels, seconds)
            if kept.any():
                moving = MovingBlock.of(block, whole.first + np.flatnonzero(kept), learned.columns)
                for measure in measures:
                    found, n_all = measure(moving, learned), len(demonstrations)
                    if measure not in joined:
                        joined[measure] = tuple(np.empty_like(x, shape=(n_all, *x.shape[1:])) for x in found)
                    for every, x in zip(joined[measure], found, strict=True):
                        np.copyto(every[n : n + len(x)], x)
                n += int(kept.sum())
    return {measure: tuple(x[:n] for x in every) for measure, every in joined.items()}, np.concatenate(masks), missing


def without_consequences(findings: Iterable[Fault]) -> list[Fault]:
    """The worst finding of each rule and demonstration, or of each column of the set, without those that follow from
    another finding in it, or of the set, which itself follows from none."""
    worst: dict[tuple[str, Id, str], Fault] = {}
    of_id: dict[Id, list[Fault]] = defaultdict(list)
    for fault in sorted(findings, key=lambda fault: fault.order):
        if worst.setdefault((fault.rule, fault.id, fault.column if fault.id == "" else ""), fault) is fault:
            of_id[fault.id].append(fault)

    def stands(fault: Fault) -> bool:
        rule = RULES[fault.rule]
        of_set = (c for c in of_id[""] if fault.id in c.ids or c.value > settings.MOST_FEW)  # what few have is theirs
        causes = (c for c in (*of_id[fault.id], *of_set) if c.rule in rule.causes)
        return not any(rule.follows(fault, c) and stands(c) for c in causes)

    return [fault for fault in worst.values() if stands(fault)]
