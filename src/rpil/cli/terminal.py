"""What the command shows in a terminal: an audit as a table, progress, notes. Rich is imported where it is used."""

from __future__ import annotations

import json
import math
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table

    from rpil.audit.record import Audit


_COLOURS = {"expert": "green", "uncertain": "yellow", "adversary": "red"}
_MOST_IDS = 20  # in one line
_LETTERS = "ABCDEFGHIJ"  # of groups

_FIRST = 1.5  # seconds until the first line about progress, where there is no terminal
_BETWEEN = 3.0  # until the next one, at least
_RARER = 0.1  # of the time gone by, until the next one

Stages = Callable[[str], None]
Counter = Callable[[int, int], None]


@contextmanager
def stages(quiet: bool) -> Iterator[Stages]:
    """A function that shows what is being done, on stderr: in a terminal as it changes, elsewhere in a line now and
    then, and not at all if `quiet`."""
    if quiet or not sys.stderr.isatty():
        with _lines(quiet) as say:
            yield say
        return
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    with _progress(SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda stage: bar.update(task, description=stage)


@contextmanager
def counter(what: str, quiet: bool) -> Iterator[Counter]:
    """A function that takes how many of how many are done, as `stages` otherwise."""
    if quiet or not sys.stderr.isatty():
        with _lines(quiet) as say:
            say(what)
            yield lambda done, total: say(f"{what}, {done} of {total}")
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with _progress(*columns) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextmanager
def _lines(quiet: bool) -> Iterator[Stages]:
    """The stage as a line on stderr: within two seconds, then every few, then ever more seldom."""
    begun, latest, over = time.monotonic(), ["starting"], threading.Event()

    def speak() -> None:
        wait = _FIRST
        while not over.wait(wait):
            elapsed = time.monotonic() - begun
            wait = max(_BETWEEN, _RARER * elapsed)
            click.echo(f"rpil: {elapsed:.0f} s: {latest[0]}", err=True)

    thread = threading.Thread(target=speak, daemon=True)
    if not quiet:
        thread.start()
    try:
        yield lambda stage: latest.__setitem__(0, stage)
    finally:
        over.set()
        if not quiet:
            thread.join()  # no line after this one: what comes next is the result


def _progress(*columns: Any) -> Progress:
    from rich.console import Console
    from rich.progress import Progress

    return Progress(*columns, console=Console(stderr=True), transient=True)  # it leaves nothing behind


@contextmanager
def notes() -> Iterator[None]:
    """Print warnings meant for users as one line each on stderr, unless an error has more to say; no others."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield
    messages = (str(warning.message) for warning in caught if issubclass(warning.category, UserWarning))
    for message in dict.fromkeys(messages):
        click.echo(f"note: {one_line(message)}", err=True)


def one_line(text: str) -> str:
    """`text` on one line and without colours."""
    return " ".join(click.unstyle(text).split())


def as_json(value: Any) -> str:
    """`value` as JSON that every parser reads: what is not finite becomes null."""
    return json.dumps(_finite(value), allow_nan=False)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def finding(audit: Audit) -> str:
    """What the audit comes to, in a sentence."""
    from rpil.inference.trust import FINDINGS

    return f"{audit.finding.capitalize()}: {FINDINGS[audit.finding]}"


def show_audit(audit: Audit) -> None:
    """All of an audit: the finding, the ranking, what P(expert) means, the demonstrators, how many can be trusted."""
    from rpil.audit.assumptions import P_EXPERT

    click.echo(f"{finding(audit)}\n")
    _show_ranking(audit)
    click.echo(f"\n{P_EXPERT}\n")
    if audit.demonstrators:
        _show_demonstrators(audit)
    click.echo(headline(audit))


def _show_ranking(audit: Audit) -> None:
    """The demonstrations as a table, the most trusted first."""
    from rich.text import Text

    parts = {name: part for name, part in audit.evidence.items() if part.any()}
    if len(parts) == 1:
        parts = {}  # it is the log-odds
    sums = (f"{'+' if k else '='} {name}" for k, name in enumerate(parts))
    table = _table("id", "steps", "log-odds", *sums, "P(expert)", "reliability")
    table.add_column("verdict", no_wrap=True)
    table.add_column("worst steps")
    groups = {name: _LETTERS[k] for k, members in enumerate(audit.competing) for name in members}
    if groups:
        table.add_column("group", no_wrap=True)
    for m in audit.ranking().tolist():
        table.add_row(
            Text(_shown(audit.ids[m])),
            f"{audit.lengths[m]:,}",
            *(f"{value[m]:+,.2f}" for value in (audit.log_odds, *parts.values())),
            f"{audit.expert_proba[m]:.3f}",
            f"{audit.reliability[m]:.2f}",
            Text(audit.verdicts[m], style=_COLOURS[audit.verdicts[m]]),
            " ".join(map(str, audit.worst_steps(m))),
            *([groups.get(audit.ids[m], "")] if groups else []),
        )
    _console().print(table)


def _show_demonstrators(audit: Audit) -> None:
    """The demonstrators as a table, the most trusted first."""
    from rich.text import Text

    table = _table("demonstrator", "trust", "95 %", "demonstrations", *_COLOURS)
    for who in audit.demonstrators:
        counts = who.n_demonstrations, who.experts, who.uncertain, who.adversaries
        trust = who.trust
        cells = f"{trust.mean:.2f}", f"{trust.low:.2f} to {trust.high:.2f}", *(f"{count:,}" for count in counts)
        table.add_row(Text(_shown(who.name)), *cells)
    _console().print(table)
    click.echo("")


def _table(name: str, *numbers: str) -> Table:
    """A table without rows: a column of names, and columns of numbers."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column(name, overflow="fold")
    for title in numbers:
        table.add_column(title, justify="right", no_wrap=True)
    return table


def headline(audit: Audit) -> str:
    """How many demonstrations can be trusted, in a sentence."""
    n = {verdict: audit.verdicts.count(verdict) for verdict in _COLOURS}
    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    if audit.finding != "told apart":
        return f"{size} are ranked; the ranking gives no verdicts{' beyond the labels' if audit.labelled else ''}."
    return f"Of {size}, {n['expert']} can be trusted, {n['adversary']} cannot, and {n['uncertain']} remain uncertain."


def advice(audit: Audit) -> str:
    """What to do next, in a sentence."""
    from rpil.audit.label_choice import NEXT_STEPS

    said = f"Next: {NEXT_STEPS[audit.finding]}"
    if not audit.competing:
        return said
    groups = "; ".join(f"{_LETTERS[k]}: {_listed(members)}" for k, members in enumerate(audit.competing))
    return (
        f"Two groups each act alike, and act differently from each other in some states ({groups}). They may be two "
        f"good styles; if one is bad, label one of each, say {_listed(audit.to_label, ' and ')}.\n{said}"
    )


def suggestion(audit: Audit, k: int) -> str:
    """Which `k` demonstrations to label, in a sentence."""
    asked = audit.suggest_labels(k)
    if not asked:
        return "Every demonstration is labelled already."
    return f"To learn most about the others, label {_listed(asked)}, in this order; leave out what you cannot judge."


def show_ambiguity(audit: Audit, labels_file: str, warning: str = "") -> None:
    """Which two groups compete, which label to write to `labels_file`, and a `warning` for as long as there is none."""
    from rich.panel import Panel
    from rich.text import Text

    lines = [
        "Two groups of demonstrations each act alike, differently, in the same states: nothing says which of them is "
        "the expert, and all verdicts stay uncertain.",
        "",
        *(
            f"Group {_LETTERS[k]}, {len(members)} demonstrations: {_listed(members)}"
            for k, members in enumerate(audit.competing)
        ),
        "",
        f"Look at one demonstration, say {_listed(audit.to_label, ' or ')}, and write its label to {labels_file}, "
        f"expert or adversary; if {_shown(audit.to_label[0])} is good:",
        "",
        *(f"    {line}" for line in _label_lines(audit.to_label[0], labels_file)),
        "",
        "If both groups are good, use --minority trust; if group A is known to be the expert's, --minority distrust.",
    ]
    if warning:
        lines += ["", warning]
    console = _console()
    panel = Panel(Text("\n".join(lines)), title="Cannot be known", border_style="yellow", width=min(console.width, 100))
    console.print(panel)


def _label_lines(name: Any, labels_file: str) -> list[str]:
    """The labels file if this demonstration is an expert's."""
    if labels_file.lower().endswith(".json"):
        return [json.dumps({_shown(name): "expert"})]
    return ["id,label", f"{_shown(name)},expert"]


def _listed(ids: Sequence[Any], between: str = ", ") -> str:
    more = f"{between}... ({len(ids) - _MOST_IDS} more)" if len(ids) > _MOST_IDS else ""
    return between.join(_shown(name) for name in ids[:_MOST_IDS]) + more


def _shown(name: Any) -> str:
    """An id as it is, but never as a command to the terminal."""
    text = str(name)
    return text if text.isprintable() else repr(text)


def _console() -> Console:
    """Where results go; in a pipe or a file nothing is cut or wrapped."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 160)
