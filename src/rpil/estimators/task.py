"""The demonstrations that an estimator is fitted to, checked once, and the data of a fit to some of them."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rpil.data.coding import action_space, encode_actions, label_codes
from rpil.data.demonstrations import Demonstrations
from rpil.data.demonstrators import Demonstrators, group_by_demonstrator
from rpil.data.errors import DataError
from rpil.data.facts import Outcome, given_order, given_outcome
from rpil.data.fit_data import FitData
from rpil.data.id_values import match_pairs, parse_labels
from rpil.data.spaces import Space
from rpil.formats.dataset import Dataset
from rpil.inference.answers import Answers
from rpil.numerics.types import Array, Float, Int
from rpil.policies.features import FeatureMap, IdentityMap
from rpil.policies.protocol import CrossFittedPolicy, Policy

ActionBox = tuple[ArrayLike, ArrayLike]
Features = FeatureMap | IdentityMap
FinalPolicy = Policy | CrossFittedPolicy
Labels = Mapping[Any, str] | Sequence[tuple[Hashable, str]]
DemonstratorNames = Mapping[Any, Hashable] | Sequence[Hashable]


@dataclass(frozen=True, eq=False)
class Task:
    """The demonstrations of a fit, checked."""

    source: Demonstrations | Dataset
    space: Space
    classes: Array
    """The discrete actions, or an empty array."""
    labels: Array
    """1 known to be good, -1 known to be bad, 0 unknown."""
    demonstrators: Demonstrators
    outcome: Float[Array, " M"] | None = None
    """How each demonstration ended, more is better; NaN where it is not known, None where nothing is."""
    order: Float[Array, " M"] | None = None
    """The place of each demonstration in the order in which they were made, where that is stated."""
    pairs: Int[Array, "P 2"] = field(default_factory=lambda: np.empty((0, 2), dtype=int))
    """The better and the worse demonstration of each pair that was compared."""
    tied: Int[Array, "T 2"] = field(default_factory=lambda: np.empty((0, 2), dtype=int))
    """The two demonstrations of each pair without a difference."""

    @property
    def answers(self) -> Answers:
        """All that is known of the demonstrations."""
        unknown = np.full(len(self.labels), np.nan)
        return Answers(self.labels, self.pairs, unknown if self.outcome is None else self.outcome, self.tied)

    @classmethod
    def of(
        cls,
        source: Demonstrations | Dataset,
        action_box: ActionBox | None = None,
        labels: Labels | None = None,
        demonstrators: DemonstratorNames | None = None,
        outcome: Outcome | None = None,
        order: Sequence[float] | Array | None = None,
    ) -> Task:
        """Find the space of the actions; match what is given of the demonstrations with them."""
        space, classes = action_space(source, action_box)
        if len(source.ids) < 2:
            raise DataError(
                f"{source.source}: one demonstration alone (n_samples=1) cannot be compared; give at least two."
            )
        groups = group_by_demonstrator(demonstrators, source)
        known = given_outcome(outcome, source.ids, source.source), given_order(order, source.ids, source.source)
        by_id, pairs = parse_labels(labels, source.ids)
        compared = match_pairs(pairs.items(), source.ids)
        return cls(source, space, classes, label_codes(by_id, source), groups, *known, *compared)

    def codes(self, demonstrations: Demonstrations) -> Array:
        """Codes (N,) of discrete actions, or continuous actions (N, A)."""
        return encode_actions(self.classes, demonstrations.actions, demonstrations.source)

    def data(self, demonstrations: Demonstrations, features: Features, single: bool = False) -> FitData:
        """The data of a fit to some of the demonstrations, without labels and demonstrators."""
        design, codes = features.design(demonstrations.observations, single=single), self.codes(demonstrations)
        no_labels = np.zeros(len(demonstrations), dtype=int)
        names = tuple(map(str, self.classes.tolist())) or demonstrations.action_names
        return FitData(design, codes, demonstrations.offsets, self.space, no_labels, action_names=names)
