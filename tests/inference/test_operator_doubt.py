"""Without answers operators give a reason to doubt, and nothing else: who gave the outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hand_made import same_actions, scores_of, scoring_of
from problems import make
from rpil import RPIL, Demonstrations
from rpil.data.demonstrator_groups import Demonstrators
from rpil.inference.claims import claim, doubts_of_operators
from rpil.inference.settings import JudgeSettings

SCORE = np.array([1.0] * 6 + [0.0] * 4)
SETTINGS = JudgeSettings()


def apart(names, verdicts, max_chance=0.01):
    """The operators of a doubt, and the beginning of its sentence."""
    limits = replace(SETTINGS.claims, max_runs_p=max_chance)
    doubts = doubts_of_operators(Demonstrators.from_names(names), np.asarray(verdicts), limits)
    return (doubts[0].sentence.split()[0], doubts[0].operators) if doubts else ("", ())


@pytest.mark.parametrize(
    ("names", "verdicts", "expected"),
    [
        ("aaabbb", [1, 1, 0, 1, -1, -1], ("All", ("b",))),  # who gave a similar one as well
        ("aaabbb", [1, 1, 0, 1, 0, -1], ("", ())),  # one alone
        ("aaabbb", [1, 1, -1, 1, -1, -1], ("", ())),
        ("aaaaaa", [1, 1, 1, 1, -1, -1], ("", ())),  # one operator gave all
        ("abcdef", [1, 1, 1, 1, -1, -1], ("", ())),  # nobody gave two
    ],
)
def test_all_unlike_ones_of_one_operator_are_a_doubt(names, verdicts, expected):
    assert apart(names, verdicts) == expected


def test_operators_of_whom_none_is_typical_are_a_doubt_where_chance_does_not_explain_it():
    """Of 24 demonstrations 12 are similar: by chance none of n is with probability 1 / 2 ** n."""
    names = "a" * 12 + "b" * 6 + "c" * 6
    verdicts = [1] * 12 + [-1] * 6 + [0] + [-1] * 5
    assert apart(names, verdicts, 0.02) == ("Most", ("b", "c"))
    assert apart(names, verdicts, 0.5**6) == ("", ())
    assert apart(names, [*verdicts[:-1], 1], 0.02) == ("Most", ("b",))  # 6 of 10
    assert apart(names, [-1] * 2 + verdicts[2:-1] + [1], 0.02) == ("", ())  # 6 of 12


def found(names, gains=lambda group: np.where(group[:1].any(), np.where(SCORE > 0.5, 1.0, -1.0), 0.0)):
    """The claims about demonstrations of these operators, whose scores are two groups."""
    data = replace(same_actions(10), demonstrators=Demonstrators.from_names(names))
    scoring = scoring_of(data, gains, SETTINGS)
    scores = scores_of(scoring, SCORE, 0.999)
    explained = scoring.model.evaluate(data.per_step((SCORE > 0.5).astype(float)), scoring.ridge)
    return claim(scoring, replace(scores, fit=replace(scores.fit, log_prob=explained)), None, None)


def test_the_doubt_withdraws_the_words_and_names_the_operator():
    assert found("abababaabb").finding == "outliers"
    doubtful = found("aabaabbbbb")
    assert doubtful.finding == "in doubt"
    assert not doubtful.verdicts.any()
    assert [doubt.operators for doubt in doubtful.doubts] == [("b",)]
    assert "--session operator" in doubtful.doubts[0].sentence


def test_operators_are_known_where_demonstrations_are_copies():
    toy = make("random", 0, n_good=10, n_bad=6, steps=(40, 60))
    rows = np.arange(toy.offsets[0], toy.offsets[1])
    offsets = np.append(toy.offsets, toy.offsets[-1] + len(rows))
    copied = Demonstrations.from_arrays(
        np.concatenate([toy.observations, toy.observations[rows]]),
        np.concatenate([toy.actions, toy.actions[rows]]),
        offsets,
    )
    audit = RPIL().fit(copied, demonstrators=["Ann"] * 8 + ["{Bob}"] * 8 + ["Ann"]).audit_
    assert audit.finding == "in doubt"
    assert "{Bob}" in audit.doubts[0]
