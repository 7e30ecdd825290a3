"""The parts of the action that hold the evidence, and the band of the rest around them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sklearn.linear_model import LogisticRegression, Ridge

import rpil
from audits import make_audit
from rpil.data.demonstrations import Demonstrations
from rpil.data.fit_data import FitData
from rpil.data.spaces import Box
from rpil.estimators.task import Task
from rpil.inference.held_out import held_out_model
from rpil.inference.settings import HeldOutSettings, JudgeSettings
from rpil.inference.trust import Judgement, judge
from rpil.policies.features import FeatureMap, FeatureSettings
from rpil.results.evidence import by_held_out_policies, worth_a_look
from rpil.results.record import Audit

NAMES = ("shoulder", "elbow", "wrist")
BAD = range(16, 20)


def episodes(n_steps: int = 60, discrete: bool = False, stop: int = 50) -> list[tuple[np.ndarray, np.ndarray]]:
    """Twenty demonstrations; in steps 20 to 49 the elbow of the last four is off by 2, or they take another action."""
    rng = np.random.default_rng(0)
    found = []
    for m in range(20):
        states = rng.normal(size=(n_steps, 3))
        actions = states @ np.array([[1, 0, 0.5], [0, 1, 0], [0, 1, 1.0]])
        actions += rng.normal(size=actions.shape) * [0.2, 0.3, 0.4]
        off = slice(20, stop) if m in BAD else slice(0)
        actions[off] += [0.0, 2.0, 0.3]
        words = np.where(states[:, 0] > 0, "right", "left")
        words[off] = "stop"
        found.append((states, words if discrete else actions))
    return found


def demonstrations(**options: object) -> Demonstrations:
    found = Demonstrations.from_episodes(episodes(**options))
    return found if options.get("discrete") else replace(found, action_names=NAMES)


@pytest.fixture(scope="module")
def audit() -> Audit:
    return rpil.RPIL().fit(demonstrations()).audit_


def judged(discrete: bool) -> tuple[Judgement, FitData]:
    given = demonstrations(discrete=discrete)
    task = Task.of(given)
    features = FeatureMap.fit("folded", given.observations, settings=FeatureSettings())
    data = task.data(given, features)
    return judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings()), data


@pytest.mark.parametrize("discrete", [False, True])
def test_the_parts_sum_to_the_log_ratios_of_the_judge_less_those_of_the_median_of_the_rest(discrete: bool) -> None:
    judgement, data = judged(discrete)
    compared = by_held_out_policies(judgement, held_out_model(data, HeldOutSettings()), None, HeldOutSettings())
    less = judgement.log_ratio - compared.nats.sum(axis=1)
    # The errors of the rest have another scale than those of the demonstrations that taught the policies.
    assert np.ptp(less) < (1e-9 if discrete else 0.02 * np.ptp(judgement.log_ratio))
    np.testing.assert_array_equal(np.flatnonzero(judgement.claims.lower), BAD)
    rest = ~judgement.claims.lower
    np.testing.assert_allclose(np.median(data.sum_steps(compared.nats)[rest], axis=0), 0, atol=1e-9)


def test_the_part_with_the_fault_comes_first_with_most_of_the_evidence(audit: Audit) -> None:
    for m in BAD:
        first = audit.traces[m].parts[0]
        assert first.name == "elbow"
        assert first.share > 0.8
        assert first.nats < -30
        inside = (first.value >= first.low) & (first.value <= first.high)
        assert not inside[20:50].any()
        assert inside[[*range(20), *range(50, 60)]].mean() > 0.7
        assert [part.share for part in audit.traces[m].parts] == sorted(
            (p.share for p in audit.traces[m].parts), reverse=True
        )
        assert sum(part.share for part in audit.traces[m].parts) <= 1 + 1e-9
    np.testing.assert_array_equal(first.value, episodes()[BAD[-1]][1][:, 1].astype(np.float32))


def test_nine_in_ten_held_out_steps_of_the_typical_are_in_the_band(audit: Audit) -> None:
    inside = [(p.value >= p.low) & (p.value <= p.high) for m in range(16) for p in audit.traces[m].parts]
    assert len(audit.traces) == 20
    assert 0.88 < np.concatenate(inside).mean() < 0.92


def test_the_band_holds_nine_in_ten_steps_where_policies_learn_their_own_steps_by_heart() -> None:
    """There is a feature for every few steps: of steps that a policy learned from, the errors are smaller."""
    rng = np.random.default_rng(1)
    features = np.column_stack([rng.normal(size=(300, 60)), np.ones(300)])
    actions, box = rng.normal(size=(300, 1)), Box(np.full(1, -9.0), np.full(1, 9.0))
    data = FitData(features, actions, np.arange(0, 301, 12), box, np.zeros(25, dtype=int))
    judgement = judge(data, held_out_model(data, HeldOutSettings()), JudgeSettings())
    compared = by_held_out_policies(judgement, held_out_model(data, HeldOutSettings()), None, HeldOutSettings())
    learned = actions - features @ np.linalg.lstsq(features, actions, rcond=None)[0]
    true = 2 * 1.645
    assert np.diff(np.quantile(learned, [0.05, 0.95]))[0] < 0.9 * true
    assert 0.97 * true < np.median(compared.high - compared.low) < 1.1 * true


def test_discrete_actions_are_drawn_by_their_probability() -> None:
    given = demonstrations(discrete=True)
    traces = rpil.RPIL().fit(given).audit_.traces
    for m, (_, actions) in enumerate(episodes(discrete=True)):
        own = traces[m]
        (part,) = own.parts
        assert (part.share, own.taken) == (1.0, tuple(actions))
        assert ((part.value > 0) & (part.value <= 1)).all()
        assert len(set(part.low.tolist())) == len(set(part.high.tolist())) == 1
        assert (part.nats < -30) == (m in BAD)
        if m in BAD:
            assert (part.value[20:50] < part.low[20:50]).all()


@pytest.mark.parametrize("discrete", [False, True])
def test_policies_of_the_user_have_traces_too(discrete: bool) -> None:
    own = LogisticRegression() if discrete else Ridge()
    audit = rpil.RPIL(policy=own).fit(demonstrations(n_steps=200, discrete=discrete, stop=200)).audit_
    for m in BAD:
        part = audit.traces[m].parts[0]
        assert part.nats < -20
        outside = (part.value < part.low) | (part.value > part.high)
        # The band holds two thirds of such steps: of 20 of them 7 are outside, give or take 2.
        assert outside[20:].mean() > 0.9 > 0.6 > outside[:20].mean()
        assert part.name == ("action" if discrete else "elbow")


def test_answers_change_no_trace(audit: Audit) -> None:
    assert audit.answered({0: "good", 19: "bad"}).traces is audit.traces


def test_those_are_drawn_that_are_looked_at_first() -> None:
    verdicts = ("open",) * 30 + ("outlier",) * 2
    odds = np.concatenate([np.linspace(3.0, 20.0, 30), [-3.0, -5.0]])
    audit = make_audit(verdicts, log_odds=odds, pair=(29, 31), contradicting=(28,))
    assert worth_a_look(audit, 31).tolist() == [28, 31, 30, *range(28)]
    assert worth_a_look(audit, 5).tolist() == [28, 31, 30, 0, 1]
    assert worth_a_look(audit).tolist() == list(range(32))
