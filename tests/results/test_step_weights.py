"""Weights of steps: whom a learner trusts, P(good) for other trainings, and where a person took over."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import expit

import rpil
from audits import make_audit
from episode_rows import N, T, episodes
from hand_made import answers_of
from rpil.results.judged import AuditSettings
from rpil.results.step_weights import balanced, of_demonstrations, takeover_signs, weights_of

FOR_OTHERS = AuditSettings(weighs_for_learner=False)
LENGTHS, PROBA = [3, 1, 4, 2, 5, 1], np.array([0.9, 0.8, 0.3, 0.2, 0.6, 0.4])
CONTRAST = answers_of([1, 0, 0, -1, 0, 0])


def judged(part=(1, 1, 0.5, -1, -0.5, 0), answers=None, verdicts=("open",) * 6, **changes):
    """Six demonstrations, of parts that a learner trusts or not."""
    known = answers_of(m=6) if answers is None else answers
    fields = {"expert_proba": PROBA, "part": np.array(part, dtype=float), "lengths": LENGTHS, "answers": known}
    return make_audit(verdicts, **({"anchor": "answers" if known.count else "none"} | fields | changes))


def weights(labels=(), pairs=(), outcome=None, tied=(), part=(1, 1, 1, -1, -1, -1), **changes):
    """The weights for the learner after these answers."""
    answers = answers_of([*labels, *[0] * (6 - len(labels))], pairs, outcome, tied)
    return of_demonstrations(judged(part, answers, **changes)).tolist()


def test_a_learner_trusts_all_but_the_other_part():
    assert of_demonstrations(judged()).tolist() == [1, 1, 1, 0, 1, 1]
    assert of_demonstrations(judged((0,) * 6)).tolist() == [1] * 6


def test_one_answer_changes_the_weight_of_its_own_demonstration_and_of_its_copies_alone():
    assert weights([0, -1]) == [1, 0, 1, 0, 0, 0]
    assert weights([0, 0, 0, 1]) == [1, 1, 1, 1, 0, 0]
    copies = np.array([0, 1, 1, 3, 3, 5])
    assert weights([0, -1, -1], copy_of=copies) == [1, 0, 0, 0, 0, 0], "labels of copies are one answer"
    assert weights([0, 0, 0, 1], copy_of=copies) == [1, 1, 1, 1, 1, 0]
    assert weights(pairs=[(3, 0)]) == [1, 1, 1, 0, 0, 0], "which of two is better says nothing of the parts"


BETTER, OTHER = [1, 1, 1, 0, 0, 0], [0, 0, 0, 1, 1, 1]
FLAGS = [np.nan, np.nan, 1, np.nan, np.nan, 0]


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ({"labels": [1, 0, 0, -1]}, BETTER),
        ({"labels": [-1, 0, 0, 1]}, OTHER),
        ({"labels": [-1], "pairs": [(4, 1)]}, OTHER),
        ({"pairs": [(0, 3), (1, 4)]}, BETTER),
        ({"pairs": [(3, 0), (4, 1)]}, OTHER),
        ({"labels": [0, 1], "outcome": FLAGS}, BETTER),
        ({"labels": [-1, 0, 0, 1], "part": [1, 0.5, 0.5, -0.5, -0.5, -1]}, OTHER),
        ({"labels": [1, 0, 0, -1], "part": [1, 0, 0, -1, -1, -1]}, [1, 0, 0, 0, 0, 0]),
    ],
)
def test_contrasting_answers_that_agree_with_the_parts_say_which_one_is_good(answers, expected):
    assert weights(**answers) == expected


@pytest.mark.parametrize(
    "answers",
    [
        {"labels": [1, -1]},  # both are of one part
        {"labels": [0, -1, 0, 1, -1]},
        {"labels": [1, 0, 0, -1], "pairs": [(4, 2)]},
        {"labels": [1, 0, 0, -1], "part": [0] * 6},
        {"outcome": FLAGS},
        {"labels": [1, 0, 0, -1], "task_of": np.arange(6) // 3},  # each task has parts of its own
    ],
)
def test_answers_that_predict_others_in_another_way_weigh_by_p_good(answers):
    assert weights(**answers, verdicts=("open", "open", "good", "open", "open", "open")) == PROBA.tolist()
    assert set(weights(**answers)) == {0.0, 1.0} or answers.get("part")  # nothing follows


@pytest.mark.parametrize(
    ("answers", "expected"),
    [
        ({"labels": [1, 1]}, BETTER),
        ({"labels": [1], "tied": [(3, 4)]}, BETTER),
        ({"labels": [1, -1, 0, 1, -1], "part": (1, -1) * 3, "task_of": np.arange(6) // 3}, [1, 0, 1, 1, 0, 1]),
        ({"outcome": [0, 0, np.nan, np.nan, np.nan, np.nan]}, [0, 0, 1, 0, 0, 0]),
        ({"outcome": [0, 1, 1, 1, 1, 1]}, [0, 1, 1, 0, 0, 0]),  # flags do not turn the parts
        ({"labels": [-1, -1, -1], "part": [1, 1, 1, -1, -1, -1]}, PROBA.tolist()),  # nobody else is trusted
    ],
)
def test_answers_without_a_contrast_change_their_own_demonstrations(answers, expected):
    assert weights(**answers) == expected


def test_for_other_trainings_all_weigh_one_until_answers_contrast_and_then_p_good_with_a_mean_of_one():
    for answers in (answers_of(m=6), answers_of([1, 1, 0, 0, 0, 0]), answers_of([0, 0, 0, -1, 0, -1])):
        assert of_demonstrations(judged(answers=answers, settings=FOR_OTHERS)).tolist() == [1] * 6
    pair, second = answers_of(pairs=[(0, 3)], m=6), answers_of(pairs=[(0, 3), (1, 4)], m=6)
    assert of_demonstrations(judged(answers=pair, settings=FOR_OTHERS)).tolist() == [1] * 6
    mean = PROBA @ LENGTHS / sum(LENGTHS)
    for answers in (CONTRAST, second):
        np.testing.assert_allclose(of_demonstrations(judged(answers=answers, settings=FOR_OTHERS)), PROBA / mean)
    copies = judged(answers=answers_of([1, 0, 0, 0, 0, 0]), settings=FOR_OTHERS, copy_of=np.array([0, 0, 2, 3, 4, 5]))
    assert of_demonstrations(copies).tolist() == [1] * 6
    tasks = judged(answers=CONTRAST, settings=FOR_OTHERS, anchor="none")  # of which one alone has answers
    assert of_demonstrations(tasks).tolist() == [1] * 6


def test_a_named_adversary_weighs_each_step_by_p_expert():
    for settings in (AuditSettings(), FOR_OTHERS):
        audit = judged(answers=CONTRAST, anchor="named adversary", settings=settings)
        np.testing.assert_array_equal(weights_of(audit), np.repeat(PROBA, LENGTHS))
    assert weights_of(replace(audit, step_log_ratio=np.empty(0))).size == 0


def test_where_a_person_took_over_weights_move_within_demonstrations_and_keep_their_means():
    signs = np.array([-1, 1, 1, 0, 0, 0, 0, 0, 0, -1, 0, 0, -1, 1, 0, 1], dtype=float)
    found = np.split(weights_of(judged(anchor="named adversary", taken_over=signs)), np.cumsum(LENGTHS)[:-1])
    for weight, mean, z in zip(found, PROBA, np.split(signs, np.cumsum(LENGTHS)[:-1]), strict=True):
        own = np.full(len(z), mean)
        if z.any():
            b = brentq(lambda b, z=z: expit(2 * z + b).mean() - 0.5, -9, 9)
            own = 2 * mean * expit(2 * z + b)
        np.testing.assert_allclose(weight, own, rtol=1e-7)


def test_balanced_weights_have_the_mean_one_half_and_the_odds_that_were_given():
    lengths, rng = np.array([1, 7, 30]), np.random.default_rng(0)
    log_odds = rng.normal(0, 3, size=38)
    found = np.split(balanced(log_odds, lengths), np.cumsum(lengths)[:-1])
    for proba, odds in zip(found, np.split(log_odds, np.cumsum(lengths)[:-1]), strict=True):
        assert proba.mean() == pytest.approx(0.5, abs=1e-7)
        np.testing.assert_allclose(np.diff(np.log(proba / (1 - proba))), np.diff(odds), atol=1e-6)


@pytest.mark.parametrize(("fps", "n"), [(None, 10), (0.2, 1), (3.4, 3), (2.0, 2)])
def test_a_second_before_a_person_took_over_counts_against_the_policy(fps, n):
    flags, offsets = np.zeros(60, dtype=bool), np.array([0, 30, 60])
    flags[[15, 16, 20, 30, 31, 33]] = True  # twice in the first one, and from the start of the second
    first, second = takeover_signs(flags, offsets, fps)
    expected = np.zeros(60)
    for start, begin in ((15, 0), (20, 0), (33, 30)):
        expected[max(start - n, begin) : start] = -1
    expected[flags] = 1
    np.testing.assert_array_equal(np.concatenate([first, second]), expected)
    assert (len(first), len(second)) == (30, 30)
    assert takeover_signs(None, offsets, fps) == takeover_signs(np.zeros(60, dtype=bool), offsets, fps) == ()


def with_interventions(flags):
    """Episodes with a column of flags, in which nothing else speaks of a person."""
    return episodes(phase=None, is_human_intervention=np.tile(flags, N))


def test_a_person_who_takes_over_moves_the_weights_of_steps_and_no_verdict():
    took_over = (np.arange(T) >= 15) & (np.arange(T) < 20)
    told, plain = rpil.audit(with_interventions(took_over)), rpil.audit(episodes(phase=None))
    assert (told.verdicts, told.finding) == (plain.verdicts, plain.finding)
    np.testing.assert_array_equal(told.log_odds, plain.log_odds)
    signs = np.zeros(T)
    signs[5:15], signs[15:20] = -1, 1  # one second at ten steps a second
    np.testing.assert_array_equal(told.taken_over, np.tile(signs, N))
    assert f"A person took over in {N} of {N}" in told.notes[-1]
    for audit, of_all in ((told, plain), (told.answered({"e0": "bad", "e1": "good"}), None)):
        each = audit.step_weight.reshape(N, T)
        assert (each[:, 5:15].max(axis=1) < each[:, :5].min(axis=1)).all()
        assert (each[:, :5].max(axis=1) < each[:, 15:20].min(axis=1)).all()
        mean = of_demonstrations(audit) if of_all is None else of_all.step_weight.reshape(N, T).mean(axis=1)
        np.testing.assert_allclose(each.mean(axis=1), mean, rtol=1e-6)


@pytest.mark.parametrize(
    ("flags", "is_known"),
    [
        (np.zeros(T, dtype=bool), False),  # nobody took over
        (np.arange(T), False),  # amounts, which are observed
        ((np.arange(T) > 10).astype(int), True),
    ],
)
def test_which_columns_are_flags_of_interventions(flags, is_known):
    table = with_interventions(flags)
    assert (rpil.audit(table).taken_over is not None) == is_known
    named = rpil.open(table, observations=["x", "is_human_intervention"])
    assert named.interventions is None
    assert named.demonstrations.n_observations == 2


def test_rows_that_are_called_bad_weigh_nothing_and_the_mean_stays():
    marks = np.array([[2, 1, 3, -1], [0, 0, 2, 1]])
    found = weights_of(judged((1,) * 6, replace(answers_of(m=6), marks=marks)))
    np.testing.assert_allclose(found, np.where(np.isin(np.arange(16), [5, 6]), 0, 16 / 14))
    every = np.array([[m, 0, length, -1] for m, length in enumerate(LENGTHS)])
    assert not weights_of(judged((1,) * 6, replace(answers_of(m=6), marks=every))).any()
