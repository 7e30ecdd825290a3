"""An audit in a terminal: tables and sentences. Rich is imported where it is used."""

from __future__ import annotations

import json
import math
import os
import shlex
import sys
import warnings
from collections.abc import Hashable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

from rpil.data.errors import DataWarning, shortened
from rpil.data.privacy import without_secrets
from rpil.data.text import MAX_IDS, listed, printable

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

    from rpil.results.record import Audit, Demonstrator

    Cells = dict[str, list[str] | list[Text]]
    """Cells, as texts or coloured texts, by the titles of their columns."""

SIDE_COLOURS = {"upper": "green", "open": "yellow", "lower": "red"}

MAX_ROWS = 26  # of the ranking, and of the demonstrators with their titles, unless all are asked for
MAX_DEMONSTRATORS = 4
NO_PROBABILITY = "Demonstrations without a word have a place in the ranking, and no probability."
N_SHOWN = 3  # demonstrations whose reasons are printed, and that the next step proposes to label
PIPE_WIDTH = 10_000  # of a table where there is no terminal: no line is wrapped


@contextmanager
def print_warnings() -> Iterator[None]:
    """Print every warning for users as one line on stderr, once, and no other warnings; none if there is an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    of_users = (warning.message for warning in caught if issubclass(warning.category, UserWarning))
    messages = (one.in_shell if isinstance(one, DataWarning) else str(one) for one in of_users)
    for message in dict.fromkeys(messages):
        click.echo(f"note: {to_one_line(message)}", err=True)


def to_one_line(text: str) -> str:
    """The text on one line, without colours and secrets."""
    return without_secrets(" ".join(click.unstyle(shortened(text)).split()))


def schema(command: str) -> dict[str, object]:
    """What says of the JSON of a command by which of docs/schemas it is; a change that is no addition raises it."""
    return {"schema": {"name": f"rpil.{command}", "version": 1}}


def to_json(value: object) -> str:
    """The value as standard JSON: NaN and infinity become null."""
    return json.dumps(_replace_non_finite(value), allow_nan=False)


def _replace_non_finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _replace_non_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_non_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finding_lines(audit: Audit) -> list[str]:
    """The finding and every doubt, one sentence a line."""
    from rpil.results.overview import headline

    return [headline(audit), *audit.doubts]


def print_lines(lines: Iterable[str]) -> None:
    """Print lines, without control characters."""
    for line in lines:
        click.echo(printable(line))


def print_audit(audit: Audit, all_rows: bool = False) -> None:
    """Print the finding, the ranking, the meaning of the probability, the demonstrators, and the counts of words.

    Ranking and demonstrators have at most `MAX_ROWS` rows, unless `all_rows`.
    """
    print_lines([*finding_lines(audit), ""])
    n_rows = MAX_ROWS - (MAX_DEMONSTRATORS + 4 if audit.demonstrators else 0)
    shown = worst_and_doubtful(audit, len(audit.ids) if all_rows else n_rows)
    _print_ranking(audit, shown)
    print_lines(["", *(f"{audit.ids[m]}: {audit.reasons[m]}" for m in shown[:N_SHOWN])])
    is_known = any(map(audit.has_proba, range(len(audit.ids))))
    click.echo(f"\n{audit.vocabulary.meaning(audit.expert_proba) if is_known else NO_PROBABILITY}\n")
    if audit.demonstrators:
        least_first = audit.demonstrators[:: -1 if audit.demonstrators[0].trust else 1]
        _print_demonstrators(least_first[: None if all_rows else MAX_DEMONSTRATORS], audit)
    wrong = [f"{printable(name)}: its label contradicts the other answers; look again." for name in audit.contradicting]
    print_lines([verdict_sentence(audit), *wrong, *audit.notes])


def worst_and_doubtful(audit: Audit, n_rows: int) -> list[int]:
    """Up to `n_rows` indices of demonstrations, the least trusted first: half of them the most doubtful ones.

    Doubtful are those that stay open although the finding gives words, unless they score as high as the similar ones.
    """
    from scipy.special import expit

    from rpil.inference.findings import DECIDED

    order = audit.ranking()[::-1].tolist()
    doubtful = [m for m in order if audit.finding in DECIDED and audit.verdicts[m] == "open"]
    doubtful = [m for m in doubtful if expit(audit.log_odds[m]) < audit.settings.min_proba(audit.anchor)]
    shown = set(sorted(doubtful, key=lambda m: abs(audit.log_odds[m]))[: n_rows // 2])
    shown |= set([m for m in order if m not in shown][: n_rows - len(shown)])
    return [m for m in order if m in shown]


def _print_ranking(audit: Audit, shown: Sequence[int]) -> None:
    from rich.text import Text

    from rpil.results.vocabulary import SIDES

    groups = {name: letter for letter, members in audit.groups.items() for name in members}
    sums = {f"{'+' if k else '='} {name}": part for k, (name, part) in enumerate(audit.evidence_columns().items())}
    proba = {m: f"{audit.expert_proba[m]:.3f}" for m in shown if audit.has_proba(m)}
    columns: Cells = {
        "id": [printable(audit.ids[m]) for m in shown],
        "place": [f"{audit.ranks[m]:,}" for m in shown],
        "steps": [f"{audit.lengths[m]:,}" for m in shown],
        **{name: [f"{part[m]:+,.2f}" for m in shown] for name, part in {"log-odds": audit.log_odds, **sums}.items()},
        **({audit.vocabulary.probability: [proba.get(m, "") for m in shown]} if proba else {}),
        "reliability": [f"{audit.reliability[m]:.2f}" for m in shown],
        "verdict": [Text(audit.verdicts[m], style=SIDE_COLOURS[SIDES[audit.verdicts[m]]]) for m in shown],
        "worst steps": [" ".join(map(str, audit.worst_steps(m))) for m in shown],
        **({"group": [groups.get(audit.ids[m], "") for m in shown]} if groups else {}),
    }
    _print_table(columns, [*sums, "worst steps", "reliability", "steps", "log-odds"], len(audit.ids), "demonstrations")


def _print_demonstrators(shown: Sequence[Demonstrator], audit: Audit) -> None:
    counts = [audit.verdict_counts(row.demonstrations) for row in shown]
    columns: Cells = {
        "demonstrator": [printable(row.name) for row in shown],
        "trust": [f"{row.trust.mean:.2f}" for row in shown if row.trust],
        "95 %": [f"{row.trust.low:.2f} to {row.trust.high:.2f}" for row in shown if row.trust],
        "demonstrations": [f"{len(row.demonstrations):,}" for row in shown],
        **{word: [f"{count[word]:,}" for count in counts] for word in audit.verdict_counts()},
        "style": [audit.style(row) for row in shown],
    }
    columns = {title: cells for title, cells in columns.items() if cells}  # without answers there is no trust
    _print_table(columns, ["95 %", "style"], len(audit.demonstrators), "demonstrators")
    click.echo("" if "trust" in columns else "To judge within each of them: --session operator, their column.\n")


LEFT = "id", "demonstrator", "verdict", "worst steps", "group", "style"
"""Columns of words; the others are numbers."""


def _print_table(columns: Cells, dispensable: Sequence[str], n_rows: int, what: str) -> None:
    """Print a table, and how many of `n_rows` rows are not in it.

    Where a terminal is too narrow the `dispensable` columns are left out, one after the other, and then names in the
    first column go on in the next line. In a pipe or a file nothing is wrapped or coloured.
    """
    from rich.console import Console
    from rich.measure import Measurement

    is_terminal = sys.stdout.isatty()
    width = None if is_terminal else PIPE_WIDTH
    console = Console(highlight=False, markup=False, emoji=False, force_terminal=is_terminal, width=width)
    table, without_limit = _table(columns), console.options.update_width(PIPE_WIDTH)
    for title in dispensable:
        if Measurement.get(console, without_limit, table).maximum <= console.width:
            break
        columns = {name: cells for name, cells in columns.items() if name != title}
        table = _table(columns)
    console.print(table)
    if n_rows > table.row_count:
        click.echo(f"... and {n_rows - table.row_count:,} more {what}: --all prints them.")


def _table(columns: Cells) -> Table:
    """The columns side by side."""
    from rich import box
    from rich.table import Table

    lines = box.SIMPLE_HEAD if sys.stdout.isatty() else box.Box(str(box.SIMPLE_HEAD).replace("\u2500", "-"), ascii=True)
    table = Table(box=lines, show_edge=False, pad_edge=False)
    for k, title in enumerate(columns):
        table.add_column(title, justify="left" if title in LEFT else "right", no_wrap=k > 0, overflow="fold")
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    return table


def verdict_sentence(audit: Audit) -> str:
    """How many demonstrations have which verdict."""
    from rpil.inference.findings import DECIDED
    from rpil.results.vocabulary import numbered

    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    if {*audit.verdicts} == {"open"} and audit.finding not in DECIDED:
        return f"{size} are ranked; all are open."
    counts = ", ".join(numbered(count, verdict) for verdict, count in audit.verdict_counts().items())
    return f"{size}: {counts}."


def next_steps(audit: Audit, labels_file: str, command: str) -> str:
    """What to do next: the question that decides most, or the demonstrations to label, what to write to `labels_file`,
    and what to run then. `command` is the command without ``--labels``."""
    from rpil.results.answering import NEXT_STEPS

    exists = os.path.exists(labels_file) or bool(audit.labelled)
    lines = [
        f"Group {letter}, {len(ids)} demonstrations: {listed(ids, MAX_IDS, ', ')}"
        for letter, ids in audit.groups.items()
    ]
    lines.append(f"Next: {NEXT_STEPS[audit.finding]}")
    if audit.finding == "nothing could be learned" and not audit.question:
        return "\n".join(lines)
    if audit.question:
        first, second = map(printable, audit.pair)
        lines += [
            audit.question,
            *_answer_lines(audit.pair[0], f"better than {second}", first, labels_file, exists),
        ]
    else:
        to_label = audit.suggest_labels(N_SHOWN)
        if not to_label:
            return "\n".join([*lines, "Every demonstration has a label already."])
        name = printable(to_label[0])
        lines += [f"The labels that say most about the others, the best first: {listed(to_label, MAX_IDS, ', ')}."]
        lines += _answer_lines(to_label[0], "good", name, labels_file, exists)
    return "\n".join([*lines, f"Then run: {command} --labels {shlex.quote(labels_file)}"])


def _answer_lines(id_: Hashable, label: str, name: str, labels_file: str, add: bool) -> list[str]:
    """How to write a label of the demonstration `id_`, which is printed as `name`."""
    from rpil.data.cells import to_cell
    from rpil.data.id_values import csv_row

    if labels_file.lower().endswith(".json"):
        pair = json.dumps({name: label}, ensure_ascii=False)
        content = [pair[1:-1] if add else pair]
    else:
        row = csv_row([printable(to_cell(id_)), label])
        content = [row] if add else ["id,label", row]
    verb = "Add" if add else "Write"
    return [
        f"{verb} good, bad, better than or same as ... for those you can judge to {labels_file}; if {name} is {label}:",
        *(f"    {line}" for line in content),
    ]
