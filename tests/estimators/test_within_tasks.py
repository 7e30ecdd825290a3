"""A recording is judged within its tasks and sessions, from Python as by the command."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.compute
import pyarrow.parquet as pq
import pytest

import rpil
from problems import coefficients, make, refused
from rpil import Demonstrations
from rpil.data.errors import DataError
from rpil.estimators.pipeline import FitOptions
from rpil.estimators.task import with_reference
from rpil.estimators.within_tasks import Statements, fit_within_tasks
from rpil.formats import table as flat
from rpil.results.judged import ALONE
from small import FAST, SMALL


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Two tasks whose experts act in opposite ways; the second one's operator is another."""
    table = flat.from_demonstrations(make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations, {})
    episode = table.column_names.index("episode_index")
    action = table.column_names.index("action")
    mirrored = table.set_column(action, "action", pa.array(2 - table["action"].to_numpy()))
    left = pa.array([int(name[1:]) for name in table["episode_index"].to_pylist()])
    table = table.set_column(episode, "episode_index", left)
    mirrored = mirrored.set_column(episode, "episode_index", pa.compute.add(left, 100))
    tasks, n = pa.concat_tables([table, mirrored]), len(table)
    path = tmp_path_factory.mktemp("tasks") / "both.parquet"
    tasks = tasks.append_column("task", [["left"] * n + ["right"] * n])
    pq.write_table(tasks.append_column("who", [["Ann"] * n + ["Bob"] * n]), path)
    return path


def rpil_of(recording, **options):
    return rpil.RPIL(features="folded", settings=FAST).fit(recording, **options)


@pytest.fixture(scope="module")
def judged(both):
    return rpil_of(rpil.open(both))


def test_each_task_is_judged_as_if_it_were_alone(both, judged, tmp_path):
    pq.write_table(pq.read_table(both, filters=[("task", "=", "left")]), tmp_path / "left.parquet")
    alone = rpil_of(rpil.open(tmp_path / "left.parquet")).audit_
    np.testing.assert_array_equal(judged.audit_.log_odds[: len(alone.ids)], alone.log_odds)


def test_one_policy_is_learned_from_all_tasks(both, judged):
    demonstrations = rpil.read(both)
    weighted = rpil.BehavioralCloning(features="folded").fit(
        demonstrations.observations, demonstrations.actions, sample_weight=judged.audit_.step_weight
    )
    (found, _), (expected, _) = coefficients(judged), coefficients(weighted)
    np.testing.assert_allclose(found, expected, atol=0.05 * np.abs(expected).max())
    assert judged.predict(demonstrations.observations).shape == demonstrations.actions.shape


@pytest.mark.parametrize("outcome", [None, {m: m % 100 % 4 for m in (*range(11), *range(100, 111))}])
def test_an_answer_that_is_added_says_the_same_as_one_that_was_given(both, outcome):
    labels = {0: "good", 9: "bad", 10: "bad", 2: "better than 108", 100: "good", 109: "bad", (104, 2, 9): "bad"}
    audit, added = (rpil.audit(both, given, outcome, settings=FAST, session="who") for given in (labels, None))
    assert np.nonzero(audit.verdicts != np.array("open"))[0].max() > 11, "answers about one task say more of another"
    for name, word in labels.items():
        added = added.answered({name: word})
    for name in ("log_odds", "verdicts", "rejected_by", "said", "notes", "doubts", "method", "reasons"):
        np.testing.assert_array_equal(getattr(added, name), getattr(audit, name), name)
    np.testing.assert_allclose(added.step_weight, audit.step_weight)
    taken_back = added.answered({0: "good", 10: "bad"}, instead=True)
    assert np.flatnonzero(taken_back.answers.labels).tolist() == [0, 10]


def test_labels_and_pairs_go_to_their_task_beside_a_reference(both, tmp_path):
    labels = [(0, "good"), (1, "better than 101"), (2, "better than 9"), (3, "same as 5"), (4, "same as 102")]
    stated = Statements.of(rpil.open(both), labels, None, None, rpil.open(both))
    options = FitOptions("folded", "auto", 0, FAST, lambda _: None)
    audit, _ = fit_within_tasks(rpil.open(both), stated, options, keeps_policy=False)
    assert (audit.ids, audit.answers.labels.tolist()) == (rpil.open(both).demonstrations.ids, [1] + [0] * 21)
    assert (audit.answers.pairs.tolist(), audit.answers.tied.tolist()) == ([[1, 12], [2, 9]], [[3, 5], [13, 4]])
    assert (audit.step_weight.mean(), audit.method[0].count(" (11: ")) == (pytest.approx(1), 2), "of the data alone"
    without, _ = fit_within_tasks(rpil.open(both), replace(stated, reference=None), options, keeps_policy=False)
    assert (without.log_odds != audit.log_odds)[1:].all(), "the reference is evidence in both tasks"
    pq.write_table(pq.read_table(both, filters=[("task", "=", "left")]), path := tmp_path / "left.parquet")
    left, _ = fit_within_tasks(rpil.open(both), replace(stated, reference=rpil.open(path)), options, keeps_policy=False)
    assert (left.from_actions == without.from_actions)[11:].all()
    assert (left.log_odds != without.log_odds)[1:11].all(), "a reference of one task is evidence in this one alone"
    with pytest.raises(DataError, match="no demonstration of the reference has a task of the data"):
        fit_within_tasks(rpil.open(both), replace(stated, reference=rpil.open(path, task="who")), options)


@pytest.mark.parametrize(("label", "sign"), [("good", 1), ("bad", -1), ("", 0)])
def test_a_demonstration_that_is_alone_has_the_word_of_its_label_and_else_none(both, tmp_path, label, sign):
    table = pq.read_table(both)
    owner, task = table["episode_index"].to_numpy(), table["task"].to_pylist()
    tasks = ["alone" if m == 110 else name for m, name in zip(owner, task, strict=True)]
    path = tmp_path / "alone.parquet"
    pq.write_table(table.set_column(table.column_names.index("task"), "task", [tasks]), path)
    labels = {0: "good", 1: "good", 9: "bad", 100: "good"} | ({110: label} if label else {})
    audit = rpil.audit(path, labels, settings=FAST)
    m, odds = audit.ids.index(110), 1e6 - 1  # P(good) is 1 - 1e-6 (`AnswerSettings.min_proba_bound`)
    assert audit.log_odds[m] == pytest.approx(sign * np.log(odds))
    assert (audit.verdicts[m], audit.reasons[m]) == ((label, f"Labelled {label}.") if sign else ("open", ALONE))
    assert audit.rejected_by[m] == ("labels" if sign < 0 else "")
    fitted = rpil_of(rpil.open(path), labels=labels | {110: label} if label else labels).audit_
    assert (fitted.step_weight[fitted.offsets[m]] < 1e-5) == (sign < 0)
    failed = rpil.audit(path, outcome={n: float(n != 110) for n in audit.ids}, settings=FAST)
    assert (failed.verdicts[m], failed.reasons[m], failed.rejected_by[m]) == ("bad", "outcome 0.", "outcome")
    mixture = rpil.RPIL(adversary="uniform", features="folded", settings=FAST)
    mixed = mixture.fit(rpil.open(path), labels=labels).audit_
    with pytest.raises(DataError, match="leave out pairs and the outcome"):
        mixture.fit(rpil.open(both), labels=[(0, "better than 108")])
    assert (mixed.step_weight[mixed.offsets[m]] == 0) == (sign < 0)


def test_every_demonstration_may_be_alone_and_its_operator_and_takeovers_count(both, tmp_path):
    table = pq.read_table(both)
    owner = table["episode_index"].to_numpy()
    table = table.append_column("intervention", pa.array(owner % 2 == 0))
    for k, tasks in enumerate(([f"task {m}" for m in owner], np.where(owner == 110, "alone", table["task"]).tolist())):
        own = table.set_column(table.column_names.index("task"), "task", [tasks])
        pq.write_table(own, path := tmp_path / f"{k}.parquet")
        audit = rpil.audit(path, {0: "good", 110: "bad"}, settings=FAST, operator="who")
        assert [(one.name, len(one.demonstrations)) for one in audit.demonstrators] == [("Ann", 11), ("Bob", 11)]
        assert audit.verdicts[-1] == "bad"
        assert "A person took over in 12 of 22" in " ".join(audit.notes)
    said = rpil.audit(tmp_path / "0.parquet", outcome={m: m % 3 for m in audit.ids}, settings=FAST)
    assert ({*said.verdicts}, rpil_of(rpil.open(tmp_path / "0.parquet")).audit_.ids) == ({"open"}, audit.ids)


def test_groups_of_a_task_wait_for_an_answer_of_their_own(both):
    audit = rpil.audit(both, settings=FAST)
    notes = ("right: The two groups: A.",)
    groups = replace(audit, identifiable=False, competing=((100, 101), (109, 110)), notes=notes)
    for labels, is_told in (({0: "good", 10: "bad"}, False), ({100: "good", 110: "bad"}, True)):
        found = groups.answered(labels)
        assert (found.identifiable, found.competing == (), found.notes == ()) == (is_told,) * 3
        other = [m for m, name in enumerate(found.ids) if (name < 100) == is_told]
        assert {found.verdicts[m] for m in other} <= {"open", "outlier"}, "that has no answer"


def test_what_was_named_when_it_was_opened_is_used(both):
    audit = rpil_of(rpil.open(both, exclude="task", operator="who")).audit_
    assert {one.name for one in audit.demonstrators} == {"Ann", "Bob"}
    assert not rpil_of(rpil.open(both, exclude="task")).audit_.demonstrators
    by_hand = rpil_of(rpil.open(both, exclude="task"), demonstrators=["Ann"] * 11 + ["Bob"] * 11).audit_
    np.testing.assert_array_equal(audit.log_odds, by_hand.log_odds)
    with pytest.raises(DataError, match="give one for each of the 22 demonstrations"):
        rpil_of(rpil.open(both), demonstrators=["Ann"] * 3)
    sessions = rpil_of(rpil.open(both, exclude="task", session="who")).audit_
    assert sessions.assumptions[0].startswith("Demonstrations are judged within their sessions: Ann (11:")
    assert sessions.sessions == ("Ann",) * 11 + ("Bob",) * 11


def test_data_on_disk(both, judged):
    on_disk = rpil.open(both, on_disk=True)
    assert isinstance(on_disk.demonstrations, rpil.Dataset)
    np.testing.assert_allclose(rpil_of(on_disk).audit_.log_odds, judged.audit_.log_odds)
    one_task = rpil.RPIL(features="folded", settings=SMALL).fit(rpil.open(both, on_disk=True, exclude="task"))
    assert len(one_task.audit_.ids) == 22


RNG = np.random.default_rng(0)


def some(n, ids=None, names=("x", "v"), actions=1, source="a.csv", action_names=()):
    episodes = [(RNG.normal(size=(5, len(names))), RNG.normal(size=(5, actions))) for _ in range(n)]
    made = Demonstrations.from_episodes(episodes, ids, observation_names=names, source=source)
    return replace(made, action_names=action_names)


def test_reference_comes_last_and_no_ids_clash():
    for ids, prefix in ((None, ""), (["0", "reference 0", "a"], " 2"), (["0", "reference 0", "reference 2 0"], " 3")):
        one, other = some(3, ids), some(2, source="good.csv")
        both = with_reference(one, other)
        assert both.ids == (*map(str, one.ids), f"reference{prefix} 0", f"reference{prefix} 1")
        for m in range(5):
            expected = one[m] if m < 3 else other[m - 3]
            for found, value in zip(both[m], expected, strict=True):
                np.testing.assert_array_equal(found, value)


def test_columns_in_another_order_are_matched_by_name():
    one, other = some(2), some(2, names=("v", "x"))
    both = with_reference(one, other)
    assert both.observation_names == ("x", "v")
    np.testing.assert_array_equal(both[2][0], other[0][0][:, ::-1])


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (some(2, names=("x",), source="b.csv"), "lacks 'v'"),
        (some(2, names=("x", "v", "w"), source="b.csv"), "has 'w' too"),
        (some(2, actions=2, source="b.csv"), "2 continuous numbers, and those of a.csv are 1 continuous"),
        (some(2, action_names=("grip",), source="b.csv"), "grip"),
        (replace(some(2, source="b.csv"), actions=np.arange(10) % 2, action_kind="discrete"), "discrete"),
    ],
)
def test_other_observations_or_actions_are_refused(other, words):
    with refused(rf"^b\.csv.*{words}"):
        with_reference(some(2), other)
