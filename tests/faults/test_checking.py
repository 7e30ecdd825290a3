"""The rules are silent where they cannot know, work from disk, and say what they did not check."""

import numpy as np
import pyarrow as pa
import pytest

import rpil
from recordings import changed, demonstrations, edited, recording, with_missing
from rpil import Demonstrations, formats
from rpil.faults.checking import check
from rpil.faults.report import RULES


@pytest.mark.parametrize("codes", [np.arange(3), np.array(["left", "right", "stay"])])
def test_codes_and_pixels_are_no_measurements(codes):
    rng, made = np.random.default_rng(0), []
    for scale in (1.0, 1 / 255):
        made.append([(rng.integers(256, size=(30, 64)) * scale, codes[rng.integers(3, size=30)]) for _ in range(8)])
    made.append([(np.eye(6)[rng.integers(6, size=50)], codes[rng.integers(3, size=50)]) for _ in range(20)])
    for episodes in made:
        report = check(Demonstrations.from_episodes(episodes))
        assert report.findings == ()
        assert {name for name, rule in RULES.items() if "columns" in rule.needs} <= set(report.not_checked)


def test_a_single_step_is_short_and_does_not_stand_still():
    rng = np.random.default_rng(0)
    few = [(np.zeros((n, 2)), rng.normal(size=(n, 1))) for n in (1, 1, 2, 1, 3, 2)]
    assert {*check(Demonstrations.from_episodes(few)).counts} == {"constant state"}
    episodes = recording(steps=(30, 31))
    single = check(demonstrations([*episodes, (episodes[0][0][:1], episodes[0][1][:1])])).findings
    assert [(fault.rule, fault.sentence[:14]) for fault in single] == [("length", "it has 1 step ")]


def test_what_is_left_of_a_recording_after_its_stretches_is_not_too_short():
    episodes = [(states[:n], actions[:n]) for n, (states, actions) in zip([121, *[150] * 11], recording(), strict=True)]
    rows = [
        (m, t / 30, *s, *a) for m, episode in enumerate(episodes) for t, (s, a) in enumerate(zip(*episode, strict=True))
    ]
    names = ["episode", "timestamp", *(f"observation.{k}" for k in range(3)), *(f"action.{k}" for k in range(3))]
    report = rpil.check(pa.table([*np.transpose(rows)], names), segment=1.0)
    assert report.findings == ()
    assert report.not_checked["length"] == "--segment ends demonstrations by the clock"


def test_from_disk_as_in_memory(tmp_path, monkeypatch):
    episodes = recording(40)
    spiky = episodes[7][0].copy()
    spiky[50, 0] += 100
    in_memory = demonstrations(changed(episodes, 7, observations=spiky))
    formats.write(tmp_path / "data.parquet", in_memory)
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 500)
    on_disk = rpil.open(tmp_path / "data.parquet", on_disk=True).demonstrations
    found, expected = check(on_disk), check(in_memory)
    assert found.findings == expected.findings != ()
    assert found.not_checked == expected.not_checked


CLEAN = recording()
M = 5  # the demonstration with the fault
X, A = CLEAN[M]


def test_large_numbers_and_infinities_of_both_signs_raise_no_warning():
    large = [tuple((1e36 * (values + 5)).astype(np.float32) for values in each) for each in CLEAN]
    assert check(demonstrations(large)).findings == ()
    both = with_missing(changed(CLEAN, M, observations=edited(X, [60, 90], 1, [np.inf, -np.inf])))
    assert {fault.id for fault in check(both).findings} == {M}


def test_missing_values_are_set_aside_on_demand_and_infinite_actions_are_named():
    damaged = with_missing(changed(CLEAN, M, observations=edited(X, slice(30, 33), 1, np.nan)))
    (fault,) = (report := check(damaged)).findings
    assert (fault.rule, fault.id, fault.first, fault.last, fault.value) == ("missing values", M, 30, 32, 3)
    assert (fault.threshold, fault.severity) == (0, np.inf)
    assert fault.sentence == "observation 1 is nan at step 30; 2 more missing values up to step 32"
    assert "spike" in report.not_checked
    rest = check(damaged, skip_bad=True)
    assert rest.set_aside == (M,)
    assert "spike" not in rest.not_checked
    damaged = with_missing(changed(CLEAN, 0, actions=edited(CLEAN[0][1], 3, 2, np.inf)))
    (found,) = check(damaged).findings
    assert (found.column, found.first, found.sentence) == ("action 2", 3, "action 2 is inf at step 3")
    assert np.isinf(damaged.actions).any()
