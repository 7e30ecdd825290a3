"""Where everything rests: by the noise of sensors, at the ends and between, however many demonstrations do."""

from __future__ import annotations

import numpy as np
import pytest

from recordings import demonstrations
from rpil.faults.checking import check

N, REST, TICK = 10, 52, 0.088
PLACES = {"head": 0, "middle": 70, "tail": 139}


def arm(noise, at="head", rests=range(N), trembles=False, tick=0.0, drift=0.0):
    """Commands by a leader, whose hand may have noise as well, and states two steps later; it rests at a place."""
    rng, episodes = np.random.default_rng(1), []
    for m in range(N):
        time = np.arange(140)[:, None]
        path = 30 * np.sin(time / rng.uniform(8, 14, 4) + rng.uniform(0, 6, 4))
        if m in rests:
            path = np.insert(path, [PLACES[at]] * REST, path[PLACES[at]], axis=0)
        leader = path + trembles * noise * rng.normal(size=path.shape)
        late = np.concatenate([leader[:1], leader[:1], leader[:-2]]) + noise * rng.normal(size=path.shape)
        late += drift * np.minimum(np.arange(len(path)), REST)[:, None]
        episodes.append((np.round(late / tick) * tick if tick else late, leader))
    return demonstrations(episodes)


@pytest.mark.parametrize(("at", "rule"), [("head", "idle head"), ("middle", "pause"), ("tail", "idle tail")])
@pytest.mark.parametrize(
    ("noise", "trembles", "tick"), [(0.02, False, 0), (0.15, False, 0), (0.15, True, 0), (0.0, False, TICK)]
)
def test_rest_of_all_is_one_line_and_may_be_trimmed_at_the_ends(at, rule, noise, trembles, tick):
    data = arm(noise, at, trembles=trembles, tick=tick)
    report = check(data)
    assert report.counts == {rule: N}
    (line,) = report.lines
    assert (line.ids, line.grade) == (tuple(range(N)), "odd")
    long = line.last - line.first + 1
    assert REST - 10 <= long <= REST + 10
    idle = [
        first if at == "head" else n - end for n, (first, end) in zip(data.lengths, report.trims.values(), strict=False)
    ]
    assert len(idle) == N * (at != "middle")
    assert all(REST - 10 <= n <= REST for n in idle)


@pytest.mark.parametrize("at", PLACES)
def test_rest_of_one_is_found_in_its_place(at):
    report = check(arm(0.15, at, rests=[4]))
    (fault,) = report.findings
    assert fault.id == 4
    assert abs(fault.first - PLACES[at]) <= 6
    assert {*report.trims} == ({4} if at != "middle" else set())


def test_what_moves_all_the_while_never_rests():
    report = check(arm(0.15, rests=()))
    assert (report.findings, report.trims) == ((), {})
    creeping = [(x + 0.05 * np.arange(len(x))[:, None], a + 0.05 * np.arange(len(x))[:, None]) for x, a in arm(0.02)]
    assert "idle head" not in check(demonstrations(creeping)).counts
    assert not check(arm(0.15, drift=0.2)).trims  # while the command stays the same


@pytest.mark.parametrize("actions", ["codes", "constant"])
def test_a_command_that_tells_nothing_says_of_no_rest(actions):
    """A code that stays the same may be a push, and a command that never changes is none."""
    made = [
        (x, (np.arange(len(x)) >= REST).astype(int) if actions == "codes" else np.full((len(x), 1), 12.5))
        for x, _ in arm(0.15)
    ]
    assert not check(demonstrations(made)).trims


def test_nothing_is_known_where_noise_is_as_large_as_motion():
    rng = np.random.default_rng(0)
    noise = [(rng.normal(size=(120, 3)), rng.normal(size=(120, 3))) for _ in range(N)]
    assert not {"idle head", "idle tail", "pause"} & {*check(demonstrations(noise)).counts}
