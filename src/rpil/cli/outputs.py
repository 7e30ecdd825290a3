"""The files that ``rpil audit`` writes beside what it prints."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from rpil.cli.commands import tell_if_interrupted
from rpil.cli.progress import StageProgress

if TYPE_CHECKING:
    from rpil.audit.record import Audit
    from rpil.data.formats.recording import Recording

OUTPUTS = ("weights", "verdicts", "keep", "report")
"""The options that name these files, in the order in which they are written."""


def write_outputs(
    paths: Mapping[str, str | None],
    audit: Audit,
    recording: Recording,
    demonstrators: Mapping[str, str],
    source: str,
    seconds: float,
    progress: StageProgress,
) -> None:
    """Write the files of `OUTPUTS` whose paths are given; `source` is the path of the data, read in `seconds`."""
    from rpil.audit.verdict_table import write_kept, write_verdicts
    from rpil.data.formats.weights import write_weights

    def write_report(path: str) -> None:
        from markupsafe import Markup

        from rpil.audit.html.page import Article, write_page

        read = "What was read", Markup("<p>%s</p>") % Markup("<br>").join(recording.description.short())
        write_page(path, [Article(f"Audit of {Path(source).name}", audit, source, sections=[read], seconds=seconds)])

    def write_keep(path: str) -> None:
        write_kept(path, audit)
        if "expert" not in audit.verdicts:
            warnings.warn(f"{path}: no demonstration has the verdict expert, so that it lists none.", stacklevel=1)

    steps = audit.ids, audit.offsets, audit.step_weight, audit.expert_proba, audit.log_odds
    writers: dict[str, Callable[[str], None]] = {
        "weights": lambda path: write_weights(path, *steps, recording.step_columns),
        "verdicts": lambda path: write_verdicts(path, audit, demonstrators),
        "keep": write_keep,
        "report": write_report,
    }
    for title in OUTPUTS:
        path = paths[title]
        if path is not None:
            progress(f"writing {path}")
            writers[title](path)
            tell_if_interrupted(f"{path} is written")
