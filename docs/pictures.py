"""The pictures of docs/policies.md: small made-up demonstrations, everything seeded.

python docs/pictures.py            # writes them beside this file; takes a minute, most of it boosting
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # boosting on so little data only waits for its threads

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingClassifier

from rpil import RPIL, Demonstrations, Settings
from rpil.results.vocabulary import COLOURS, SIDES

Array = NDArray[Any]
N_ACTIONS = 4
ACTION_COLOURS = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#f0e442", "#7f8790")
ADVERSARIES = ("auto", "uniform", "marginal", "normalised complement", "confusion", "own policy")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent, help="a folder")
    folder = parser.parse_args().output
    for name, draw in PICTURES.items():
        figure = draw()
        figure.savefig(folder / f"{name}.png", dpi=90, metadata={"Software": None})
        plt.close(figure)
        print(f"{name}.png: {(folder / f'{name}.png').stat().st_size / 1000:.0f} kB")


# ---- what each adversary says of the same demonstrations -------------------------------------------------------------


def quadrants(observations: Array) -> Array:
    """The expert's action: one for each quadrant."""
    return 2 * (observations[:, 0] > 0) + (observations[:, 1] > 0)


def any_key(expert: Array, rng: np.random.Generator) -> Array:
    return rng.integers(N_ACTIONS, size=len(expert))


def favourites(expert: Array, rng: np.random.Generator) -> Array:
    return rng.choice(N_ACTIONS, size=len(expert), p=[0.7, 0.1, 0.1, 0.1])


def anything_else(expert: Array, rng: np.random.Generator) -> Array:
    return (expert + rng.integers(1, N_ACTIONS, size=len(expert))) % N_ACTIONS


def mistaken_key(expert: Array, rng: np.random.Generator) -> Array:
    return np.where(rng.random(len(expert)) < 0.6, (expert + 1) % N_ACTIONS, expert)


BAD: dict[str, Callable[[Array, np.random.Generator], Array]] = {
    "any key": any_key,
    "favourite key": favourites,
    "anything else": anything_else,
    "mistakes a key": mistaken_key,
}


def several_sorts(n_good: int = 10, n_each: int = 4, n_steps: int = 12) -> tuple[Demonstrations, list[str]]:
    """Experts, one action in twenty being a slip, and bad demonstrations of several sorts."""
    rng = np.random.default_rng(0)
    sorts = ["expert"] * n_good + [sort for sort in BAD for _ in range(n_each)]
    episodes = []
    for sort in sorts:
        observations = rng.normal(size=(n_steps, 2))
        expert = quadrants(observations)
        slips = rng.random(n_steps) < 0.05
        expert = np.where(slips, rng.integers(N_ACTIONS, size=n_steps), expert)
        episodes.append((observations, BAD[sort](expert, rng) if sort in BAD else expert))
    return Demonstrations.from_episodes(episodes), sorts


def opinions(names: Sequence[str] = ADVERSARIES) -> tuple[dict[str, Any], list[str]]:
    """The audit under each adversary, and what the demonstrations are."""
    demonstrations, sorts = several_sorts()
    return {name: RPIL(adversary=name).fit(demonstrations).audit_ for name in names}, sorts


def adversaries() -> Any:
    found, sorts = opinions()
    figure, axes = plt.subplots(2, 3, figsize=(9, 4.6), sharex=True, sharey=True, layout="constrained")
    kinds = list(dict.fromkeys(sorts))
    row = np.array([kinds.index(sort) for sort in sorts])
    shift = np.array([sorts[:m].count(sort) / sorts.count(sort) for m, sort in enumerate(sorts)])
    for ax, (name, audit) in zip(axes.flat, found.items(), strict=True):
        colours = [COLOURS[SIDES[verdict]] for verdict in audit.verdicts]
        ax.axvline(0, color="#c8ccd0", linewidth=1)
        ax.scatter(audit.log_odds, row + 0.6 * (shift - 0.4), c=colours, s=16)
        ax.set_title(f'"{name}"' + (f": {audit.adversary}" if name == "auto" else ""), fontsize=10)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_yticks(range(len(kinds)), kinds)
    axes[0, 0].invert_yaxis()
    for ax in axes[1]:
        ax.set_xlabel("log-odds")
    for side, verdict in zip(COLOURS, ("expert", "open", "adversary"), strict=True):
        axes[0, 2].scatter([], [], c=COLOURS[side], s=16, label=verdict)
    axes[0, 2].legend(frameon=False, fontsize=8, loc="center right")
    return figure


# ---- a linear policy, and flexible policies -----------------------------------------------------------------------


def ring(observations: Array) -> Array:
    """The expert's action: 0 within, 1 on and 2 outside a ring."""
    return np.digitize(np.hypot(*observations.T), [0.8, 1.5])


def ring_demonstrations() -> tuple[Demonstrations, Array]:
    """Twelve experts, and eight who do anything."""
    rng, n_steps = np.random.default_rng(0), 60
    good = np.arange(20) < 12
    episodes = []
    for expert in good:
        observations = rng.normal(size=(n_steps, 2))
        episodes.append((observations, ring(observations) if expert else rng.integers(3, size=n_steps)))
    return Demonstrations.from_episodes(episodes), good


RIVALS: dict[str, Callable[[], RPIL]] = {
    "a straight line": lambda: RPIL(settings=Settings(judge_features="raw")),
    'features="auto"': lambda: RPIL(features="auto"),
    "gradient boosting": lambda: RPIL(policy=HistGradientBoostingClassifier(max_iter=10, random_state=0)),
}


def policies() -> Any:
    demonstrations, good = ring_demonstrations()
    figure, axes = plt.subplots(1, 4, figsize=(10, 3), sharex=True, sharey=True, layout="constrained")
    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 80), np.linspace(-3, 3, 80)), axis=-1)
    draw_map(axes[0], ring(grid.reshape(-1, 2)), "the expert")
    for ax, (name, make) in zip(axes[1:], RIVALS.items(), strict=True):
        model = make().fit(demonstrations)
        draw_map(ax, model.predict(grid.reshape(-1, 2)), f"{name}\n{count_outliers(model, good)}")
    return figure


def draw_map(ax: Any, actions: Array, title: str) -> None:
    colours = matplotlib.colors.ListedColormap(ACTION_COLOURS[:3])
    ax.imshow(actions.reshape(80, 80), extent=(-3, 3, -3, 3), origin="lower", cmap=colours, vmin=0, vmax=2, alpha=0.8)
    ax.set_title(title, fontsize=10)
    ax.set_xticks([])
    ax.set_yticks([])


def count_outliers(model: RPIL, good: Array) -> str:
    """How many of the bad demonstrations, and of the good ones, are outliers, in words."""
    is_outlier = np.array(model.audit_.verdicts) == "outlier"
    return f"outliers: {is_outlier[~good].sum()} bad, {is_outlier[good].sum()} good"


# ---- how much of a demonstration is good -----------------------------------------------------------------------------


def partly_bad() -> tuple[Demonstrations, Array]:
    """Sixteen demonstrations whose last steps are random from earlier and earlier on, and the share of actions that
    are the expert's nevertheless, (16,)."""
    rng, n_steps = np.random.default_rng(0), 120
    episodes, right = [], []
    for good in np.concatenate([np.ones(9), np.linspace(0.9, 0.0, 7)]):
        observations = rng.normal(size=(n_steps, 2))
        bad = np.arange(n_steps) >= good * n_steps
        expert = quadrants(observations)
        actions = np.where(bad, rng.integers(N_ACTIONS, size=n_steps), expert)
        right.append((actions == expert).mean())
        episodes.append((observations, actions))
    return Demonstrations.from_episodes(episodes), np.array(right)


def reliability() -> Any:
    demonstrations, right = partly_bad()
    audit = RPIL().fit(demonstrations).audit_
    figure, ax = plt.subplots(figsize=(6.4, 3.8), layout="constrained")
    audit.plot.ranking(ax=ax)
    order = audit.ranking()
    # A random action is sometimes the right one: the share of right actions is above the share of good steps.
    ax.plot(right[order], range(len(order)), "|", color="black", markersize=9, label="actions that are the expert's")
    ax.legend(frameon=False, fontsize=9, loc="upper left")
    ax.set_yticks([])
    return figure


PICTURES: dict[str, Callable[[], Any]] = {
    "adversaries": adversaries,
    "policies": policies,
    "reliability": reliability,
}

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
