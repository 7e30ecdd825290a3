"""Comparisons of choices: paired by seed, sure only where seeds agree, and clear about what they were given."""

from __future__ import annotations

import doctest
import re

import numpy as np
import pytest
from scipy import stats

import rpil
from problems import refused
from rpil.data.errors import DataError
from rpil.simulation import comparison
from rpil.simulation.comparison import compare


def same(choice, seed):
    return choice


def played(by_seed):
    """An `evaluate` that looks the outcomes of a policy up: a mapping from policy to those of every seed."""
    return lambda policy, seed: by_seed[policy][seed]


def test_the_example_of_the_documentation_prints_what_it_says():
    found = doctest.testmod(comparison, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert found.attempted == 4
    assert found.failed == 0


def test_rpil_compare_is_this_function():
    assert rpil.compare is compare


def test_differences_are_those_of_a_paired_test_over_seeds():
    rng = np.random.default_rng(0)
    outcomes = {
        name: rng.normal(mean + rng.normal(size=(5, 1)), 0.01, size=(5, 8)) for name, mean in (("a", 0), ("b", 4))
    }
    row = compare({"all": "a", "kept": "b"}, same, played(outcomes), seeds=5)["kept"]
    wanted = stats.ttest_rel(outcomes["b"].mean(axis=1), outcomes["a"].mean(axis=1))
    assert row.difference / row.standard_error == pytest.approx(wanted.statistic)
    assert row.difference == pytest.approx((outcomes["b"] - outcomes["a"]).mean())
    assert row.verdict == "better"
    assert row.episodes == 40


def test_what_all_choices_share_of_a_seed_plays_no_part():
    hard = np.array([0.0, 50.0, 100.0])[:, None]
    rng = np.random.default_rng(1)
    outcomes = {name: hard + mean + rng.normal(size=(3, 20)) for name, mean in (("a", 0), ("b", 5))}
    row = compare({"a": "a", "b": "b"}, same, played(outcomes))["b"]
    assert row.standard_error < 1
    assert row.verdict == "better"


def test_seeds_that_agree_by_chance_are_not_believed():
    """Five episodes of each seed, one more of which succeeds: the seeds agree, the episodes say nothing."""
    first = np.array([np.roll([1, 1, 0, 0, 0], seed) for seed in range(3)])
    outcomes = {"a": first, "b": 1 - first}
    row = compare({"a": "a", "b": "b"}, same, played(outcomes))["b"]
    assert row.difference == pytest.approx(0.2)
    assert row.standard_error > 0.2
    assert row.verdict.startswith("no difference can be told with 3 seeds")


def test_successes_have_wilsons_interval_and_returns_students():
    outcomes = {"a": [[1, 1, 0, 1]] * 2, "b": [[True] * 4] * 2}
    found = compare({"a": "a", "b": "b"}, same, played(outcomes), seeds=2)
    assert found.measure == "success rate"
    wilson = stats.binomtest(6, 8).proportion_ci(method="wilson")
    np.testing.assert_allclose(found["a"].ci95, (wilson.low, wilson.high))
    outcomes["a"] = [[1, 2, 0, 1]] * 2  # one value that is no success makes returns of all
    found = compare({"a": "a", "b": "b"}, same, played(outcomes), seeds=2)
    assert found.measure == "mean return"
    values = [1, 2, 0, 1] * 2
    np.testing.assert_allclose(found["a"].ci95, stats.t.interval(0.95, 7, np.mean(values), stats.sem(values)))


@pytest.mark.parametrize("spread", [0.0, 0.15])
def test_choices_that_are_alike_are_seldom_told_apart(spread):
    """Level 5 %, of 400 comparisons: at most 20, and three standard deviations."""
    rng = np.random.default_rng(2)

    def train(choice, seed):
        return np.clip(0.6 + spread * rng.normal(), 0, 1)

    found = [compare({"a": 0, "b": 0, "c": 0}, train, lambda p, seed: rng.random(20) < p, seeds=4) for _ in range(400)]
    wrong = sum(any(row.verdict in ("better", "worse") for row in table.rows) for table in found)
    assert wrong <= 20 + 3 * np.sqrt(19)


def test_one_seed_tells_no_difference():
    found = compare({"a": 0, "b": 1}, same, lambda p, seed: [p] * 50, seeds=1)
    assert np.isnan(found["b"].standard_error)
    assert found["b"].verdict.startswith("no difference can be told with 1 seed")


def test_seeds_that_change_nothing_are_named():
    found = compare({"a": 0.0, "b": 7.0}, same, lambda p, seed: [p, p + 1])
    assert "do not seem to use their seed" in found["b"].verdict


@pytest.mark.parametrize("draw", [lambda rng: rng.random(50) < 0.6, lambda rng: rng.normal(size=50)])
def test_seeds_that_change_nothing_make_no_choice_better(draw):
    for t in range(50):
        rng = np.random.default_rng(t)
        fixed = {"a": draw(rng), "b": draw(rng)}
        row = compare({"a": "a", "b": "b"}, same, lambda policy, seed, fixed=fixed: fixed[policy], seeds=10)["b"]
        assert "do not seem to use their seed" in row.verdict or row.difference == 0


def test_policies_that_always_succeed_or_always_fail_may_be_told_apart():
    assert compare({"a": 0, "b": 1}, same, lambda p, seed: [p] * 20)["b"].verdict == "better"


def test_equal_outcomes_are_no_difference():
    assert compare({"a": 1, "b": 1}, same, lambda p, seed: [0, p])["b"].verdict.startswith("no difference can be told")


def test_every_choice_is_given_the_same_seeds():
    trained, evaluated, calls = [], [], []

    def train(choice, seed):
        trained.append((choice, seed))
        return choice

    def evaluate(policy, seed):
        evaluated.append((policy, seed))
        return [1.0, 2.0]

    found = compare({"a": 1, "b": 2}, train, evaluate, seeds=[7, 3], progress=lambda *call: calls.append(call))
    assert trained == evaluated == [(1, 7), (2, 7), (1, 3), (2, 3)]
    assert calls == [(1, 4), (2, 4), (3, 4), (4, 4)]
    assert found.seeds == (7, 3)


def test_the_table_has_a_row_for_each_choice_and_a_sentence_for_each_but_the_first():
    rng = np.random.default_rng(4)
    found = compare({"all": 0.3, "kept": 0.9, "best of them": 0.3}, same, lambda p, seed: rng.random(50) < p)
    header, *lines = str(found).split("\n")
    assert header.split() == ["episodes", "success", "rate", "95", "%", "interval", "minus", "all"]
    assert [line.split("  ")[0] for line in lines[:3]] == ["all", "kept", "best of them"]
    assert re.fullmatch(r"kept is better than all by 0\.\d+ \+- 0\.\d+ over 3 seeds\.", lines[3])
    assert lines[4].startswith("best of them and all: no difference can be told with 3 seeds; ")
    assert len(lines) == 5
    assert len({len(line) for line in lines[1:3]}) == 1  # columns stand below one another


def test_one_choice_is_a_table_without_sentences():
    assert len(str(compare({"all": 0}, same, lambda p, seed: [1.0, 2.0])).split("\n")) == 2


@pytest.mark.parametrize(
    ("choices", "outcome", "seeds", "words"),
    [
        ({}, [1], 3, "no choices"),
        ([1, 2], [1], 3, "no choices .* mapping"),
        ({"a": 0}, [1], 0, "seeds is 0"),
        ({"a": 0}, [1], [], r"seeds is \[\]"),
        ({"a": 0}, [1], [1, 1], "each once"),
        ({"a": 0}, [], 3, r"'a' with seed 0, returned \[\]"),
        ({"a": 0}, None, 3, "returned None"),
        ({"a": 0}, 0.5, 3, "returned 0.5"),
        ({"a": 0}, [[1, 0]], 3, r"returned \[\[1, 0\]\]"),
        ({"a": 0}, ["won"], 3, "returned .'won'.*number"),
        ({"a": 0}, [1, np.nan], 3, "nan.*finite"),
    ],
)
def test_errors_are_one_sentence(choices, outcome, seeds, words):
    with refused(words):
        compare(choices, same, lambda policy, seed: outcome, seeds=seeds)


def test_another_number_of_episodes_is_refused_at_once():
    trained = []

    def train(choice, seed):
        trained.append(choice)
        return choice

    with pytest.raises(DataError, match="for 'b' with seed 0, returned 2 episodes, and 1 before"):
        compare({"a": 1, "b": 2, "c": 3}, train, lambda p, seed: [1] * p)
    assert trained == [1, 2]
