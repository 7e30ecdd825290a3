"""The benchmark of planted recording faults: what it plants and counts, and its table."""

import numpy as np
import pytest

import faults
from fault_kinds import KINDS, Clean, plant
from fault_worlds import WORLDS
from recordings import demonstrations, recording


@pytest.fixture(scope="module")
def clean():
    return Clean(demonstrations(recording(12)))


@pytest.mark.parametrize("kind", KINDS)
def test_planted_fault_changes_the_marked_demonstrations_only(clean, kind):
    planted = plant(clean, kind, KINDS[kind].sizes[0], 0.2, np.random.default_rng(0))
    assert planted.has_fault.sum() == 2
    for m, (before, after) in enumerate(zip(clean.demonstrations, planted.demonstrations, strict=True)):
        same = all(np.array_equal(a, b) for a, b in zip(before, after, strict=True))
        assert same != planted.has_fault[m]


@pytest.mark.parametrize("world", WORLDS)
def test_clean_recordings_that_are_not_of_robots_have_no_finding(world):
    made, times = WORLDS[world](np.random.default_rng(0))
    assert dict(faults.check(made, times=times).counts) == {}


@pytest.mark.slow
def test_quick_run_finds_most_faults():
    rows = faults.run(faults.clean_sets(None, [], 12, True), 1)
    sums = faults.summarise(rows, "kind").values()
    assert "| spike |" in faults.render(rows)
    assert sum(n["found"] for n in sums) > 0.8 * sum(n["faults"] for n in sums)
    assert sum(n["accused"] for n in sums) < 0.05 * sum(n["clean"] for n in sums)
