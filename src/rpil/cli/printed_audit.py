"""What ``rpil audit`` prints: at most 25 lines of 80 columns, or with ``--all`` a row for every demonstration."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Hashable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import click

from rpil.cli.terminal import command_lines, fit, line_width, print_lines, size_of, table_lines
from rpil.data.text import MAX_LISTED_NAMES, listed, printable

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.description import Description
    from rpil.numerics.types import Array, Float
    from rpil.results.record import Audit

MAX_LINES = 25
MIN_ROWS, MAX_ROWS = 2, 8
"""Lines of an audit, and rows of its table, unless all are asked for."""

N_NAMED = 3
"""Odd recordings that are named, and demonstrations to label next."""

SIDE_COLOURS = {"upper": "green", "open": "yellow", "lower": "red"}


def print_audit(
    audit: Audit, head: Sequence[str] = (), odd: Sequence[str] = (), closing: Sequence[str] = (), all_rows: bool = False
) -> None:
    """Print the lines of the `head`, the finding, `odd` recordings, the table of the lowest scores, notes, and the
    lines of the `closing`."""
    from rpil.results.vocabulary import SIDES

    width = line_width()
    above = [*head, *finding_lines(audit), *odd, ""]
    more = "" if all_rows or len(audit.ids) <= MIN_ROWS else " All: --all."
    counts, notes = fit(f"{verdict_sentence(audit)}{more}", width), [*_notes(audit, all_rows, width)]
    room = MAX_LINES - len([*above, *counts, *closing]) - 1
    below = [*counts, *(notes if all_rows else notes[: max(room - MIN_ROWS, 0)]), *closing]
    room = MAX_LINES - len([*above, *below]) - 1
    shown = audit.ranking()[::-1].tolist()[: None if all_rows else min(MAX_ROWS, max(MIN_ROWS, room))]
    if not all_rows:  # those to look at
        shown = [m for m in shown if SIDES[audit.verdicts[m]] != "upper"] or shown
    columns = _every_column(audit, shown) if all_rows else _columns(audit, shown)
    is_open = all_rows and not sys.stdout.isatty()
    print_lines(above)
    for line in table_lines(columns if is_open else _narrow(columns, width), None if is_open else width):
        click.echo(line)
    print_lines(below)


def head_lines(description: Description) -> list[str]:
    """What was read, in a few lines: the size, the action, and what else a user should know."""
    action = _widest((f"Action: {listed(description.actions, most, ', ')}." for most in (8, 5, 3, 2, 1)), 1)
    notes = (fit(note, line_width(), 1)[0] for note in description.notes[:2])
    return [*fit(description.short()[0], line_width(), 2), *action, *notes]


def finding_lines(audit: Audit) -> list[str]:
    """The finding, and every doubt."""
    from rpil.results.overview import headline

    found = _widest((headline(audit, most, short_id) for most in (12, 8, 5, N_NAMED, 1)), 2)
    return [*found, *(line for doubt in audit.doubts for line in fit(f"Doubt: {doubt}", line_width(), 2))]


def _widest(sentences: Iterable[str], most: int) -> list[str]:
    """The first of the sentences, each shorter than the one before, that takes up to `most` lines."""
    for sentence in sentences:
        lines = fit(sentence, line_width())
        if len(lines) <= most:
            return lines
    return fit(sentence, line_width(), most)


def verdict_sentence(audit: Audit) -> str:
    """How many demonstrations have which verdict."""
    from rpil.inference.findings import DECIDED
    from rpil.results.vocabulary import in_numbers

    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    if {*audit.verdicts} == {"open"} and audit.finding not in DECIDED:
        return f"{size} are ranked; all are open."
    return f"{size}: {in_numbers(audit.verdict_counts())}."


def odd_lines(report: FaultReport, command: Sequence[str]) -> list[str]:
    """How many recordings are odd, the worst ones, and the `command` that lists all."""
    worst: dict[Hashable, str] = {}
    for found in report.findings:
        worst.setdefault(found.id, found.sentence)
    if not worst:
        why = report.not_checked.get("duplicate")  # which is looked for wherever anything is
        said = f"Recording faults were not looked for: {why}." if why else "No recording faults found."
        return fit(said, line_width(), 2)
    count = f"{len(worst):,} recordings are odd, most of all" if len(worst) > 1 else "1 recording is odd:"
    named = [f"{short_id(name)}: {sentence}" for name, sentence in [*worst.items()][:N_NAMED]]
    some = _widest((f"{count} {'; '.join(named[:most])}." for most in range(N_NAMED, 0, -1)), 2)
    return [*some, *command_lines("  All: ", command, line_width())]


def _verdicts(audit: Audit, shown: Sequence[int]) -> list[str]:
    """The verdicts, each in the colour of its side."""
    from rpil.results.vocabulary import SIDES

    return [click.style(audit.verdicts[m], fg=SIDE_COLOURS[SIDES[audit.verdicts[m]]]) for m in shown]


def _columns(audit: Audit, shown: Sequence[int]) -> dict[str, list[str]]:
    """A narrow table: the verdict or else the place, the score, where to look and why; no column that says nothing."""
    from rpil.results.reasons import at_a_glance

    where, why = zip(*(at_a_glance(audit, audit.reasons[m], m) for m in shown), strict=True)
    decided = {*audit.verdicts} != {"open"}
    said: dict[str, list[str]] = {"where": [*where], "why": [*why]}
    return {
        "id": [short_id(audit.ids[m]) for m in shown],
        **({"verdict": _verdicts(audit, shown)} if decided else {}),
        **({} if decided else {"place": [f"{audit.ranks[m]:,}" for m in shown]}),
        "score": _scores(audit.log_odds[[*shown]]),
        **{title: of for title, of in said.items() if len({*of}) > 1 or (of[0] and (decided or len(of) == 1))},
    }


def _every_column(audit: Audit, shown: Sequence[int]) -> dict[str, list[str]]:
    """Everything that is known of each demonstration."""
    groups = {name: letter for letter, members in audit.groups.items() for name in members}
    who = {name: printable(one.name) for one in audit.demonstrators for name in one.demonstrations}
    proba = {m: f"{audit.expert_proba[m]:.3f}" for m in shown if audit.has_proba(m)}
    columns = {
        "id": [printable(audit.ids[m]) for m in shown],
        "place": [f"{audit.ranks[m]:,}" for m in shown],
        "verdict": _verdicts(audit, shown),
        "score": _scores(audit.log_odds[[*shown]]),
        **{f"from {name}": _scores(part[[*shown]]) for name, part in audit.evidence_columns().items()},
        audit.vocabulary.probability: [proba.get(m, "") for m in shown],
        "like the rest": [f"{audit.reliability[m]:.2f}" for m in shown],
        "operator": [who.get(audit.ids[m], "") for m in shown],
        "group": [groups.get(audit.ids[m], "") for m in shown],
        "steps": [f"{audit.lengths[m]:,}" for m in shown],
        "why": [printable(audit.reasons[m]) for m in shown],
    }
    always = "id", "place", "verdict", "score"
    return {title: cells for title, cells in columns.items() if title in always or len({*cells}) > 1}


def _narrow(columns: dict[str, list[str]], width: int) -> dict[str, list[str]]:
    """The columns but for some that a narrow terminal has no room for."""
    sizes = {title: 2 + max(map(size_of, [title, *cells])) for title, cells in columns.items() if title != "why"}
    for title in [*(title for title in columns if title.startswith("from ")), "steps", "like the rest", "operator"]:
        if sum(sizes.values()) > width - 2 * len("why") and sizes.pop(title, 0):
            columns = {name: cells for name, cells in columns.items() if name != title}
    return columns


def short_id(name: Hashable, most: int = 28) -> str:
    """An id in few characters: of a long one its end, which is what differs."""
    text = printable(name)
    return text if len(text) <= most else f"...{text[3 - most :]}"


def _scores(values: Float[Array, " R"]) -> list[str]:
    """Scores with one decimal, or more where all are small."""
    digits = 1 if max(map(abs, values), default=0.0) >= 1 else 3
    return [f"{value:+.{digits}f}" if abs(value) < 1e4 else f"{value:+,.0f}" for value in values.tolist()]


def _notes(audit: Audit, all_rows: bool, width: int) -> Iterator[str]:
    """Contradicting labels, operators, groups and notes, a line each, or whole."""
    sentences = []
    if audit.contradicting:
        names = listed(audit.contradicting, MAX_LISTED_NAMES, ", ")
        sentences.append(f"Look again: the labels of {names} contradict the other answers.")
    sentences += _operators(audit, None if all_rows else N_NAMED)
    sentences += [f"Group {letter}, {len(ids):,}: {listed(ids, 12, ', ')}" for letter, ids in audit.groups.items()]
    for sentence in [*sentences, *audit.notes]:
        yield from fit(sentence, width, None if all_rows else 1)


def _operators(audit: Audit, most: int | None) -> Iterator[str]:
    """How many outliers, or bad ones, each of up to `most` operators has, the largest share first."""
    from rpil.results.vocabulary import PLURALS

    lower, people = audit.vocabulary.lower, audit.demonstrators
    if not people:
        return
    sizes = {who.name: (audit.verdict_counts(who.demonstrations)[lower], len(who.demonstrations)) for who in people}
    order = sorted(people, key=lambda who: -sizes[who.name][0] / sizes[who.name][1])
    if any(count for count, _ in sizes.values()):
        some = [who for who in order if sizes[who.name][0]]
        shares = (f"{short_id(who.name)} {sizes[who.name][0]:,} of {sizes[who.name][1]:,}" for who in some)
        yield f"{PLURALS.get(lower, lower).capitalize()} by operator: {listed(shares, most or len(some), ', ')}."
    if most is None:
        yield from (f"{printable(who.name)}: {audit.style(who)}." for who in order)
    if not any("--session" in doubt for doubt in audit.doubts):
        yield "To judge within each operator: --session operator, their column."


def next_steps(audit: Audit, labels_file: str, command: Sequence[str]) -> list[str]:
    """What to do next: the question whose answer says most, or the demonstrations to label, what to write to
    `labels_file`, and the command to run then, which is `command` with ``--labels``."""
    from rpil.results.answering import NEXT_STEPS

    width, to_label = line_width(), audit.suggest_labels(N_NAMED)
    exists = os.path.exists(labels_file) or bool(audit.labelled)
    if audit.question:
        id_, label = audit.pair[0], f"better than {printable(audit.pair[1])}"
        lines = [audit.question]
        for name in map(printable, audit.pair):
            lines = [lines[0].replace(name, short_id(name))]
    elif audit.finding == "nothing could be learned" or not to_label:
        return fit(
            f"Next: {NEXT_STEPS[audit.finding]}" if to_label else "Every demonstration has a label already.", width
        )
    else:
        id_, label = to_label[0], "good"
        lines = [f"Next: {NEXT_STEPS[audit.finding]}", f"Best to label first: {listed(to_label, N_NAMED, ', ')}."]
    wrapped = [line for sentence in lines for line in fit(sentence, width, 2)]
    return [
        *wrapped,
        *_answer_lines(id_, label, labels_file, exists),
        *command_lines("Then run: ", [*command, "--labels", labels_file], width),
    ]


def _answer_lines(id_: Hashable, label: str, labels_file: str, add: bool) -> list[str]:
    """How to write a label of the demonstration `id_`."""
    from rpil.data.cells import to_cell
    from rpil.data.id_values import csv_row

    if labels_file.lower().endswith(".json"):
        pair = json.dumps({printable(id_): label}, ensure_ascii=False)
        content = [pair[1:-1] if add else pair]
    else:
        row = csv_row([printable(to_cell(id_)), label])
        content = [row] if add else ["id,label", row]
    verb = "Add your answer to" if add else "Write your answer to"
    return [f"{verb} {labels_file}, for instance:", *(f"    {line}" for line in content)]
