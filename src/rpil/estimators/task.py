"""The demonstrations that an estimator is fitted to, checked once, and the data of a fit to some of them."""

from __future__ import annotations

import os
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, count
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rpil.data import fit_data, id_values
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import StrPath
from rpil.data.fit_data import DemonstratorNames, Demonstrators, FitData, Outcome
from rpil.data.spaces import Space, action_space, encode_actions
from rpil.data.text import quoted
from rpil.formats.columns import Names
from rpil.formats.format import Dataset
from rpil.inference.answers import Answers
from rpil.numerics.types import Array, Float

if TYPE_CHECKING:
    from rpil.policies.cross_fitted import CrossFittedPolicy, IdentityMap
    from rpil.policies.features import FeatureMap
    from rpil.policies.linear import LinearPolicy

    Features = FeatureMap | IdentityMap
    FinalPolicy = LinearPolicy | CrossFittedPolicy

Labels = Mapping[Any, str] | Sequence[tuple[Hashable, str]]


def answers_of(
    labels: Labels | StrPath | None,
    outcome: Outcome | Names | StrPath | None,
    demonstrations: Demonstrations | Dataset,
    ids: Sequence[Hashable] = (),
) -> Answers:
    """The answers of a user about demonstrations, from words and outcomes by id, or from files of them, but for those
    about others of the `ids`, which were not read. A `DataError` names an unknown id or word."""
    read, every = demonstrations.ids, ids or demonstrations.ids
    is_file = isinstance(labels, str | os.PathLike)
    source, named = (str(labels), Path(str(labels)).name) if is_file else (demonstrations.source, "the labels")
    rows = id_values.read_answer_rows(cast(StrPath, labels)) if is_file else id_values.label_rows(labels)
    by_id, pairs = id_values.parse_answers(rows, named)
    id_values.check_ids([*(row.id for row in rows), *chain.from_iterable(pairs)], every, source, "the labels")
    marks = id_values.parse_marks(rows, named, read, demonstrations.lengths)
    chosen = {*map(str, read)}
    better, tied = id_values.match_pairs(((pair, word) for pair, word in pairs.items() if chosen >= {*pair}), read)
    signs = id_values.label_signs(by_id, read)
    paths = names_of(outcome)
    stems = [Path(path).stem for path in paths]
    given: dict[str, Outcome | str] = {} if paths or outcome is None else {"outcome": cast(Outcome, outcome)}
    given |= {stem if stems.count(stem) == 1 else path: path for stem, path in zip(stems, paths, strict=True)}
    outcomes = [fit_data.given_outcome(one, read, demonstrations.source, every) for one in given.values()]
    known = np.column_stack([np.empty((len(read), 0)), *outcomes])
    answers = Answers(signs, better, known, tied, tuple(given), marks=marks)
    if len(marks) and answers.bad_rows(demonstrations.offsets).all():
        raise DataError(f"{named}: every row is called bad, and none is left to learn from; label fewer of them.")
    return answers


def names_of(outcome: object) -> tuple[str, ...]:
    """The outcomes that are columns or files; none where they are numbers."""
    given = outcome if isinstance(outcome, list | tuple) else [outcome]
    paths = [os.fspath(one) for one in given if isinstance(one, str | os.PathLike)]
    return tuple(paths) if len(paths) == len(given) else ()


@dataclass(frozen=True, eq=False)
class Task:
    """The demonstrations of a fit, checked, and what is known of them."""

    source: Demonstrations | Dataset
    space: Space
    classes: Array
    """The discrete actions, or an empty array."""
    answers: Answers
    demonstrators: Demonstrators
    taken_over: Float[Array, " N"] | None = None
    """See `rpil.results.record.Audit`."""

    @classmethod
    def of(
        cls,
        source: Demonstrations | Dataset,
        answers: Answers | None = None,
        demonstrators: DemonstratorNames | None = None,
    ) -> Task:
        """Find the space of the actions; match what is given of the demonstrations with them."""
        space, classes = action_space(source)
        if len(source.ids) < 2:
            alone = f"all steps are of demonstration {source.ids[0]!r:.40}, and one demonstration alone (1 sample)"
            raise DataError(f"{source.source}: {alone} cannot be compared; give at least two.")
        groups = fit_data.group_by_demonstrator(demonstrators, source)
        return cls(source, space, classes, answers or Answers.none(len(source.ids)), groups)

    @cached_property
    def demonstrations(self) -> Demonstrations:
        """All demonstrations, in memory."""
        return self.source if isinstance(self.source, Demonstrations) else self.source.select(slice(None))

    def codes(self, demonstrations: Demonstrations) -> Array:
        """Codes (N,) of discrete actions, or continuous actions (N, A)."""
        return encode_actions(self.classes, demonstrations.actions, demonstrations.source)

    def data(self, demonstrations: Demonstrations, features: Features, single: bool = False) -> FitData:
        """The data of a fit to some of the demonstrations, without labels."""
        design, codes = features.design(demonstrations.observations, single=single), self.codes(demonstrations)
        names = tuple(map(str, self.classes.tolist())) or demonstrations.action_names
        return FitData(design, codes, demonstrations.offsets, self.space, action_names=names)


def with_reference(one: Demonstrations, other: Demonstrations) -> Demonstrations:
    """The demonstrations `one`, and after them the reference, the `other`; all ids are text, and no two are alike.

    A `DataError` where the two have other observations or actions.
    """
    missing = [name for name in one.observation_names if name not in other.observation_names]
    more = [name for name in other.observation_names if name not in one.observation_names]
    if missing or more:
        lacks = f"lacks {quoted(missing, 5)}" if missing else f"has {quoted(more, 5)} too"
        remedy = "name the same ones with --observations or --exclude"
        raise DataError(f"{other.source}: its observations are not those of {one.source}: it {lacks}; {remedy}.")
    columns = [other.observation_names.index(name) for name in one.observation_names]
    kinds = [_kind_of_action(each) for each in (one, other)]
    if kinds[0] != kinds[1]:
        said = f"its actions are {kinds[1]}, and those of {one.source} are {kinds[0]}"
        remedy = "give a reference with the same actions, or say what they are with --action or --action-kind"
        raise DataError(f"{other.source}: {said}; {remedy}.")
    prefixes = chain(["reference "], (f"reference {k} " for k in count(2)))
    prefix = next(p for p in prefixes if not any(str(name).startswith(p) for name in one.ids))
    return replace(
        one,
        observations=np.concatenate([one.observations, other.observations[:, columns]]),
        actions=np.concatenate([one.actions, other.actions]),
        offsets=np.concatenate([one.offsets, one.n_steps + other.offsets[1:]]),
        ids=(*map(str, one.ids), *(f"{prefix}{name}" for name in other.ids)),
    )


def _kind_of_action(demonstrations: Demonstrations) -> str:
    """A name for the kind of the actions, alike where they can be judged together."""
    if demonstrations.is_discrete:
        return "discrete text" if demonstrations.actions.dtype.kind == "U" else "discrete numbers"
    names = demonstrations.action_names
    return f"{demonstrations.n_actions} continuous numbers{f' ({quoted(names, 5)})' * bool(names)}"
