"""What commands share: reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

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

    model = RPIL(features=features, adversary=adversary, labels=known or None, random_state=seed, progress=progress)
    if boxed:
        warnings.simplefilter("ignore", AmbiguousWarning)
    return model.fit(demonstrations, demonstrators=who)
