"""The simulated cells that several scripts measure: environments, shares of bad demonstrations, numbers of them."""

from __future__ import annotations

import numpy as np

ENVIRONMENTS = ("MountainCar-v0", "Acrobot-v1", "LunarLander-v3")
SHARES = (50, 75, 90)
"""Percent of the demonstrations that are bad."""

N_GOOD = 10


def one_label_each(good: np.ndarray) -> dict[int, str]:
    """A label for the first of the `good` (M,) bool demonstrations, and one for the first of the others."""
    return {int(np.argmax(good)): "good", int(np.argmin(good)): "bad"}


def n_bad(share: int) -> int:
    """The number of bad demonstrations that makes up `share` percent beside `N_GOOD` good ones."""
    return round(N_GOOD * share / (100 - share))


def unknowable(kind: str, share: int) -> bool:
    """Whether the bad demonstrations agree with each other as well as the good ones do, and are at least as many."""
    return kind in ("flip", "shift") and share >= 50
