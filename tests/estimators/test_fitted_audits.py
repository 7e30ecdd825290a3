"""The audits of fitted models: two groups that compete, and which labels they ask for."""

from __future__ import annotations

import numpy as np
import pytest

from problems import make
from rpil import RPIL, AmbiguousWarning, load, save


def test_competing_groups_are_open_and_the_longest_of_each_is_asked_about():
    toy = make("shifted", 1, steps=(40, 60))
    with pytest.warns(AmbiguousWarning, match="two groups of demonstrations") as caught:
        audit = RPIL().fit(toy.demonstrations).audit_
    assert caught[0].filename == __file__
    assert set(audit.verdicts) == {"open"}
    assert (audit.expert_proba == 0.5).all()
    assert not audit.identifiable
    assert {frozenset(group) for group in audit.competing} == {frozenset(toy.ids[:6]), frozenset(toy.ids[6:])}
    lengths = dict(zip(toy.ids, np.diff(toy.offsets).tolist(), strict=True))
    longest = [max(lengths[name] for name in group) for group in audit.competing]
    assert [lengths[name] for name in audit.to_label] == longest


def test_suggestions_leave_out_labels_and_survive_a_file(tmp_path):
    toy = make("noisy", 0, n_good=6, n_bad=6)
    model = RPIL(adversary="uniform").fit(toy.demonstrations, labels={"d0": "good"})
    audit = model.audit_
    assert audit.labelled == ("d0",)
    assert "d0" not in audit.suggest_labels(12)
    assert len(audit.suggest_labels(12)) == 11
    save(model, tmp_path / "model")
    assert load(tmp_path / "model").audit_.suggest_labels(4) == audit.suggest_labels(4)


def test_first_suggested_label_decides_between_competing_groups():
    toy = make("flipped", 3, n_actions=4, n_good=6, n_bad=6, steps=(60, 60))
    with pytest.warns(AmbiguousWarning):
        audit = RPIL().fit(toy.demonstrations).audit_
    (name,) = audit.suggest_labels(1)
    assert name == audit.to_label[0]
    is_good = dict(zip(toy.ids, toy.is_good, strict=True))
    labelled = RPIL().fit(toy.demonstrations, labels={name: "good" if is_good[name] else "bad"}).audit_
    assert labelled.identifiable
    assert [verdict == "good" for verdict in labelled.verdicts] == toy.is_good.tolist()
