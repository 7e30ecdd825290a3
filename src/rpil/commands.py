"""What commands share: reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import click

from rpil.errors import DataError
from rpil.terminal import Stages

if TYPE_CHECKING:
    from rpil.demonstrations import Demonstrations
    from rpil.estimators import RPIL


def read(file: str, progress: Stages) -> Demonstrations:
    """The demonstrations in a file."""
    from rpil import formats

    progress(f"reading {file}")
    return formats.read(file)


def fit_rpil(
    file: str,
    demonstrations: Demonstrations,
    progress: Stages,
    *,
    boxed: bool,
    labels: str | None,
    demonstrators: str | None,
    features: str,
    adversary: str,
    seed: int,
    resume: bool,
) -> RPIL:
    """RPIL with the options of the command; `boxed` where a box will say what cannot be known."""
    from rpil import formats
    from rpil.formats.table import check_ids

    known = formats.read_labels(labels) if labels else {}
    # Also done by the estimator, which cannot name the file.
    formats.match_labels(known, demonstrations.ids, str(labels))
    who = formats.read_demonstrators(demonstrators, file) if demonstrators else None
    check_ids(who or (), demonstrations.ids, str(demonstrators), "the demonstrators")
    progress("starting")
    from rpil.estimators import RPIL, AmbiguousWarning

    so_far = Path(f"{Path(file).name}.rpil-checkpoint")  # where the command runs: the data may lie where nobody writes
    if so_far.exists() != resume:
        said = (
            "nothing was interrupted here; leave out" if resume else "a run was interrupted; delete it, or go on with"
        )
        raise DataError(f"{so_far}: {said} --resume.")
    model = RPIL(
        features=features,
        adversary=adversary,
        labels=known or None,
        random_state=seed,
        progress=progress,
        checkpoint=so_far,
    )
    if boxed:
        warnings.simplefilter("ignore", AmbiguousWarning)
    try:
        return model.fit(demonstrations, demonstrators=who)
    except KeyboardInterrupt:
        if so_far.exists():
            click.echo(f"rpil: what was done is kept in {so_far}; the same command with --resume goes on.", err=True)
        raise
