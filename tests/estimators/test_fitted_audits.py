"""The audits of fitted models: two groups that compete, and which labels they ask for."""

from __future__ import annotations

from sklearn.metrics import roc_auc_score

from problems import make
from rpil import RPIL, load, save


def test_competing_groups_are_open_and_one_of_each_is_asked_about():
    toy = make("shifted", 1, steps=(40, 60))
    audit = RPIL().fit(toy.demonstrations).audit_
    assert audit.finding == "two groups"
    assert set(audit.verdicts) == {"open"}
    assert (audit.expert_proba == 0.5).all()
    assert not audit.identifiable
    assert {frozenset(group) for group in audit.competing} == {frozenset(toy.ids[:6]), frozenset(toy.ids[6:])}
    assert [name in group for name, group in zip(audit.pair, audit.competing, strict=True)] == [True, True]
    sizes, policies = audit.notes
    assert sizes.startswith("The two groups: ")
    assert policies.startswith("The two groups: they differ most where they take action ")
    assert set(audit.notes) < set(audit.assumptions)


def test_suggestions_leave_out_labels_and_survive_a_file(tmp_path):
    toy = make("noisy", 0, n_good=6, n_bad=6)
    model = RPIL(adversary="uniform").fit(toy.demonstrations, labels={"d0": "good"})
    audit = model.audit_
    assert audit.labelled == ("d0",)
    assert "d0" not in audit.suggest_labels(12)
    assert len(audit.suggest_labels(12)) == 11
    save(model, tmp_path / "model")
    assert load(tmp_path / "model").audit_.suggest_labels(4) == audit.suggest_labels(4)


def test_the_answered_pair_decides_between_competing_groups():
    toy = make("flipped", 3, n_actions=4, n_good=6, n_bad=6, steps=(60, 60))
    audit = RPIL().fit(toy.demonstrations).audit_
    assert audit.finding == "two groups"
    is_good = dict(zip(toy.ids, toy.is_good, strict=True))
    better, worse = sorted(audit.pair, key=lambda name: not is_good[name])
    assert is_good[better] > is_good[worse]
    labelled = RPIL().fit(toy.demonstrations, labels={better: f"better than {worse}"}).audit_
    assert not labelled.identifiable
    assert labelled.competing
    assert set(labelled.verdicts) == {"open"}  # one answer alone
    assert roc_auc_score(toy.is_good, labelled.log_odds) > 0.95
    both = labelled.answered(
        {labelled.suggest_labels(1)[0]: "good" if is_good[labelled.suggest_labels(1)[0]] else "bad"}
    )
    words = dict(zip(both.ids, both.verdicts, strict=True))
    assert set(words.values()) > {"open"}
    assert all(is_good[name] == (word == "good") for name, word in words.items() if word != "open")
