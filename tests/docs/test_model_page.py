"""docs/model.md: its table has the settings of the judge, its other constants are theirs, and its modules exist."""

from __future__ import annotations

import re
from pathlib import Path

from rpil.inference import settings
from rpil.inference.channels import CHANNELS
from rpil.inference.groups import CLUSTER_DISTANCE

TEXT = (Path(__file__).parents[2] / "docs" / "model.md").read_text(encoding="utf-8")
FLAT = " ".join(TEXT.split())


def test_settings_in_the_table_are_those_of_the_judge():
    named = re.findall(r"`(\w+)\.(\w+) = ([\d.]+)`", TEXT)
    assert len(named) > 12
    for record, name, value in named:
        assert getattr(getattr(settings, record)(), name) == float(value), f"{record}.{name}"


def test_constants_of_answers_are_those_of_the_judge():
    answers = settings.AnswerSettings()
    *rates, rate = (f"{rate:g}".removeprefix("0") for rate in answers.error_rates)
    assert f"with probability {1 - answers.p_agreement:.2f} beforehand".replace("0.", ".") in FLAT
    assert f"The **error rate** $e$ is {', '.join(rates)} or {rate}." in FLAT
    assert f"have the precision {answers.component_precision}," in FLAT
    assert settings.ChannelSettings().n_components == 8
    assert "up to eight **components**" in FLAT
    assert f"the **sharpness** {answers.sharpness}" in FLAT
    assert f"$w_0$ is 1 on agreement, {answers.group_weight:.0f} on the group" in FLAT
    assert f"within {answers.max_group_log_odds:.0f} nats" in FLAT
    assert f"$\\Lambda$ is {answers.weak_precision:.0f} on the channels" in FLAT
    *lucks, last = (f"{luck:g}".removeprefix("0") for luck in answers.luck[1:])
    assert f"in a share $\\ell$, {answers.luck[0]:g}, {', '.join(lucks)} or {last}, of" in FLAT
    *places, last = (f"{place:g}".removeprefix("0") for place in answers.asked_quantiles)
    assert f"at the places {', '.join(places)} and {last} of the ranking" in FLAT
    assert f"of at most {answers.max_left_out} answers" in FLAT
    assert f"({', '.join(CHANNELS)})" in FLAT


def test_constants_of_scores_are_those_of_the_judge():
    judge = settings.JudgeSettings()
    assert f"the {judge.trimming.share:.0%}".replace("%", " %") in FLAT
    assert rf"$\mu_1 - \mu_0 > {CLUSTER_DISTANCE:.0f} \sqrt{{t_0}}$" in FLAT
    assert judge.trimming.max_iter == 4
    assert "at most four times" in FLAT


def test_constants_of_rivals_are_those_of_the_judge():
    rivals = settings.RivalSettings()
    rows = dict(re.findall(r"^\| ([a-z ]+) \|(.*)", TEXT, re.MULTILINE))
    assert rivals.standard_errors == 2.0
    assert "if it is above 0 by two robust standard errors" in FLAT
    assert f"at most {rivals.max_noise} of".replace("0.", ".") in rows["by chance"]
    assert rivals.max_shared_gain == 0.5
    assert "gains less than half as much on $B$" in FLAT
    assert rivals.min_own_gain == 1 / 3
    assert "less than a third of what" in rows["no second way"]
    assert f"by {settings.JudgeSettings().min_gain:g} nats".replace("0.", ".") in rows["something learned"]


def test_constants_of_steps_are_those_of_the_judge():
    judge = settings.JudgeSettings()
    assert f"continues with probability {judge.steps.stay}.".replace("0.", ".") in FLAT
    assert judge.steps.p_stretches == 0.5
    assert "at even odds, in stretches" in FLAT
    assert f"uniform on {judge.reliability_nodes} values" in FLAT
    assert f"at least {judge.steps.whole_reliability} of that of a similar".replace("0.", ".") in FLAT
