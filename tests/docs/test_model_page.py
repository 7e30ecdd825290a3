"""docs/model.md: its settings and its other constants are those of the judge."""

from __future__ import annotations

import re
from pathlib import Path

from rpil.inference import settings
from rpil.inference.channels import CHANNELS

TEXT = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
FLAT = " ".join(TEXT.split())


def short(number: float) -> str:
    """A number as the page writes it: .5 and 16."""
    return f"{number:g}".removeprefix("0") if 0 < number < 1 else f"{number:g}"


def test_settings_in_the_text_are_those_of_the_judge():
    named = re.findall(r"`(\w+)\.(\w+) = ([\d.]+)`", TEXT)
    assert len(named) > 12
    for record, name, value in named:
        assert getattr(getattr(settings, record)(), name) == float(value), f"{record}.{name}"


def test_constants_of_answers_are_those_of_the_judge():
    answers = settings.AnswerSettings()
    assert f"are wrong at the rate $e$ = {short(answers.error)}." in FLAT
    assert f"$w_0$ is {short(answers.by_ranking)} on the ranking, {short(answers.by_group)} on the group" in FLAT
    assert f"0 elsewhere; $\\Lambda$ is {short(answers.precision)}. " in FLAT
    assert f"one kind leads by {'two' if answers.max_lead == 2 else answers.max_lead}" in FLAT
    end = answers.end_place
    assert f"{short(end)} from the end of the other kind" in FLAT
    assert f"at the places {short(end)} and {short(1 - end)} of the ranking" in FLAT
    assert f"(of more than {answers.max_folds}, by those of other folds)" in FLAT
    assert f"at least {short(answers.min_proba)} or at most {short(round(1 - answers.min_proba, 9))} " in FLAT
    assert settings.ChannelSettings().n_components == 8
    assert "up to eight principal components" in FLAT
    assert f"five channels ({', '.join(CHANNELS)})" in FLAT


def test_constants_of_scores_are_those_of_the_judge():
    judge = settings.JudgeSettings()
    assert f"the {judge.trimming.share:.0%}".replace("%", " %") in FLAT
    assert judge.trimming.max_iter == 4
    assert "at most four times" in FLAT
    assert (judge.held_out.max_folds, judge.monotony, judge.outliers.max_share) == (5, 1 / 3, 1 / 3)
    assert "are dealt into five folds" in FLAT
    assert f"of up to {judge.held_out.max_left_out} each is a fold of its own" in FLAT
    assert "- \\tfrac13 \\max" in FLAT
    assert "is a third of all at most" in FLAT
    assert f"$\\epsilon = {judge.held_out.lapse}$" in FLAT
    one, other = map(short, judge.groups.noise_shares)
    assert f"$c$, {one} or {other}, is the share of $v_m$" in FLAT
    assert f"(S_m + {judge.variance_steps:.0f} s^2) / (N_m + {judge.variance_steps:.0f}) / N_m$" in FLAT
