"""What ``rpil audit`` prints: at most 25 lines of 80 columns, or with ``--all`` a row for every demonstration."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Hashable, Iterator, Sequence
from typing import TYPE_CHECKING

import click

from rpil.cli.terminal import THEN_RUN, fit, line_width, print_lines, table_lines
from rpil.data.text import MAX_LISTED_NAMES, listed, printable

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.description import Description
    from rpil.results.record import Audit

MAX_LINES, MIN_ROWS, MAX_ROWS = 25, 2, 8
"""Lines of an audit, and rows of its table, unless all are asked for."""

N_NAMED, N_FOUND = 3, 12
"""Operators that are named, and demonstrations to label next; those that the finding names, and members of a group."""

SIDE_COLOURS = {"upper": "green", "open": "yellow", "lower": "red"}


def print_audit(
    audit: Audit,
    head: Sequence[str] = (),
    faults: FaultReport | None = None,
    closing: Sequence[str] = (),
    all_rows: bool = False,
) -> None:
    """Print what to look at first, the lines of the `head`, the finding, recording `faults`, the table of those to look
    at, notes, and the lines of the `closing`."""
    from rpil.results.overview import first_sentence, look_first

    width, odd = line_width(), [] if faults is None else odd_lines(faults)
    faulty = () if faults is None else faults.odd
    above = [*fit(first_sentence(audit, faulty, short_id), width, 2), *head, *finding_lines(audit), *odd, ""]
    counts = fit(f"{verdict_sentence(audit)}{'' if all_rows else ' All: --all.'}", width)
    notes = [*_notes(audit, all_rows, width)]
    room = MAX_LINES - len([*above, *counts, *closing]) - 1
    below = [*counts, *(notes if all_rows else notes[: max(room - MIN_ROWS, 0)]), *closing]
    room = MAX_LINES - len([*above, *below]) - 1
    shown = look_first(audit, faulty)[: min(MAX_ROWS, max(MIN_ROWS, room))]
    if all_rows or not shown:
        shown = audit.ranking()[::-1].tolist()[: None if all_rows else MIN_ROWS]
    print_lines(above)
    for line in table_lines(_columns(audit, shown, all_rows), None if all_rows and not sys.stdout.isatty() else width):
        click.echo(line)
    print_lines(below)


def head_lines(description: Description) -> list[str]:
    """What was read, in a few lines: the size, the action, and what else a user should know."""
    width, action = line_width(), f"Action: {listed(description.actions, MAX_LISTED_NAMES, ', ')}."
    notes = (fit(note, width, 1)[0] for note in description.notes[:2])
    return [*fit(description.short()[0], width, 2), *fit(action, width, 1), *notes]


def finding_lines(audit: Audit) -> list[str]:
    """The finding, and every doubt."""
    from rpil.results.overview import headline

    sentences = headline(audit, N_FOUND, short_id), *(f"Doubt: {doubt}" for doubt in audit.doubts)
    return [line for sentence in sentences for line in fit(sentence, line_width(), 2)]


def verdict_sentence(audit: Audit) -> str:
    """How many demonstrations have which verdict."""
    from rpil.results.vocabulary import in_numbers

    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    return f"{size}: {in_numbers(audit.verdict_counts())}."


def odd_lines(report: FaultReport) -> list[str]:
    """How many recordings are odd, and the worst one."""
    if not report.findings:
        why = report.not_checked.get("duplicate")  # which is looked for wherever anything is
        said = f"Recording faults were not looked for: {why}." if why else "No recording faults found."
        return fit(said, line_width(), 2)
    worst, n = report.lines[0], len({found.id for found in report.findings})
    count = f"{n:,} recordings are odd, most of all" if n > 1 else "1 recording is odd:"
    who = short_id(worst.id) if worst.id != "" else "the set"
    return [*fit(f"{count} {who}: {worst.sentence}.", line_width(), 2), "  All: rpil check."]


def _columns(audit: Audit, shown: Sequence[int], all_rows: bool) -> dict[str, list[str]]:
    """The verdict, or else the place, the score, where to look and why, without what is the same of all; the
    probability and the whole reason where `all_rows` are printed."""
    from rpil.results.reasons import at_a_glance
    from rpil.results.vocabulary import SIDES

    proba, is_decided = audit.vocabulary.probability, {*audit.verdicts} != {"open"}
    glances, digits = [at_a_glance(audit, audit.reasons[m], m) for m in shown], 1 + 2 * (abs(audit.log_odds).max() < 1)
    columns = {
        "id": [printable(audit.ids[m]) if all_rows else short_id(audit.ids[m]) for m in shown],
        "place": [f"{audit.ranks[m]:,}" for m in shown],
        "verdict": [click.style(audit.verdicts[m], fg=SIDE_COLOURS[SIDES[audit.verdicts[m]]]) for m in shown],
        "score": [f"{value:+,.{digits}f}" for value in audit.log_odds[[*shown]].tolist()],
        proba: [f"{audit.expert_proba[m]:.3f}" * audit.has_proba(m) for m in shown],
        "where": [where for where, _ in glances],
        "why": [printable(audit.reasons[m]) if all_rows else why for m, (_, why) in zip(shown, glances, strict=True)],
    }
    left_out = {"where"} if all_rows else {proba, "place" if is_decided else "verdict"}
    left_out |= {name for name in (proba, "where", "why") if len({*columns[name]}) < 2}
    return {name: own for name, own in columns.items() if name not in left_out}


def short_id(name: Hashable, most: int = 28) -> str:
    """An id in few characters: of a long one its end, which is what differs."""
    text = printable(name)
    return text if len(text) <= most else f"...{text[3 - most :]}"


def _notes(audit: Audit, all_rows: bool, width: int) -> Iterator[str]:
    """Contradicting labels, operators, groups and notes, a line each, or whole."""
    from rpil.results.vocabulary import PLURALS

    lower, sentences = audit.vocabulary.lower, list[str]()
    if audit.contradicting:
        names = listed(audit.contradicting, MAX_LISTED_NAMES, ", ")
        sentences.append(f"Look again: the labels of {names} contradict the other answers.")
    counts = [(who, audit.verdict_counts(who.demonstrations)[lower]) for who in audit.demonstrators]
    counts.sort(key=lambda one: -one[1] / len(one[0].demonstrations))  # the largest share first
    shares = [f"{short_id(who.name)} {n:,} of {len(who.demonstrations):,}" for who, n in counts if n]
    if shares:
        names = listed(shares, len(shares) if all_rows else N_NAMED, ", ")
        sentences.append(f"{PLURALS.get(lower, lower).capitalize()} by operator: {names}.")
    if counts:
        sentences.append("To judge within each operator: --session operator, their column.")
    sentences += [f"Group {letter}, {len(ids):,}: {listed(ids, N_FOUND, ', ')}" for letter, ids in audit.groups.items()]
    for sentence in [*sentences, *audit.notes]:
        yield from fit(sentence, width, None if all_rows else 1)


def next_steps(audit: Audit, labels_file: str, command: Sequence[str]) -> list[str]:
    """What to do next: the question whose answer says most, or the demonstrations to label, and the command to run
    then, which is `command` with ``--labels``."""
    from rpil.results.answering import NEXT_STEPS

    to_label, sentences = audit.suggest_labels(N_NAMED), [audit.question or f"Next: {NEXT_STEPS[audit.finding]}"]
    if not audit.question and (audit.finding == "nothing could be learned" or not to_label):
        return fit(sentences[0], line_width())
    if not audit.question:
        sentences.append(f"Best to label first: {listed(to_label, N_NAMED, ', ')}.")
    sentences.append(f"Answer in {labels_file} (id,label; docs/command-line.md), or let rpil label ask.")
    lines = [line for sentence in sentences for line in fit(sentence, line_width(), 2)]
    return [*lines, f"{THEN_RUN}{shlex.join([*command, '--labels', labels_file])}"]
