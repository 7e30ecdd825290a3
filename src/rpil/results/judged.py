"""The fields of an audit, each declared once: its type, its axis, what it is of a demonstration that is not judged, and
the name under which it is shown.

Selecting, joining, checking and showing audits (`rpil.results.tasks`, `soundness`, `AuditResult.facts`) are
loops over these fields.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from rpil.data.archive import stored
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.text import for_others, quoted
from rpil.inference.answers import Answers
from rpil.inference.settings import JudgeSettings
from rpil.numerics.types import Array, Bool, Float, Int
from rpil.results.vocabulary import VOCABULARIES, Anchor, Verdict, Vocabulary

PROVENANCE_KEY = "rpil.provenance"
"""Key of the provenance, as JSON, among the metadata of a Parquet file."""

_MOST_DIGESTED = 256 * 2**20
"""Bytes of a file that are all read for a digest."""


def provenance_of(
    command: str, seed: int, settings: Mapping[str, object], files: Iterable[StrPath | None]
) -> dict[str, object]:
    """How a result was made, for JSON: `settings` are those that are not the defaults, `files` the data and then other
    files, where given."""
    made = {"rpil": version("rpil"), "command": for_others(command), "seed": seed}
    return made | {"settings": settings, "files": [digest(path) for path in files if path is not None]}


def changed_settings(given: object, default: object, name: str = "") -> dict[str, object]:
    """The fields, by names with dots, in which two settings, records of the same kind, differ."""
    if is_dataclass(given) and type(given) is type(default):
        names = (field.name for field in fields(given))
        parts = (changed_settings(getattr(given, p), getattr(default, p), f"{name}.{p}".strip(".")) for p in names)
        return {key: value for part in parts for key, value in part.items()}
    plain = isinstance(given, str | int | None) or (isinstance(given, float) and math.isfinite(given))
    return {} if given == default else {name: given if plain else repr(given)}


def digest(path: StrPath) -> dict[str, str | int]:
    """Size and SHA-256 of a file; of a folder, the SHA-256 of the names and digests of its files, but for hidden ones.
    Files of more than 256 MiB in all count by names and sizes alone."""
    place, sha256 = Path(path), hashlib.sha256()
    inside = sorted(place.rglob("*")) if place.is_dir() else [place]
    shown = (file for file in inside if not any(part.startswith(".") for part in file.relative_to(place).parts))
    files = [file for file in shown if file.is_file()]
    n_bytes, found = sum(file.stat().st_size for file in files), sha256
    for file in files:
        found = hashlib.sha256(str(file.stat().st_size).encode())
        if n_bytes <= _MOST_DIGESTED:
            with file.open("rb") as content:
                found = hashlib.file_digest(content, "sha256")
        sha256.update(os.fsencode(file.relative_to(place).as_posix()) + b"\0" + found.digest())
    own = sha256 if place.is_dir() else found
    return {"path": for_others(str(path)), "bytes": n_bytes, "sha256": own.hexdigest() if files else ""}


MAX_LOG_RATIO = 50.0
"""Nats by which the log-ratio of a step is bounded where it is drawn: exp(50) is certain."""


@stored()
@dataclass(frozen=True)
class AuditSettings:
    """From probabilities to verdicts and step weights."""

    min_verdict_proba: float = 0.9
    """Probability from which the mixture with a named adversary calls a demonstration an expert's; an adversary's from
    one minus this down."""
    min_label_log_odds: float = 20.0
    """Nats. A label raises the log-odds to at least this: as good as certain. Chosen by hand, not tuned."""
    judge: JudgeSettings = JudgeSettings()
    """Settings of answers, of verdicts without answers and of steps; a fit puts its own here."""
    weighs_for_learner: bool = True
    """Whether weights of steps are those of `RPIL`, or those for other trainings; a fit puts its own here."""

    def min_proba(self, anchor: str) -> float:
        """The probability from which an audit with this `anchor` says that a demonstration is of the upper group."""
        if anchor == "named adversary":
            return self.min_verdict_proba
        return self.judge.answers.min_proba if anchor == "answers" else self.judge.outliers.min_proba


@dataclass(frozen=True)
class Interval:
    """A mean with a 95 % interval."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True)
class Demonstrator:
    """A demonstrator who gave several demonstrations; `Audit.verdict_counts` counts their verdicts."""

    name: Hashable
    trust: Interval | None
    """The share of good demonstrations, with its 95 % interval; None until two answers contrast."""
    demonstrations: tuple[Hashable, ...]
    """Their ids."""


MAX_DRAWN = 300
"""Demonstrations with drawings on a page: those that are most worth a look."""

MAX_POINTS = 400
"""Points of a curve over the steps of a demonstration; of more steps, each point is the mean over some of them."""

ALONE = "Not judged: it is the only demonstration of its task or session."
"""The reason for a verdict that is open for want of other demonstrations."""


def bin_starts(n_steps: int) -> Int[Array, " P"]:
    """The first step of each of at most `MAX_POINTS` points, which hold nearly equally many steps."""
    n_points = min(n_steps, MAX_POINTS)
    return np.asarray(np.arange(n_points) * n_steps // n_points)


def bin_means(values: Float[Array, " n"]) -> Float[Array, " P"]:
    """The means over the steps of each point."""
    starts = bin_starts(len(values))
    return np.asarray(np.add.reduceat(values, starts, dtype=float) / np.diff(np.append(starts, len(values))))


def of_each(axis: str, nothing: object = 0.0, shown: str = "") -> dict[str, object]:
    """Metadata of a field with a value for each demonstration ("M") or step ("N"); a row of one that is not judged is
    `nothing`. A column that is `shown` is a fact under this name: in tables, JSON and on the page."""
    return {"axis": axis, "nothing": nothing, "shown": shown}


OF_EACH, PROBABILITY, TEXT = of_each("M"), of_each("M", 0.5), of_each("M", "")


@dataclass(frozen=True, eq=False, repr=False)
class Judged:
    """The fields of `rpil.results.record.Audit`, which describes them."""

    ids: tuple[Hashable, ...]
    offsets: Int[Array, " _"]
    finding: str
    log_odds: Float[Array, " M"] = field(metadata=OF_EACH)
    from_actions: Float[Array, " M"] = field(metadata=OF_EACH)
    from_label: Float[Array, " M"] = field(metadata=OF_EACH)
    expert_proba: Float[Array, " M"] = field(metadata=PROBABILITY)
    reliability: Float[Array, " M"] = field(metadata=PROBABILITY)
    verdicts: tuple[Verdict, ...] = field(metadata=TEXT | {"nothing": "open"})
    step_log_ratio: Float[Array, " N"] = field(metadata=of_each("N"))
    step_weight: Float[Array, " N"] = field(metadata=of_each("N", 1.0))
    prior: Interval
    adversary: str
    columns: Float[Array, "M D"] = field(metadata=OF_EACH)
    claimed: Int[Array, " M"] = field(metadata=of_each("M", 0))
    part: Float[Array, " M"] = field(metadata=OF_EACH)
    copy_of: Int[Array, " M"]
    settings: AuditSettings
    answers: Answers
    identifiable: bool = True
    competing: tuple[tuple[Hashable, ...], ...] = ()
    pair: tuple[Hashable, ...] = ()
    method: tuple[str, ...] = ()
    demonstrators: tuple[Demonstrator, ...] = ()
    contradicting: tuple[Hashable, ...] = ()
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    deviations: tuple[str, ...] = field(default=(), metadata=TEXT)
    anchor: Anchor = "none"
    sessions: tuple[str, ...] = field(default=(), metadata=TEXT | {"shown": "session"})
    order: Float[Array, " M"] | None = field(default=None, metadata=OF_EACH)
    taken_over: Float[Array, " N"] | None = field(default=None, metadata=of_each("N"))
    own_reasons: tuple[str, ...] = field(default=(), metadata=TEXT | {"nothing": ALONE})
    rejected_by: tuple[str, ...] = field(default=(), metadata=TEXT)
    within: str = ""
    task_of: Int[Array, " M"] | None = field(default=None, metadata=of_each("M", -1))
    fps: float | None = None
    provenance: Mapping[str, Any] | None = None

    @property
    def vocabulary(self) -> Vocabulary:
        """The names of the verdicts, and the name and the meaning of `expert_proba`."""
        return VOCABULARIES[self.anchor]

    @property
    def told(self) -> str:
        """From where verdicts are learned, in words: outcomes, where nothing else is known."""
        known = self.answers
        by_outcomes = known.has_outcome.any() and not known.labels.any() and not len(known.compared)
        return "the outcomes" if by_outcomes else "your answers"

    @property
    def lengths(self) -> Int[Array, " M"]:
        """Steps of each demonstration."""
        return np.diff(self.offsets)

    def index(self, demonstration: Hashable) -> int:
        """Index of the demonstration with this id.

        Raises
        ------
        DataError
            If there is none.
        """
        if demonstration not in self.ids:
            raise DataError(f"No demonstration is called {demonstration!r}; choose from the ids {quoted(self.ids, 5)}.")
        return self.ids.index(demonstration)

    def steps(self, index: int) -> slice:
        """The rows of demonstration `index`."""
        return slice(int(self.offsets[index]), int(self.offsets[index + 1]))

    def log_ratio(self, index: int) -> Float[Array, " n"]:
        """Log-ratios of the steps of demonstration `index`, bounded: one impossible step is not all there is to say."""
        return np.asarray(np.clip(self.step_log_ratio[self.steps(index)], -MAX_LOG_RATIO, MAX_LOG_RATIO, dtype=float))


def failures(audit: Judged) -> Bool[Array, " M"]:
    """Demonstrations that an outcome rejects."""
    return np.asarray(np.array(audit.rejected_by or [""] * len(audit.ids)) == "outcome")


def table_fields(kind: type[Judged]) -> Iterator[tuple[str, str, Any]]:
    """The columns of an audit: the name of each field with an axis, the axis, M or N, and what stands for nothing."""
    for one in fields(kind):
        if "axis" in one.metadata:
            yield one.name, one.metadata["axis"], one.metadata["nothing"]
