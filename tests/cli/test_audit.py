"""What an audit prints: at most 25 lines of 80 columns, whatever the data, and everything with all rows."""

from __future__ import annotations

import dataclasses
import io
import re
import sys

import click
import numpy as np
import pytest
from rich.cells import cell_len

from audits import make_audit
from rpil.cli.audit import MAX_LINES, MAX_ROWS, next_steps, odd_lines, print_audit
from rpil.cli.terminal import THEN_RUN
from rpil.faults.report import FaultReport
from rpil.faults.rule import Fault
from rpil.results.answering import question
from rpil.results.judged import Demonstrator, Interval

COMMAND = ["rpil", "audit", "a folder with a long name/of some drives.csv", "--id", "driver", "--action", "steering"]
VERDICTS = ("outlier",) * 12 + ("open",) * 28
LONG = [f"2026-11-{m:02}_a_very_long_session_of_recordings/operator_anna/episode_{m:04}" for m in range(40)]
PAIR = {"pair": (0, 39), "columns": np.random.default_rng(0).normal(size=(40, 5))}
DEVIATIONS = tuple(
    f"at step {m}: actions.left.joint_{m}.pos is -13.25; others there have -148 to -136" for m in range(40)
)
ANSWERED = {"anchor": "answers", "finding": "answered", "labels": {0: -1, 39: 1}, "contradicting": (0, 1, 2)}
PEOPLE = tuple(Demonstrator(f"operator {k}", Interval(0.9, 0.8, 1), tuple(range(4 * k, 4 * k + 4))) for k in range(10))
DOUBT = (
    "The answers do not predict each other by any measured fact, so that no other demonstration gets a verdict; check "
    "some of the answers, or answer about further ones."
)
NOTES = ("The two groups: A has 20 demonstrations and B 20; B takes longer, is smoother and has a longer path.",) * 3
KINDS = {
    "nobody": make_audit(("open",) * 40, finding="no outliers", **PAIR),
    "outliers": make_audit(VERDICTS, deviations=DEVIATIONS, fps=20.0, **PAIR),
    "two groups": make_audit(
        ("open",) * 40, finding="two groups", competing=(tuple(range(20)), tuple(range(20, 40))), notes=NOTES, **PAIR
    ),
    "a group apart": make_audit(
        ("open",) * 40, finding="a group apart", competing=(tuple(range(8, 40)), tuple(range(8))), notes=NOTES, **PAIR
    ),
    "doubt": make_audit(("bad",) + ("open",) * 38 + ("good",), doubts=(DOUBT, DOUBT), **ANSWERED, **PAIR),
    "labels": make_audit(("bad",) * 10 + ("open",) * 10 + ("good",) * 20, **ANSWERED, **PAIR),
    "operators": make_audit(VERDICTS, demonstrators=PEOPLE, notes=NOTES, **PAIR),
    "tasks": make_audit(VERDICTS, within="tasks", method=("They are judged within their tasks. " * 9,), **PAIR),
    "long ids": make_audit(VERDICTS, ids=LONG, **(PAIR | {"pair": (LONG[0], LONG[39])})),
    "a damaged policy": make_audit(("open",) * 40, finding="nothing could be learned", **PAIR),
}


def faults(ids):
    sentence = "action_steer leaps by 0.75 for one step at 14.1 s (usual: up to 0.4); the same in 2 more columns"
    found = tuple(Fault("spike", name, 0, 1, "x", 1.0, 0.5, 1.0, sentence) for name in ids[:9])
    return FaultReport(found, {}, {}, {}, {}, len(ids), 99)


def printed(audit, capsys, all_rows=False):
    """The lines with everything that the command prints."""
    head = ["drives.csv: CSV; 40 demonstrations, 4,000 steps.", "Action: steering.", "A note.", "Another note.", ""]
    closing = ["", *next_steps(audit, "labels.csv", COMMAND)]
    print_audit(audit, head, faults(audit.ids), closing, all_rows)
    return capsys.readouterr().out.splitlines()


@pytest.mark.parametrize("kind", KINDS)
def test_an_audit_is_25_lines_of_80_columns_and_with_all_rows_nothing_is_left_out(kind, capsys):
    audit = KINDS[kind]
    lines = printed(audit, capsys)
    assert len(lines) <= MAX_LINES
    assert all(cell_len(line) <= 80 for line in lines if not line.startswith(THEN_RUN))
    rows = [line for line in lines if re.match(r"\S+ +(outlier|open|good|bad|\d+) +[-+]\d", line)]
    assert len(rows) >= 2
    assert len(rows) <= MAX_ROWS
    assert all(" spike" in row for row in rows[:2]), "why these come first"
    text = "\n".join(lines)
    assert (question(audit) is None) == ("Which is better" not in text)
    assert "9 recordings are odd, most of all " in text
    assert text.encode("ascii")
    assert not re.search(r"\n  \S.*\n  (?!All: )\S", text)  # no sentence is longer than two lines
    text = "\n".join(printed(audit, capsys, all_rows=True))
    assert all(str(name) in text for name in audit.ids)
    assert all(reason in text for reason in audit.reasons) or len({*audit.reasons}) == 1
    assert " ".join(audit.notes) in " ".join(text.split())


@pytest.mark.parametrize("n_notes", [*range(18)])
def test_notes_leave_two_rows_and_rows_take_what_is_left(n_notes, capsys):
    audit = make_audit(VERDICTS * 2, notes=tuple(f"note {k}" for k in range(n_notes)))
    print_audit(audit, (), faults([*range(28, 40), *range(28)]), ["end"] * 2)
    lines = capsys.readouterr().out.splitlines()
    rows, notes = (sum(bool(re.match(of, line)) for line in lines) for of in (r"\d+ +(outlier|open)", "note "))
    others = len(lines) - rows - notes
    assert (notes, rows) == (min(n_notes, 25 - others - 2), min(8, 25 - others - notes))


def test_a_long_reason_is_cut_and_one_fault_is_a_sentence():
    assert len(odd_lines(FaultReport((), {"duplicate": "a long reason " * 20}, {}, {}, {}, 4, 99))) == 2
    one, command = odd_lines(FaultReport(faults(["a"]).findings[:1], {}, {}, {}, {}, 4, 99))[::2]
    assert one.startswith("1 recording is odd: a: action_steer leaps by")
    assert command == "  All: rpil check."
    of_set = faults(["", "a", "b"]).findings
    for findings, said in ((of_set, "2 recordings are odd; the whole set: "), (of_set[:1], "The whole set is odd: ")):
        assert odd_lines(FaultReport(findings, {}, {}, {}, {}, 4, 99))[0].startswith(said)


def test_a_score_that_rounds_to_zero_has_no_sign_of_a_minus(capsys):
    print_audit(dataclasses.replace(KINDS["nobody"], log_odds=np.full(40, -1e-9)), (), faults([]), ())
    assert "-0.000" not in capsys.readouterr().out


def at_terminal(monkeypatch, columns: str) -> io.StringIO:
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setenv("COLUMNS", columns)
    return stream


def test_a_terminal_gets_colours_and_a_pipe_none(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    assert "\x1b" not in "\n".join(printed(KINDS["outliers"], capsys))
    stream = at_terminal(monkeypatch, "80")
    print_audit(make_audit(), (), faults([]), ())
    assert "\x1b[31moutlier" in stream.getvalue()


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("letter", ["x", "\u6f22"])
def test_no_line_of_the_table_is_wider_than_the_terminal(monkeypatch, columns, letter):
    stream = at_terminal(monkeypatch, str(columns))
    ids = [f"a{m}_{letter * 90}_{m}" for m in range(40)]
    print_audit(dataclasses.replace(KINDS["outliers"], ids=tuple(ids)), (), faults([]), ())
    lines = click.unstyle(stream.getvalue()).splitlines()
    rows = [line for line in lines if re.search(r"_\d+ +(outlier|open)", line)]
    assert len(rows) == 5
    assert max(map(cell_len, rows)) <= columns
    assert {re.search(r"_(\d+) ", row)[1] for row in rows} <= {str(m) for m in range(20)}  # the end of an id stays


def test_doubts_and_contradicting_labels_are_results(capsys):
    changes = {"doubts": ("One part says most.",), "contradicting": (3,), "competing": ((0, 1), (2, 3))}
    print_audit(make_audit(("open",) * 10, finding="two groups", **changes), (), faults([]), ())
    lines = capsys.readouterr().out.splitlines()
    assert lines[3] == "Doubt: One part says most."
    assert lines[-3] == "Look again: the labels of 3 contradict the other answers."
    assert lines[-2:] == ["Group A, 2: 0, 1", "Group B, 2: 2, 3"]
