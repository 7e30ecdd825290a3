"""Where everything rests: by the noise of sensors, at the ends and between, however many demonstrations do."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations
from rpil.faults.checking import check

N, REST = 10, 52


def arm(noise, at, rests=range(N), trembles=False):
    """Commands by a leader, whose hand has noise as well, and states two steps later; it rests at a place."""
    rng, episodes = np.random.default_rng(1), []
    for m in range(N):
        time = np.arange(140)[:, None]
        path = 30 * np.sin(time / rng.uniform(8, 14, 4) + rng.uniform(0, 6, 4))
        if m in rests:
            k = {"head": 0, "middle": 70, "tail": 139}[at]
            path = np.insert(path, [k] * REST, path[k], axis=0)
        leader = path + trembles * noise * rng.normal(size=path.shape)
        late = np.concatenate([leader[:1], leader[:1], leader[:-2]])
        episodes.append((late + noise * rng.normal(size=late.shape), leader))
    return demonstrations(episodes)


@pytest.mark.parametrize(("at", "rule"), [("head", "idle head"), ("middle", "pause"), ("tail", "idle tail")])
@pytest.mark.parametrize(("noise", "trembles"), [(0.02, False), (0.15, False), (0.15, True)])
def test_rest_of_all_is_one_line(at, rule, noise, trembles):
    report = check(arm(noise, at, trembles=trembles))
    assert report.counts == {rule: N}
    (line,) = report.lines
    assert (line.ids, line.grade) == (tuple(range(N)), "odd")
    long = line.last - line.first + 1
    assert REST - 10 <= long <= REST + 10


@pytest.mark.parametrize("at", ["head", "middle"])
def test_rest_of_one_is_found_in_its_place(at):
    (fault,) = check(arm(0.15, at, rests=[4])).findings
    assert fault.id == 4
    assert abs(fault.first - {"head": 0, "middle": 70}[at]) <= 6


def test_what_moves_all_the_while_never_rests():
    assert not check(arm(0.15, "head", rests=())).findings
    creeping = [
        (x + 0.05 * np.arange(len(x))[:, None], a + 0.05 * np.arange(len(x))[:, None]) for x, a in arm(0.02, "head")
    ]
    assert "idle head" not in check(demonstrations(creeping)).counts


def test_nothing_is_known_where_noise_is_as_large_as_motion():
    rng = np.random.default_rng(0)
    noise = [(rng.normal(size=(120, 3)), rng.normal(size=(120, 3))) for _ in range(N)]
    assert not {"idle head", "idle tail", "pause"} & {*check(demonstrations(noise)).counts}
