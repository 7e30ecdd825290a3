"""An audit in a terminal: tables and sentences. Rich is imported where it is used."""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Hashable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from rpil.audit.record import Audit

VERDICT_COLOURS = {"expert": "green", "uncertain": "yellow", "adversary": "red"}

MAX_IDS = 20  # in one line


@contextmanager
def print_warnings() -> Iterator[None]:
    """Print every warning for users as one line on stderr, once, and no other warnings; none if there is an error."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    messages = (str(warning.message) for warning in caught if issubclass(warning.category, UserWarning))
    for message in dict.fromkeys(messages):
        click.echo(f"note: {to_one_line(message)}", err=True)


def to_one_line(text: str) -> str:
    """The text on one line and without colours."""
    return " ".join(click.unstyle(text).split())


def to_json(value: object) -> str:
    """The value as standard JSON: NaN and infinity become null."""
    return json.dumps(_replace_non_finite(value), allow_nan=False)


def _replace_non_finite(value: object) -> object:
    if isinstance(value, dict):
        return {key: _replace_non_finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_replace_non_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finding_sentence(audit: Audit) -> str:
    from rpil.inference.trust import FINDINGS

    return f"{audit.finding.capitalize()}: {FINDINGS[audit.finding]}"


def print_audit(audit: Audit) -> None:
    """Print the finding, the ranking, the meaning of P(expert), the demonstrators, and the number of each verdict."""
    from rpil.audit.assumptions import P_EXPERT

    click.echo(f"{finding_sentence(audit)}\n")
    _print_ranking(audit)
    click.echo(f"\n{P_EXPERT}\n")
    if audit.demonstrators:
        _print_demonstrators(audit)
    click.echo(verdict_sentence(audit))


def _print_ranking(audit: Audit) -> None:
    from rich.text import Text

    parts = audit.evidence_columns()
    sums = (f"{'+' if k else '='} {name}" for k, name in enumerate(parts))
    table = _empty_table("id", "steps", "log-odds", *sums, "P(expert)", "reliability")
    table.add_column("verdict", no_wrap=True)
    table.add_column("worst steps")
    groups = {name: letter for letter, members in _groups(audit).items() for name in members}
    if groups:
        table.add_column("group", no_wrap=True)
    for m in audit.ranking().tolist():
        table.add_row(
            Text(printable(audit.ids[m])),
            f"{audit.lengths[m]:,}",
            *(f"{value[m]:+,.2f}" for value in (audit.log_odds, *parts.values())),
            f"{audit.expert_proba[m]:.3f}",
            f"{audit.reliability[m]:.2f}",
            Text(audit.verdicts[m], style=VERDICT_COLOURS[audit.verdicts[m]]),
            " ".join(map(str, audit.worst_steps(m))),
            *([groups.get(audit.ids[m], "")] if groups else []),
        )
    _console().print(table)


def _print_demonstrators(audit: Audit) -> None:
    from rich.text import Text

    table = _empty_table("demonstrator", "trust", "95 %", "demonstrations", *VERDICT_COLOURS)
    for row in audit.demonstrators:
        counts = row.n_demonstrations, row.experts, row.uncertain, row.adversaries
        trust = f"{row.trust.mean:.2f}", f"{row.trust.low:.2f} to {row.trust.high:.2f}"
        table.add_row(Text(printable(row.name)), *trust, *(f"{count:,}" for count in counts))
    _console().print(table)
    click.echo("")


def _empty_table(name: str, *numbers: str) -> Table:
    """A table without rows: a column of names, and columns of numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column(name, overflow="fold")
    for title in numbers:
        table.add_column(title, justify="right", no_wrap=True)
    return table


def verdict_sentence(audit: Audit) -> str:
    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    if audit.finding != "told apart":
        return f"{size} are ranked; there are no verdicts{' except on labelled ones' if audit.labelled else ''}."
    expert, uncertain, adversary = (audit.verdicts.count(verdict) for verdict in ("expert", "uncertain", "adversary"))
    return f"Of {size}, {expert} can be trusted, {adversary} cannot be trusted, and {uncertain} are uncertain."


def next_step(audit: Audit) -> str:
    """What to do next; before it, the two styles of demonstrations, if there are two."""
    from rpil.audit.label_choice import NEXT_STEPS

    sentence = f"Next: {NEXT_STEPS[audit.finding]}"
    if not audit.competing:
        return sentence
    groups = "; ".join(f"{letter}: {join_ids(members)}" for letter, members in _groups(audit).items())
    return (
        f"There are two styles: two groups of demonstrations act differently in some states ({groups}). Both may be "
        f"good; if one is bad, label one demonstration of each, say {join_ids(audit.to_label, ' and ')}.\n{sentence}"
    )


def label_suggestion(audit: Audit, k: int) -> str:
    suggested = audit.suggest_labels(k)
    if not suggested:
        return "Every demonstration has a label already."
    return f"The labels that say most about the others, the best first: {join_ids(suggested)}."


def print_ambiguity(audit: Audit, labels_file: str, consequence: str = "") -> None:
    """Print a box with the two groups that compete, and the label that decides between them, for `labels_file`.

    `consequence` is a sentence about the consequence of having no label.
    """
    from rich.panel import Panel
    from rich.text import Text

    chosen = printable(audit.to_label[0])
    is_json = labels_file.lower().endswith(".json")
    content = [json.dumps({chosen: "expert"})] if is_json else ["id,label", f"{chosen},expert"]
    lines = [
        "Two groups of demonstrations act in two different ways in the same states. Nothing in the data says which of "
        "them is the expert, so all verdicts are uncertain.",
        "",
        *(f"Group {letter}, {len(ids)} demonstrations: {join_ids(ids)}" for letter, ids in _groups(audit).items()),
        "",
        f"Look at one demonstration, say {join_ids(audit.to_label, ' or ')}, and write its label to {labels_file}, "
        f"expert or adversary. If {chosen} is good:",
        "",
        *(f"    {line}" for line in content),
        "",
        "If both groups are good, use --minority trust. If group A is the expert's, use --minority distrust.",
        *(["", consequence] if consequence else []),
    ]
    console = _console()
    panel = Panel(Text("\n".join(lines)), title="Cannot be known", border_style="yellow", width=min(console.width, 100))
    console.print(panel)


def _groups(audit: Audit) -> dict[str, tuple[Hashable, ...]]:
    """The competing groups by their letters."""
    return dict(zip("AB", audit.competing, strict=False))


def join_ids(ids: Sequence[Hashable], separator: str = ", ") -> str:
    """The ids in one line, of many the first ones."""
    more = f"{separator}... ({len(ids) - MAX_IDS} more)" if len(ids) > MAX_IDS else ""
    return separator.join(printable(name) for name in ids[:MAX_IDS]) + more


def printable(name: Hashable) -> str:
    """An id as text without control characters, which a terminal would obey."""
    text = str(name)
    return text if text.isprintable() else repr(text)


def _console() -> Console:
    """The console of results; in a pipe or a file nothing is cut or wrapped."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 160)
