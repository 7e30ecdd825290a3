"""Every field of an audit is selected and joined, and saved with a model; a damaged file is refused in one sentence."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from time import process_time

import numpy as np
import pytest

import rpil
from archives import npy, rewrite
from audits import make_audit, make_traces
from problems import make
from rpil import RPIL, Audit
from rpil.data.errors import DataError
from rpil.inference.answers import Answers
from rpil.results.html.page import render_page
from rpil.results.judged import Judged, table_fields
from rpil.results.provenance import Provenance
from rpil.results.record import Demonstrator, Interval
from rpil.results.tasks import join_audits, select
from rpil.results.view import About, make_view
from small import FAST

IDS = tuple(f"d{k}" for k in range(10))
ABOUT = About("Audit", "x.csv")


def full_audit() -> Audit:
    """An audit in which no field is empty."""
    rng, n = np.random.default_rng(0), 10
    pairs = {"pairs": np.array([[0, 1], [3, 4]]), "tied": np.array([[2, 3]])}
    ends = np.column_stack([np.where(np.arange(n) % 2, np.nan, 1.0), np.arange(n) / 2])
    return make_audit(
        ids=IDS,
        lengths=[80, *range(31, 40)],
        answers=Answers(np.array([0, 1, -1] + [0] * 7), outcomes=ends, **pairs, names=("a", "-b")),
        competing=(IDS[:4], IDS[4:]),
        pair=("d1", "d3"),
        demonstrators=(
            Demonstrator("ann", Interval(0.8, 0.5, 0.9), IDS[:5]),
            Demonstrator(3, Interval(0.4, 0.1, 0.9), IDS[5:]),
        ),
        taken_over=rng.integers(-1, 2, 395).astype(float),
        contradicting=("d2",),
        doubts=("A doubt.",),
        notes=("A note.", "The two groups: differ."),
        columns=rng.normal(size=(n, 5)),
        claimed=np.arange(n) % 3 - 1,
        part=(np.arange(n) % 5 - 2) / 2,
        copy_of=np.array([0, 1, 2, 0, 4, 0, 6, 7, 8, 2]),
        deviations=("It drops.", *[""] * 9),
        sessions=("mon",) * 5 + ("tue",) * 5,
        order=np.arange(10.0)[::-1],
        traces={name: make_traces(length) for name, length in (("d0", 80), ("d3", 33))},
        own_reasons=tuple(f"For {name}." for name in IDS),
        within="tasks",
        fps=30.0,
        provenance=Provenance("1", "rpil audit", 0, {"x": ("a", 1, None)}, ()),
        rejected_by=("", "", "labels", "outcome", "answers", "adversary", "", "", "", ""),
        **{name: rng.random(n) for name in ("from_actions", "from_demonstrator", "from_label")},
    )


def same(one: object, other: object) -> bool:
    """Whether two values have the same types and the same bits."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    if is_dataclass(one):
        names = (field.name for field in fields(one))
        return type(one) is type(other) and all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[name], other[name]) for name in one)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return type(one) is type(other) and one == other


@pytest.fixture(scope="module")
def audits() -> dict[str, Audit]:
    demonstrations = make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations
    one = RPIL(settings=FAST).fit(demonstrations, demonstrators=[m % 2 for m in range(11)]).audit_
    one = replace(one, order=np.arange(11.0))
    parts = {"x": select(one, range(6)), "y": select(one, range(6, 11))}
    places = {"x": [*range(6)], "y": [*range(6, 11)]}
    tasks = join_audits(parts, places, demonstrations.ids, demonstrations.offsets)
    return {"full": full_audit(), "made": make_audit(), "part": parts["y"], "tasks": tasks}


@pytest.fixture(scope="module")
def model() -> RPIL:
    return RPIL(settings=FAST).fit(make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations)


@pytest.fixture
def path(model, tmp_path):
    model.audit_ = full_audit()
    rpil.save(model, tmp_path / "run.rpil")
    return tmp_path / "run.rpil"


@pytest.mark.parametrize("name", ["full", "made", "part", "tasks"])
def test_an_audit_is_loaded_bit_for_bit_and_used_alike(audits, name, model, tmp_path):
    model.audit_ = audit = audits[name]
    rpil.save(model, tmp_path / "run.rpil")
    again = rpil.load(tmp_path / "run.rpil").audit_
    for field in fields(audit):
        assert same(getattr(again, field.name), getattr(audit, field.name)), field.name
    assert again.to_dict() == audit.to_dict()
    assert repr(again) + again._repr_html_() == repr(audit) + audit._repr_html_()
    assert again.suggest_labels(2) == audit.suggest_labels(2)
    if audit.columns.size:
        labels = {audit.ids[0]: "good", audit.ids[-1]: "bad"}
        assert same(again.answered(labels), audit.answered(labels))


def test_no_field_of_the_full_audit_is_its_default():
    audit, default = full_audit(), make_audit()
    given = ("offsets", "finding", "prior", "adversary", "assumptions", "settings", "anchor", "identifiable")
    changed = [field.name for field in fields(audit) if same(getattr(audit, field.name), getattr(default, field.name))]
    assert set(changed) <= {*given, "verdicts"}


@pytest.mark.parametrize(("name", "axis", "nothing"), [*table_fields(Judged)])
def test_a_column_is_selected_and_joined(name, axis, nothing):
    audit, chosen = full_audit(), [5, 0, 7]
    rows = {"M": [[m] for m in range(10)], "N": [np.r_[audit.steps(m)] for m in range(10)]}[axis]
    column = np.array(getattr(audit, name))
    part = select(audit, chosen, ["a", "b", "c"])
    taken = getattr(part, name)
    assert type(taken) is type(getattr(audit, name))
    np.testing.assert_array_equal(np.array(taken), column[np.concatenate([rows[m] for m in chosen])])
    parts = {"odd": select(audit, [1, 3, 5, 7]), "even": select(audit, [0, 2, 4, 6, 8])}
    places = {"odd": [1, 3, 5, 7], "even": [0, 2, 4, 6, 8], "alone": [9]}
    joined = getattr(join_audits(parts, places, IDS, audit.offsets), name)
    if name == "order":
        assert joined is None
    else:
        last = np.concatenate([rows[m] for m in range(9)])
        np.testing.assert_array_equal(np.array(joined)[last], column[last])
        assert np.all(np.array(joined)[rows[9]] == nothing)


def test_names_of_demonstrations_that_are_left_out_are_left_out():
    audit = full_audit()
    part = select(audit, [3, 0, 2], ["a", "b", "c"])
    assert part.ids == ("a", "b", "c")
    assert part.offsets.tolist() == [0, 33, 113, 145]
    assert (part.pair, part.competing, part.contradicting) == ((), (("b", "c", "a"), ()), ("c",))  # no pair of one
    assert part.demonstrators == (replace(audit.demonstrators[0], demonstrations=("b", "c", "a")),)
    assert same(part.traces, {"b": audit.traces["d0"], "a": audit.traces["d3"]})
    assert part.answers.labels.tolist() == [0, 0, -1]
    assert (part.answers.pairs.tolist(), part.answers.tied.tolist()) == ([], [[2, 0]])
    assert select(audit, [9, 3, 5, 1]).copy_of.tolist() == [0, 1, 1, 3], "they stay copies without the first of them"
    assert select(audit, [1, 3]).pair == audit.pair


def test_answers_about_those_that_are_left_out_count():
    """As the labels of a reference do, beside which the others were judged."""
    audit = make_audit(("good",) * 2 + ("bad",) * 8, labels={0: 1, 9: -1}, anchor="answers")
    part = select(audit, range(2, 10))
    assert (part.answers.count, part.choice.kept) == (1, ())
    assert len(select(make_audit(audit.verdicts, labels={0: 1}), range(2, 10)).choice.kept) == 8


def test_many_demonstrations_are_selected_in_no_time():
    """Those of 20,000 are looked up in 20,000 steps, and not in 200 million."""
    n = 20_000
    audit = make_audit(("open",) * n, lengths=np.ones(n, int), copy_of=np.arange(n) // 2 * 2, own_reasons=("",) * n)
    object.__setattr__(audit, "reasons", ("",) * n)
    start = process_time()
    part = select(audit, range(n)[::-1])
    assert process_time() - start < 1
    np.testing.assert_array_equal(part.copy_of, np.arange(n) // 2 * 2)


def refused(path, match=r"its parts do not belong together|damaged|hold"):
    """It is refused in one sentence that names the file and the remedy."""
    with pytest.raises(DataError, match=rf"run\.rpil[^\n]*: [^\n]*(?:{match})") as caught:
        rpil.load(path)
    assert str(caught.value).endswith(".")
    assert len(str(caught.value)) < 700


def set_in(tree, place, value):
    *above, last = place.split("/")
    for key in above:
        tree = tree[int(key) if key.isdigit() else key]
    tree[int(last) if last.isdigit() else last] = value


def test_an_edited_field_is_refused_or_makes_an_audit_that_can_be_used(path):
    kept, values = path.read_bytes(), (None, -0.5, ["x"], {"pairs": []}, {"array": "audit/step_weight"}, 1e999)
    for name, value in ((field.name, value) for k, field in enumerate(fields(Audit)) for value in values[k % 3 :: 3]):
        path.write_bytes(kept)
        rewrite(path, header=lambda tree, name=name, value=value: set_in(tree, f"fitted/audit_/fields/{name}", value))
        try:
            audit = rpil.load(path).audit_
        except DataError:
            refused(path, "its parts do not belong together; fit and save it again")
            continue
        render_page(make_view(audit, ABOUT))
        assert len(audit.to_frame("pyarrow")) == len(audit.reasons) == 10


def test_arrays_that_do_not_belong_together_are_refused(path):
    kept = path.read_bytes()
    for member, array in (
        ("audit/log_odds", None),
        ("audit/log_odds", np.full(10, np.nan)),
        ("audit/log_odds", np.zeros(9)),
        ("audit/log_odds", np.zeros(10, dtype=np.int64)),
        ("audit/expert_proba", np.full(10, 5.0)),
        ("audit/step_weight", np.full(395, -0.5)),
        ("audit/copy_of", np.full(10, 99)),
        ("audit/claimed", np.full(10, 2)),
        ("audit/offsets", np.zeros(11, dtype=np.int64)),
        ("audit/order", np.full(10, np.inf)),
        ("audit/part", np.full(10, 1.5)),
        ("audit/answers/labels", np.full(10, 3)),
        ("audit/answers/pairs", np.array([[0, -1]])),
        ("audit/answers/tied", np.array([[0, 10]])),
        ("audit/traces/0/parts/0/value", np.zeros(79)),
        ("audit/log_odds", np.array([{}] * 10)),
        ("more", np.ones(3)),
    ):
        path.write_bytes(kept)
        rewrite(path, {f"{member}.npy": None if array is None else npy(array)})
        refused(path, "its parts do not belong together|never unpickled")


def test_edited_values_are_refused(path):
    kept = path.read_bytes()
    for place, value in (
        ("fields/ids", ["x"] * 10),
        ("fields/ids/0", ["d0"]),
        ("fields/finding", "all are kings"),
        ("fields/verdicts/0", "constructor"),
        ("fields/anchor", "faith"),
        ("fields/contradicting", ["nobody"]),
        ("fields/demonstrators/0/fields/demonstrations", ["nobody"]),
        ("fields/demonstrators/1/fields/trust", None),
        ("fields/prior/fields/mean", float("nan")),
        ("fields/traces/pairs/0/1/fields/parts", []),
        ("fields/traces/pairs/0/1/fields/taken", ["left"]),
        ("fields/traces/pairs/0/1/fields/compared_with", "javascript:"),
        ("fields/answers/class", "Interval"),
        ("class", "os.system"),
        ("fields/fps", -1.0),
        ("fields/fps", True),
    ):
        path.write_bytes(kept)
        rewrite(path, header=lambda tree, place=place, value=value: set_in(tree, f"fitted/audit_/{place}", value))
        refused(path, "fit and save it again")
