"""What the options of a command say of demonstrations: answers, demonstrators, facts, and others that are good."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING

from rpil.cli.options import FitOptions

if TYPE_CHECKING:
    from rpil.estimators.within_tasks import Known
    from rpil.formats.recording import Recording


def read_known(recording: Recording, options: FitOptions, reference: Recording | None = None) -> Known:
    """What the files of the options and the columns of the data say."""
    import numpy as np

    from rpil import formats
    from rpil.data.facts import check_outcome
    from rpil.data.id_values import check_ids
    from rpil.estimators.within_tasks import Known

    ids = recording.demonstrations.ids
    labels, pairs = formats.read_answers(options.labels) if options.labels else ({}, [])
    # The estimator checks these ids too, but cannot name the file.
    check_ids([*labels, *chain.from_iterable(pairs)], ids, str(options.labels), "the labels")
    demonstrators = formats.read_demonstrators(options.operator, recording) if options.operator else {}
    check_ids(demonstrators, ids, str(options.operator), "the demonstrators")
    facts, source = recording.facts, recording.description.source
    known = Known(labels, pairs, demonstrators, facts, answers_source=str(options.labels))
    if reference is not None:
        good = reference.demonstrations.select(slice(None))  # in memory
        known = replace(known, reference=good, reference_outcome=reference.facts.outcome)
    if facts.outcome is not None:  # neither can the estimator name the column
        others = [] if known.reference_outcome is None else [known.reference_outcome]
        check_outcome(np.concatenate([facts.outcome, *others]), f"the outcome {facts.outcome_name!r}", source)
    return known
