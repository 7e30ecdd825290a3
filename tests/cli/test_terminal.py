"""An audit as sentences for the terminal."""

from __future__ import annotations

import dataclasses
import io
import re
import sys
import warnings

import click
import numpy as np
import pytest
from rich.cells import cell_len

from audits import make_audit
from rpil.cli import terminal
from rpil.cli.outputs import OUTPUTS
from rpil.formats import read_labels
from rpil.results.answering import NEXT_STEPS, question
from rpil.results.record import Audit, Demonstrator, Interval


@pytest.mark.parametrize("finding", ["no outliers", "nothing could be learned"])
def test_every_finding_has_a_sentence_and_a_next_step(finding, capsys):
    terminal.print_audit(make_audit(("open",) * 10, finding=finding, labels={9: 1}, lengths=[10] * 10))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"{finding.capitalize()}: ")
    assert lines[-1].startswith("10 demonstrations (100 steps) are ranked")
    assert lines[-1].endswith("all are open.")
    following = terminal.next_steps(make_audit(finding=finding), "labels.csv", "rpil audit x").splitlines()
    assert following[0] == f"Next: {NEXT_STEPS[finding]}"
    assert (len(following) == 1) == (finding == "nothing could be learned")


N_HEAD_LINES = 8  # at most, of what was read: above the audit
VERDICTS = ("outlier",) * 100 + ("open",) * 40 + ("similar",) * 4860


@pytest.fixture(scope="module")
def many():
    """5,000 demonstrations of 40 people, the least trusted first."""
    log_odds = np.linspace(-9, 9, len(VERDICTS))
    log_odds[100:140] = np.linspace(-1, 1, 40)
    log_odds[:100], log_odds[140:] = np.linspace(-9, -3, 100), np.linspace(3, 9, 4860)
    people = tuple(
        Demonstrator(f"person {k}", Interval(0.9, 0.8, 1), tuple(range(125 * k, 125 * k + 125))) for k in range(40)
    )
    audit = make_audit(VERDICTS, lengths=[2] * len(VERDICTS), log_odds=log_odds, demonstrators=people)
    parts = {"from_actions": audit.log_odds - 1, "from_demonstrator": np.ones(len(VERDICTS))}
    return dataclasses.replace(audit, **parts)


@pytest.mark.slow
def test_many_demonstrations_are_printed_in_few_lines_of_ascii(many, capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    terminal.print_audit(many)
    print(terminal.next_steps(many, "labels.csv", "rpil audit x"))
    out = capsys.readouterr().out
    out.encode("ascii")
    assert "\x1b" not in out
    assert len(out.splitlines()) < 60 - N_HEAD_LINES - len(OUTPUTS)
    assert "... and 4,982 more demonstrations: --all prints them." in out
    assert "... and 36 more demonstrators: --all prints them." in out
    terminal.print_audit(many, all_rows=True)
    assert len(capsys.readouterr().out.splitlines()) > 5000


def test_the_worst_and_the_most_doubtful_are_shown(many):
    shown = terminal.worst_and_doubtful(many, 30)
    assert shown[:15] == [*range(15)]
    assert max(abs(many.log_odds[shown[15:]])) <= min(abs(many.log_odds[[m for m in range(140) if m not in shown]]))
    assert terminal.worst_and_doubtful(many, 300)[:140] == [*range(140)]
    certain = dataclasses.replace(many, verdicts=("outlier",) * 140 + VERDICTS[140:])
    assert terminal.worst_and_doubtful(certain, 30) == [*range(30)]
    unknown = dataclasses.replace(many, verdicts=("open",) * 5000, finding="no outliers")
    assert terminal.worst_and_doubtful(unknown, 30) == [*range(30)]
    log_odds = np.repeat([-9.0, 9.0], [20, 4980]) + np.linspace(0, 1, 5000)
    high = dataclasses.replace(many, verdicts=("outlier",) * 20 + ("open",) * 4980, log_odds=log_odds)
    assert terminal.worst_and_doubtful(high, 30) == [*range(30)]


def test_the_worst_are_given_with_their_reasons(monkeypatch, capsys):
    monkeypatch.setattr(Audit, "reasons", property(lambda audit: tuple(f"reason {m}." for m in audit.ids)))
    terminal.print_audit(make_audit())
    found = re.findall(r"^(\d+): reason (\d+)\.$", capsys.readouterr().out, re.MULTILINE)
    assert found == [(str(m), str(m)) for m in make_audit().ranking()[::-1][:3]]


def test_terminal_gets_lines_and_colours(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdout", stream)
    terminal.print_audit(make_audit())
    assert "\u2500\u2500" in stream.getvalue()
    assert "\x1b[31moutlier" in stream.getvalue()


@pytest.mark.parametrize("n", [40, 73, 87, 300])
@pytest.mark.parametrize("letter", ["x", "\u6f22"])
def test_a_long_id_goes_on_in_the_next_line_and_every_cell_is_whole(monkeypatch, n, letter):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: True, raising=False)
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setenv("COLUMNS", "80")
    audit = make_audit(ids=[f"a{m}_{letter * (n - 6)}_{m}" for m in range(10)])
    terminal.print_audit(audit)
    head, *lines = re.split(r"(?m)^(?=id|a\d_)", click.unstyle(stream.getvalue()))[1:]
    assert head.startswith("id")
    assert all(cell_len(line) <= 80 for row in lines[:10] for line in row.splitlines() if letter in line)
    for row in lines[:10]:
        cells = row.splitlines()[0].split()[1:]
        assert len(cells) >= 2
        m = int(row[1])
        rest = [line.strip() for line in row.splitlines()[1:] if re.match(rf"[{letter}_{m}]", line)]
        assert "".join([row.split()[0], *rest]) == audit.ids[m]
        shown = audit.verdicts[m] == "open"  # which has no probability, but a place
        assert (str(audit.ranks[m]) if shown else f"{audit.expert_proba[m]:.3f}") in cells
        assert audit.verdicts[m] in cells


@pytest.mark.parametrize(
    ("labels_file", "labels", "lines"),
    [
        ("labels.csv", {}, ["id,label", '"a,""b""",good']),
        ("labels.csv", {"good": 1, "bad": -1}, ['"a,""b""",good']),
        ("labels.json", {}, ['{"a,\\"b\\"": "good"}']),
        ("labels.json", {"good": 1, "bad": -1}, ['"a,\\"b\\"": "good"']),
    ],
)
def test_labels_to_paste_are_read_as_labels_of_the_demonstration(labels_file, labels, lines, tmp_path):
    audit = make_audit(("similar", "open", "outlier"), ids=("good", 'a,"b"', "bad"), labels=labels)
    text = terminal.next_steps(audit, labels_file, "rpil audit x")
    assert [line[4:] for line in text.splitlines() if line.startswith("    ")] == lines
    assert text.splitlines()[-1] == f"Then run: rpil audit x --labels {labels_file}"
    if not labels:
        path = tmp_path / labels_file
        path.write_text("\n".join(lines))
        assert read_labels(path) == {'a,"b"': "good"}


def test_labels_for_all_leave_nothing_to_label():
    audit = make_audit(("similar", "outlier"), labels={0: 1, 1: -1})
    assert terminal.next_steps(audit, "l.csv", "rpil audit x").endswith("Every demonstration has a label already.")


@pytest.mark.parametrize(
    ("labels_file", "lines"), [("l.csv", ["id,label", "0,better than 9"]), ("l.json", ['{"0": "better than 9"}'])]
)
def test_question_that_decides_most_is_asked_until_something_is_answered(labels_file, lines):
    audit = make_audit(pair=(0, 9))
    text = terminal.next_steps(audit, labels_file, "rpil audit x")
    assert question(audit) in text.splitlines()
    assert [line[4:] for line in text.splitlines() if line.startswith("    ")] == lines
    assert text.splitlines()[-1] == f"Then run: rpil audit x --labels {labels_file}"
    answered = terminal.next_steps(make_audit(pair=(0, 9), labels={0: 1}), labels_file, "rpil audit x")
    assert "Which is better" not in answered
    assert "the best first" in answered


def test_doubts_and_contradicting_labels_are_results_and_groups_come_before_the_question(capsys):
    changes = {"doubts": ("One part says most.",), "contradicting": (3,), "competing": ((0, 1), (2, 3))}
    audit = make_audit(finding="in doubt", **changes)
    terminal.print_audit(audit)
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "One part says most."
    assert lines[-1] == "3: its label contradicts the other answers; look again."
    lines = terminal.next_steps(audit, "l.csv", "rpil audit x").splitlines()
    assert lines[:2] == ["Group A, 2 demonstrations: 0, 1", "Group B, 2 demonstrations: 2, 3"]
    assert lines[2].startswith("Next: ")


def test_a_note_keeps_the_secrets_of_an_address(capsys):
    with terminal.print_warnings():
        warnings.warn("s3://KEY:HIDDEN@bucket/a.csv: it is old.", stacklevel=1)
    assert capsys.readouterr().err == "note: s3://***@bucket/a.csv: it is old.\n"
