"""What answers about one task say of another: weights that all tasks share, and weights of each."""

from __future__ import annotations

import numpy as np

from hand_made import answers_of
from rpil.inference.answered import MOST_TASKS, answer, ranked_in_tasks, trust_in_tasks, with_tasks
from rpil.inference.channels import CHANNELS
from rpil.inference.settings import AnswerSettings

N, NAN, SETTINGS = len(CHANNELS), np.nan, AnswerSettings()


def test_columns_are_shared_and_those_of_each_task_with_answers_its_own():
    task, columns = np.array([0, 0, 1, 1, 2, -1]), np.arange(1.0, 6 * (N + 3) + 1).reshape(6, -1)
    found = with_tasks(columns, answers_of([0, 0, 1, 0, 0, 0], pairs=[(1, 3)], m=6), task)
    of_two, of_one = columns * (task == 1)[:, None], columns * (task == 0)[:, None]
    others = np.delete(columns, [N, N + 1], axis=1) * (task % 3 == 2)[:, None]  # without components
    np.testing.assert_array_equal(found, np.column_stack([columns[:, :N], of_two, of_one, others, columns[:, -1]]))
    many, wide = np.arange(12), np.ones((12, N + 1))
    found = with_tasks(wide, answers_of([1, -1] * 6, m=12), many)[:, N:-1]
    blocks = found.reshape(12, MOST_TASKS + 1, N + 1)[..., 0]
    np.testing.assert_array_equal(blocks[:, :-1], np.eye(12, MOST_TASKS), "of as many the first")
    np.testing.assert_array_equal(blocks[:, -1], many >= MOST_TASKS)


def test_outcomes_are_ranks_within_each_task_but_for_flags():
    task, lengths = np.array([0, 0, 0, 1, 1, 2, 2]), np.array([30.0, 10, NAN, 900, 700, 50, 50])
    flags = np.array([1.0, 0, 1, 0, 0, NAN, 1])
    copies = np.array([0.5, 1, 0, 1, 1, NAN, 0])  # the mean flag of two is a half
    found = ranked_in_tasks(np.column_stack([lengths, flags, copies]), task, 2)
    np.testing.assert_array_equal(found.T, [[0.75, 0.25, NAN, 0.75, 0.25, NAN, NAN], flags, copies])


def test_a_task_is_trusted_by_its_own_answers_and_by_all_as_by_one_more():
    right, of_answer = np.array([0.9, 0.7, 0.1]), np.array([0, 0, 1])
    found = trust_in_tasks(0.4, of_answer, right, np.array([0, 1, 2, -1]), 0.05)
    np.testing.assert_allclose(found, [(0.8 + 0.4 + 0.4) / 4, 0.05, 0.05, 0.0], err_msg="the third has no answer")


def made(n_tasks, seed, reverse=()):
    """Tasks of 40 demonstrations, of which the ranking tells the bad ones, the other way round in some."""
    rng = np.random.default_rng(seed)
    task, good = np.repeat(np.arange(n_tasks), 40), rng.random(40 * n_tasks) < 0.7
    columns = rng.normal(size=(len(task), N + 3))
    columns[:, 0] += 2.0 * good * np.where(np.isin(task, reverse), -1, 1)
    return task, good, columns


def test_answers_about_one_task_say_of_another_what_holds_in_both():
    """Five answers in each of two tasks; in the second pair of tasks the ranking is the other way round in one."""
    said, wrong = np.zeros((2, 2)), np.zeros((2, 2))
    for seed, k in np.ndindex(40, 2):
        task, good, columns = made(2, seed, [1] * k)
        labels = np.where(np.arange(80) % 40 < 5, np.where(good, 1, -1), 0)
        found = [answer(columns, answers_of(labels, m=80), SETTINGS, np.arange(80), task_of=task).verdicts]
        own = [answers_of(labels[task == t], m=40) for t in (0, 1)]
        each = [answer(columns[task == t], own[t], SETTINGS, np.arange(40)).verdicts for t in (0, 1)]
        for way, verdicts in enumerate([*found, np.concatenate(each)]):
            free = verdicts[labels == 0]
            said[k, way] += np.count_nonzero(free)
            wrong[k, way] += (free * np.where(good[labels == 0], 1, -1) < 0).sum()
    assert said[0, 0] > 1.5 * said[0, 1], "together, and each task by itself"
    assert (wrong < 0.1 * said + 5).all()


def test_outcomes_of_others_say_nothing_of_a_demonstration_that_nobody_judged():
    task, _, columns = made(2, 0)
    task[39], task[79], columns[[39, 79]] = -1, -1, 0.0
    flags = np.where(task < 0, NAN, np.arange(80) % 40 > 1)[:, None]
    found = answer(columns, answers_of(outcome=flags, m=80), SETTINGS, np.arange(80), task_of=task)
    assert found.log_odds[[39, 79]].tolist() == [0, 0]
