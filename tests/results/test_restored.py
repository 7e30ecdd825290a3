"""An audit as a dict with its arrays, and back: nothing is lost, and an edited dict is refused with one sentence."""

from __future__ import annotations

import copy
import json
from dataclasses import fields, replace

import numpy as np
import pytest

import rpil
from audits import make_audit
from problems import make
from rpil import RPIL, Audit
from rpil.data.errors import DataError
from rpil.data.plain import to_plain
from rpil.results.subset import select
from rpil.results.tasks import join_audits
from small import FAST


@pytest.fixture(scope="module")
def fitted():
    """Audits of one fit, of a part, of tasks, and after answers."""
    demonstrations = make("random", 0, n_good=8, n_bad=3, steps=(20, 30)).demonstrations
    who = [m % 2 for m in range(11)]
    one = RPIL(settings=FAST).fit(demonstrations, demonstrators=who, order=range(11)).audit_
    one = replace(one, sessions=("a",) * 5 + ("b",) * 6, order=np.arange(11.0))
    parts = {"x": select(one, range(6)), "y": select(one, range(6, 11))}
    places = {"x": [*range(6)], "y": [*range(6, 11)]}
    tasks = join_audits(parts, places, demonstrations.ids, demonstrations.offsets)
    words = {one.ids[0]: "good", one.ids[9]: "bad", one.ids[3]: f"same as {one.ids[5]}"}
    said = rpil.audit(demonstrations, words, settings=FAST)
    mixture = RPIL(adversary="uniform").fit(demonstrations).audit_
    return {"one": one, "part": parts["y"], "tasks": tasks, "answered": said, "mixture": mixture}


def through_json(audit):
    return json.loads(json.dumps(audit.to_dict(arrays=True), allow_nan=False))


@pytest.mark.parametrize("name", ["one", "part", "tasks", "answered", "mixture"])
def test_an_audit_comes_back_bit_for_bit(fitted, name):
    audit = fitted[name]
    again = Audit.from_dict(through_json(audit))
    assert to_plain(again) == to_plain(audit)
    for field in fields(audit):
        value = getattr(audit, field.name)
        assert type(getattr(again, field.name)) is type(value), field.name
        if isinstance(value, np.ndarray):
            assert getattr(again, field.name).dtype == value.dtype
            assert getattr(again, field.name).tobytes() == value.tobytes()
    assert again.to_dict() == audit.to_dict()
    assert repr(again) == repr(audit)
    assert again._repr_html_() == audit._repr_html_()
    assert again.run_id == audit.run_id
    assert again.reasons == audit.reasons
    assert again.provenance == audit.provenance


@pytest.mark.parametrize("name", ["one", "part", "tasks"])
def test_it_is_answered_and_asked_alike(fitted, name):
    audit = fitted[name]
    again = Audit.from_dict(through_json(audit))
    assert again.suggest_labels(2) == audit.suggest_labels(2)
    labels = {audit.ids[0]: "good", audit.ids[-1]: "bad"}
    assert to_plain(again.answered(labels)) == to_plain(audit.answered(labels))
    assert again.answered(labels).reasons != audit.reasons


def test_it_is_drawn_alike(fitted):
    again = Audit.from_dict(through_json(fitted["one"]))
    for picture in ("ranking", "sessions"):
        lines = [getattr(audit.plot, picture)().ax_.get_lines() for audit in (again, fitted["one"])]
        assert len(lines[0]) == len(lines[1])
        for one, other in zip(*lines, strict=True):
            np.testing.assert_array_equal(one.get_xydata(), other.get_xydata())


def test_without_arrays_it_says_how_to_make_them():
    for found in (make_audit().to_dict(), {}):
        with pytest.raises(DataError, match=r"no arrays of an audit; make it with to_dict\(arrays=True\)"):
            Audit.from_dict(found)


def edits(audit):
    """Dicts in which one field is another one's, or of other values."""
    whole = through_json(audit)
    for name in whole["audit"]:
        for value in (None, 5, "x", [], ["x"], {}, [[1]], {"type": "float64", "shape": [1], "values": [0.5]}):
            yield name, value


@pytest.mark.parametrize("name", ["one", "answered"])
def test_edited_dicts_are_refused_or_make_an_audit_that_can_be_used(fitted, name):
    whole, refused = through_json(fitted[name]), []
    for field, value in edits(fitted[name]):
        changed = whole | {"audit": copy.deepcopy(whole["audit"]) | {field: value}}
        try:
            found = Audit.from_dict(changed)
        except DataError as error:
            refused.append(str(error))
            continue
        json.dumps(found.to_dict())
        found.to_frame("pyarrow")
        assert len(found.reasons) == len(found.ids)
        assert repr(found) != found._repr_html_()
    assert len(refused) > 100
    start = "The dict of the audit: its parts do not belong together"
    assert all(sentence.startswith(start) and ". " not in sentence for sentence in refused)


@pytest.mark.parametrize(
    "change",
    [
        {"ids": ["x"] * 10},
        {"finding": "all are kings"},
        {"verdicts": ["typical"] * 9},
        {"anchor": "faith"},
        {"contradicting": ["nobody"]},
        {"order": {"type": "float64", "shape": [10], "values": ["inf"] * 10}},
        {"prior": {"mean": "nan", "low": 0.1, "high": 0.9}},
        {"expert_proba": {"type": "float64", "shape": [10], "values": [5.0] * 10}},
        {"copy_of": {"type": "int64", "shape": [10], "values": [99] * 10}},
        {"log_odds": {"type": "float64", "shape": [10], "values": ["nan"] * 10}},
        {"offsets": {"type": "int64", "shape": [11], "values": [0] * 11}},
    ],
)
def test_values_that_do_not_belong_together_are_refused(change):
    whole = through_json(make_audit())
    with pytest.raises(DataError, match="its parts do not belong together"):
        Audit.from_dict(whole | {"audit": whole["audit"] | change})


@pytest.mark.parametrize("name", ["pairs", "tied"])
@pytest.mark.parametrize("other", [-1, 10])
def test_pairs_of_other_demonstrations_are_refused(name, other):
    whole = through_json(make_audit())
    whole["audit"]["answers"][name] = {"type": "int64", "shape": [1, 2], "values": [0, other]}
    with pytest.raises(DataError, match="its parts do not belong together"):
        Audit.from_dict(whole)


def test_a_recording_of_tasks_says_within_what(fitted):
    assert fitted["tasks"].within == "tasks"
    assert Audit.from_dict(through_json(fitted["tasks"])).within == "tasks"
    assert fitted["one"].within == ""


@pytest.mark.parametrize("change", [{"parts": []}, {"taken": ["left"]}])
def test_traces_of_other_steps_are_refused(fitted, change):
    whole = through_json(fitted["one"])
    traces = whole["audit"]["traces"]
    one = next(iter(traces.values())) if isinstance(traces, dict) else traces[0][1]
    one |= change
    with pytest.raises(DataError, match="its parts do not belong together"):
        Audit.from_dict(whole)
