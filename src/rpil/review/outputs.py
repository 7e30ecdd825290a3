"""The files of a review that ends: what to keep, verdicts and weights, beside the labels."""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.data.files import check_outputs
from rpil.formats.registry import find, suffixes
from rpil.formats.weights import write_weights
from rpil.results.verdict_table import kept, write_kept, write_verdicts

if TYPE_CHECKING:
    from rpil.formats.recording import Recording
    from rpil.results.record import Audit
    from rpil.results.view import About

KEEP, VERDICTS, STEP_WEIGHTS = "keep.json", "verdicts.csv", "weights.parquet"


def write_beside(labels: str, source: str, audit: Audit, about: About, recording: Recording) -> Iterator[str]:
    """Write the files beside that of the labels; sentences on each, and what to run then.

    A `DataError`, before anything is written, where one cannot be, or would join the data at `source`.
    """
    keep, verdicts, weights = (str(Path(labels).with_name(name)) for name in (KEEP, VERDICTS, STEP_WEIGHTS))
    check_outputs([source], [keep, verdicts, weights], suffixes() if Path(source).is_dir() else [])
    write_kept(keep, audit)
    chosen = kept(audit)
    yield f"{keep}: {len(chosen):,} of {len(audit.ids):,} demonstrations to keep."
    findings = about.faults.findings if about.faults else ()
    write_verdicts(verdicts, audit, about.demonstrators, findings, about.tasks)
    yield f"{verdicts}: a row for each demonstration."
    steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
    write_weights(weights, *steps, recording.step_columns)
    yield f"{weights}: a weight for each step."
    yield f"To judge again with these answers: {about.command} --labels {shlex.quote(labels)}"
    if chosen:
        yield from find(source).commands_to_keep(recording.ids or audit.ids, chosen, keep)
