"""Actions at random, of which a part has few values: nothing can be learned from them, and nobody is doubted."""

import numpy as np
import pytest

import rpil

N_DEMONSTRATIONS, LENGTH = 24, 80
N = N_DEMONSTRATIONS * LENGTH


KINDS = {
    "one of two": lambda rng, seen: rng.choice([0.5, 1.0], N),
    "two values, each for twenty steps or so": lambda rng, seen: np.cumsum(rng.random(N) < 0.05) % 2 * 0.5,
    "often nothing": lambda rng, seen: np.where(rng.random(N) < 0.5, 0.0, rng.uniform(-1, 1, N)),
    "follows the state": lambda rng, seen: np.where(seen[:, 0] + 0.3 * rng.normal(size=N) > 0, 1.0, 0.5),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_part_of_few_values_teaches_something_where_it_follows_the_state_alone(kind):
    rng = np.random.default_rng(0)
    seen = rng.normal(size=(N, 4))
    actions = np.stack([rng.uniform(-1, 1, N), KINDS[kind](rng, seen)], axis=1)
    audit = rpil.RPIL().fit(seen, actions, np.repeat(np.arange(N_DEMONSTRATIONS), LENGTH)).audit_
    assert (audit.finding == "nothing could be learned") == (kind != "follows the state")
    assert kind == "follows the state" or {*audit.verdicts} == {"open"}
