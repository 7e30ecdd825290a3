"""What the options of a command say of demonstrations: answers, demonstrators, facts, and others that are good."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING

from rpil.cli.options import FitOptions

if TYPE_CHECKING:
    from rpil.data.demonstrations import Demonstrations
    from rpil.data.facts import Facts
    from rpil.data.id_values import Label, Pair
    from rpil.formats.recording import Recording
    from rpil.numerics.types import Array


@dataclass(frozen=True, eq=False)
class Given:
    """What is known of the demonstrations of a fit beside their steps; answers and demonstrators by ids as text."""

    labels: Mapping[str, Label]
    pairs: Sequence[Pair]
    demonstrators: Mapping[str, str]
    facts: Facts
    reference: Demonstrations | None = None
    reference_outcome: Array | None = None

    @property
    def answers(self) -> list[tuple[str, str]]:
        """Labels and pairs as ids and words."""
        from rpil.data.id_values import better_than

        return [*self.labels.items(), *((better, better_than(worse)) for better, worse in self.pairs)]

    @classmethod
    def read(cls, recording: Recording, options: FitOptions, reference: Recording | None = None) -> Given:
        """What the files of the options and the columns of the data say."""
        import numpy as np

        from rpil import formats
        from rpil.data.facts import check_outcome
        from rpil.data.id_values import check_ids

        ids = recording.demonstrations.ids
        labels, pairs = formats.read_answers(options.labels) if options.labels else ({}, [])
        # The estimator checks these ids too, but cannot name the file.
        check_ids([*labels, *chain.from_iterable(pairs)], ids, str(options.labels), "the labels")
        demonstrators = formats.read_demonstrators(options.operator, recording) if options.operator else {}
        check_ids(demonstrators, ids, str(options.operator), "the demonstrators")
        facts, source = recording.facts, recording.description.source
        given = cls(labels, pairs, demonstrators, facts)
        if reference is not None:
            good = reference.demonstrations.select(slice(None))  # in memory
            given = replace(given, reference=good, reference_outcome=reference.facts.outcome)
        if facts.outcome is not None:  # neither can the estimator name the column
            others = [] if given.reference_outcome is None else [given.reference_outcome]
            check_outcome(np.concatenate([facts.outcome, *others]), f"the outcome {facts.outcome_name!r}", source)
        return given

    def select(self, rows: Sequence[int], ids: Set[str]) -> Given:
        """What is known of the demonstrations at `rows`, which are called `ids`; pairs of which both are among them."""
        return replace(
            self,
            labels={m: label for m, label in self.labels.items() if m in ids},
            pairs=[pair for pair in self.pairs if ids >= {*pair}],
            demonstrators={m: name for m, name in self.demonstrators.items() if m in ids},
            facts=self.facts.select(rows),
        )

    def with_good(self, ids: Sequence[str]) -> Given:
        """The same after the reference was appended: the `ids` of its demonstrations are labelled as good."""
        import numpy as np

        outcome, of_reference = self.facts.outcome, self.reference_outcome
        if outcome is not None and of_reference is not None:
            outcome = np.concatenate([outcome, of_reference])
        labels: dict[str, Label] = {**self.labels, **dict.fromkeys(ids, "good")}
        # No file states the order of two recordings.
        return replace(self, labels=labels, facts=replace(self.facts, outcome=outcome, order=None), reference=None)
