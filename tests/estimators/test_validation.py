"""Arguments and data that a fit refuses, each in one sentence."""

import numpy as np
import pytest
from sklearn.base import clone

from problems import make, make_continuous, refused
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rment import RMEnt
from rpil.estimators.rpil import RPIL
from rpil.estimators.task import answers_of


@pytest.mark.parametrize("estimator", [RPIL(), BehavioralCloning(), RMEnt()], ids=lambda e: type(e).__name__)
def test_invalid_continuous_actions_are_refused_in_one_sentence(estimator):
    toy = make_continuous("random", 0)
    same = Demonstrations(toy.observations, np.full_like(toy.actions, 0.5), toy.offsets)
    with refused("every action is the same; give demonstrations with two at least"):
        clone(estimator).fit(same)
    spoiled = toy.actions.copy()
    spoiled[3, 1] = np.nan
    with pytest.raises(ValueError, match="NaN"):
        clone(estimator).fit(toy.observations, spoiled)


@pytest.mark.parametrize("kind", [RPIL, RMEnt])
def test_rows_without_groups_are_refused_unless_each_is_a_demonstration(kind):
    toy = make("random", 0)
    with refused(rf"pass groups=, .* {kind.__name__}\(groups='rows'\)"):
        kind().fit(toy.observations, toy.actions)
    with refused(r"groups='row' in .* is unknown; leave it out, or give 'rows'"):
        kind(groups="row").fit(toy.observations, toy.actions)
    kind().fit(toy.observations, toy.actions, groups=toy.groups)


TOY, UNIFORM = make("random", 0), RPIL(adversary="uniform")

ONE_ACTION = Demonstrations(TOY.observations, np.zeros_like(TOY.actions), TOY.offsets, TOY.ids)


@pytest.mark.parametrize(
    ("model", "given", "words"),
    [
        (RPIL(features="fourier"), {}, "no features called 'fourier'; choose .*raw, folded, nystroem"),
        (BehavioralCloning(C=0.0), {}, "C=0.0 must be a positive number"),
        (BehavioralCloning(), {"X": ONE_ACTION}, "every action is 0, one class only"),
        (RPIL(), {"X": TOY.demonstrations.select([0])}, "1 sample. cannot be compared; give at least two"),
        (RMEnt(1), {"X": TOY.demonstrations.select([0])}, "1 sample. cannot be compared; give at least two"),
        (RMEnt(0), {}, "n_trusted=0 of 12 demonstrations; give a whole number from 1 to 12, or a sh"),
        *((RMEnt(n), {}, f"n_trusted={n!r} of 12") for n in (13, 1.0, 1.5, "all")),
        (RPIL(), {"X": TOY.observations, "y": TOY.actions[:, None] * [1, 1], "groups": TOY.groups}, "combinations"),
        (RMEnt(1), {"X": "a.csv"}, "a.csv: fit takes no path; give rpil.read.PATH., or RPIL rpil.open.PATH."),
        (UNIFORM, {"labels": {"d99": "good"}}, "d99"),
        (UNIFORM, {"labels": {"d0": "great"}}, "'d0': unknown label 'great'"),
        (UNIFORM, {"labels": dict.fromkeys(TOY.ids, "bad")}, "all demonstrations are labelled bad"),
    ],
)
def test_errors_are_one_sentence(model, given, words):
    with refused(words):
        model.fit(**({"X": TOY.demonstrations} | given))


def test_outcomes_are_files_with_their_names_or_numbers(tmp_path):
    path, numbers = tmp_path / "grade.csv", [float(m) for m in range(12)]
    path.write_text("id,value\n" + "".join(f"d{m},{m}\n" for m in range(12)))
    for given, name in ((str(path), "grade"), ([path], "grade"), (numbers, "outcome"), (np.arange(12), "outcome")):
        known = answers_of(None, given, TOY.demonstrations)
        assert (known.names, known.outcomes[:, 0].tolist()) == ((name,), numbers)


@pytest.mark.parametrize(("weight", "words"), [(0.0, "zero"), (-1.0, "[Nn]egative")])
def test_zero_and_negative_sample_weights_are_refused(weight, words):
    with pytest.raises(ValueError, match=words):
        BehavioralCloning().fit(TOY.observations, TOY.actions, sample_weight=np.full(len(TOY.actions), weight))
