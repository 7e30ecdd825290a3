"""The outside worlds: what they record repeats, the truth is true, and what is driven follows the weights."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from rpil_outside.world import World
from rpil_outside.worlds import WORLDS, intersection, overcooked, push2d

PLAIN = ("push2d", "intersection", "early_release")
"""They need NumPy alone."""


def installed(name: str) -> World:
    world = WORLDS[name]
    missing = [module for module in world.needs if find_spec(module) is None]
    if missing:
        pytest.skip(f"{missing[0]} is not installed: pip install -e 'benchmarks/outside[{name}]'")
    if name == "overcooked" and not overcooked.folder().is_dir():
        pytest.skip("the recorded trials are not here; RPIL_DATA names their folder")
    return world


@pytest.mark.parametrize(
    "name", [*PLAIN, *(pytest.param(name, marks=pytest.mark.slow) for name in WORLDS if name not in PLAIN)]
)
def test_same_seed_same_bits(name: str) -> None:
    """Two draws of a seed are equal, one of another seed differs, and truth has both sides."""
    world = installed(name)
    cell = world.cells[-1 if name in PLAIN else 2]
    first, again, other = (world.make(cell, seed, quick=True) for seed in (3, 3, 4))
    data = first.demonstrations
    assert np.array_equal(data.observations, again.demonstrations.observations)
    assert np.array_equal(data.actions, again.demonstrations.actions)
    assert np.array_equal(first.good, again.good)
    assert not np.array_equal(data.actions[:20], other.demonstrations.actions[:20])
    assert first.good.shape == (len(data),)
    assert 0 < first.good.sum() < len(data)
    assert first.success is None or set(first.success) <= {0, 1}
    assert first.good_steps is None or first.good_steps.shape == (data.n_steps,)


def test_overcooked_is_cooked_and_seen_as_recorded() -> None:
    installed("overcooked")
    game = overcooked.Kitchen("cramped_room")
    arrays, about = overcooked.trials("cramped_room")
    seen = game.seen(0)
    alike = (arrays["observations"][:, :10] == seen[:10]).all(axis=1) & (arrays["observations"][:, 10] == seen[10])
    ways = [k for k, name in enumerate(about["feature_names"]) if name.startswith("none_")]
    assert alike.any()
    assert (arrays["observations"][alike][:, ways] == seen[ways]).all()
    onions, dish, serve = "NWIENI" + 2 * "WIENI", "WSSINEN", "SESI"
    for key in onions + dish + overcooked.COOKING * "N" + "I" + serve:
        game.step(np.array(["NSEWI".index(key), 0]))  # the other cook faces a counter
    assert game.soups == 1
    assert game.pots == {(2, 0): [0, 0]}


def test_a_careful_teacher_earns_about_fifteen_and_noisy_ones_less() -> None:
    rng = np.random.default_rng(0)

    def earned(sort: str) -> float:
        return float(intersection.crossed(100, rng, lambda a, b: intersection.velocity(sort, a, b, rng))[2].mean())

    assert (careful := earned("none")) == pytest.approx(15, abs=0.5)
    assert all(careful > earned(noise) + 2 for noise in intersection.NOISES)


def test_careful_driver_pushes_the_disc_home_and_a_careless_one_by_luck() -> None:
    rng = np.random.default_rng(0)
    assert len(push2d.drive("careful", 200, rng)) == 200
    assert len(push2d.drive("strategy", 200, rng)) > 180
    assert 2 <= len(push2d.drive("accidental", 400, rng)) < 60
