"""Figures 1-7: Mountain Car, position against velocity, coloured by action.

Figures 1, 2 and 5 are data, as the learner sees them. The others are policies: what each does in 20 episodes of its
own, over a pale map of what it would do elsewhere.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from options import make_folder
from rpil.data.demonstrations import Demonstrations
from rpil.data.files import replacing
from rpil.results.vocabulary import COLOURS
from rpil.simulation.rollouts import record
from rpil.simulation.simulate import simulate
from study.experiments import EXPERIMENTS, N_BAD, N_GOOD, ours, paper_recipe, raw_trust_all

CAR = "MountainCar-v0"
ACTIONS = ("push left", "no push", "push right")
# The two that the expert uses are the two that differ most, also for readers with a colour deficiency.
ACTION_COLOURS = (COLOURS["upper"], COLOURS["open"], "#e69f00")
EPISODES = 20
_POSITIONS, _VELOCITIES = (-1.23, 0.6), (-0.07, 0.07)
_FLAG = 0.5
_GRID = 240
_DPI = 150


def draw(folder: str | os.PathLike[str], *, seed: int) -> list[Path]:
    """Write Figures 1-7 as PNG to a folder, which is made where it is missing, and return the files; `seed` is that of
    the demonstrations: the first one of the tables shows their first draw."""
    folder, paths = make_folder(folder), []

    def save(figure: Any, name: str) -> None:
        with replacing(folder / f"{name}.png") as path:
            figure.savefig(path, dpi=_DPI)
        paths.append(folder / f"{name}.png")

    made = simulate(CAR, "corrupted", n_good=N_GOOD + N_BAD, n_bad=0, seed=seed)
    title = f"Figure 1. {N_GOOD + N_BAD} demonstrations of the expert"
    save(_car([(title, None, *_steps(made.episodes))]), "figure-1-expert")
    for first, experiment in zip((2, 5), (e for e in EXPERIMENTS if e.env_id == CAR), strict=True):
        kind = experiment.kind
        made = simulate(CAR, kind, n_good=N_GOOD, n_bad=N_BAD, seed=seed)
        demonstrations = Demonstrations.from_episodes(made.episodes)
        title = f"Figure {first}. {N_GOOD} demonstrations of the expert and {N_BAD} {kind} ones"
        save(_car([(title, None, *_steps(made.episodes))]), f"figure-{first}-{kind}")
        all_, recipe, default = (m(demonstrations, experiment, seed) for m in (raw_trust_all, paper_recipe, ours))
        title = f"Figure {first + 1}. The policy that trusts all of them"
        save(_car([_played(title, all_, seed)]), f"figure-{first + 1}-{kind}-trust-all")
        title = f"Figure {first + 2}. R-PIL, the paper's recipe"
        panels = [_played(title, recipe, seed), _played("R-PIL, this library's default", default, seed)]
        save(_car(panels), f"figure-{first + 2}-{kind}-rpil")
    return paths


Panel = tuple[str, Any, NDArray[Any], NDArray[Any]]
"""Title, policy or None, observations (N, 2), actions (N,)."""


def _steps(episodes: Sequence[tuple[NDArray[Any], NDArray[Any]]]) -> tuple[NDArray[Any], NDArray[Any]]:
    observations, actions = zip(*episodes, strict=True)
    return np.concatenate(observations), np.concatenate(actions)


def _played(title: str, policy: Any, seed: int) -> Panel:
    """What a policy does in episodes of its own, with their mean return in the title."""
    episodes = record(policy, CAR, n_episodes=EPISODES, seed=seed)
    mean = np.mean([episode.rewards.sum() for episode in episodes])
    steps = _steps([(episode.observations, episode.actions) for episode in episodes])
    number = f"{mean:.1f}".replace("-", "\N{MINUS SIGN}")
    return f"{title}\n{EPISODES} episodes, mean return {number}", policy, *steps


def _figure(width: float, height: float) -> Any:
    from matplotlib.figure import Figure

    # A Figure of our own, not pyplot's: the caller's backend and open figures are left alone.
    return Figure(figsize=(width, height), layout="constrained")


def _car(panels: Sequence[Panel]) -> Any:
    """Steps over position and velocity, one panel beside the other."""
    from matplotlib.colors import ListedColormap
    from matplotlib.lines import Line2D

    figure = _figure(0.8 + 5.2 * len(panels), 4.6)
    axes = figure.subplots(1, len(panels), sharex=True, sharey=True, squeeze=False)[0]
    colours: Any = {"cmap": ListedColormap(ACTION_COLOURS), "vmin": -0.5, "vmax": 2.5}
    for ax, (title, policy, observations, actions) in zip(axes, panels, strict=True):
        if policy is not None:
            sides = (np.linspace(*ends, _GRID) for ends in (_POSITIONS, _VELOCITIES))
            points = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
            pale = {"alpha": 0.16, "origin": "lower", "aspect": "auto", "extent": (*_POSITIONS, *_VELOCITIES)}
            ax.imshow(policy.predict(points).reshape(_GRID, _GRID), interpolation="nearest", **pale, **colours)
        ax.scatter(*observations.T, c=actions, s=7, linewidths=0, **colours)
        ax.axvline(_FLAG, color=COLOURS["open"], linewidth=1, linestyle=(0, (4, 3)))
        ax.text(_FLAG - 0.015, _VELOCITIES[0] * 0.97, "flag", ha="right", color=COLOURS["open"], fontsize="small")
        ax.set_title(title, loc="left", fontsize="medium")
        ax.set(xlim=_POSITIONS, ylim=_VELOCITIES, xlabel="Position", xticks=(-1.2, -0.8, -0.4, 0.0, 0.4))
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("Velocity")
    handles = [
        Line2D([], [], marker="o", linestyle="none", color=colour, label=name)
        for colour, name in zip(ACTION_COLOURS, ACTIONS, strict=True)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, handletextpad=0.2)
    return figure
