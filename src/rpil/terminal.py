"""What the command shows in a terminal: an audit as a table, progress, notes. Rich is imported where it is used."""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress

    from rpil.audit import Audit

_COLOURS = {"expert": "green", "uncertain": "yellow", "adversary": "red"}
_MOST_IDS = 20  # in one line
_LETTERS = "ABCDEFGHIJ"  # of groups

Stages = Callable[[str], None]
Counter = Callable[[int, int], None]


@contextmanager
def stages(quiet: bool) -> Iterator[Stages]:
    """A function that shows what is being done; it shows nothing if `quiet`, or where nobody is looking."""
    if quiet or not sys.stderr.isatty():
        yield lambda stage: None
        return
    from rich.progress import SpinnerColumn, TextColumn, TimeElapsedColumn

    with _progress(SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()) as bar:
        task = bar.add_task("starting", total=None)
        yield lambda stage: bar.update(task, description=stage)


@contextmanager
def counter(what: str, quiet: bool) -> Iterator[Counter]:
    """A function that takes how many of how many are done, as `stages` otherwise."""
    if quiet or not sys.stderr.isatty():
        yield lambda done, total: None
        return
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with _progress(*columns) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


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


def show_ranking(audit: Audit) -> None:
    """The demonstrations as a table, the most trusted first."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column("id", overflow="fold")
    for title in ("steps", "log-odds", "P(expert)", "reliability"):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("worst steps")
    groups = {name: _LETTERS[k] for k, members in enumerate(audit.competing) for name in members}
    if groups:
        table.add_column("group", no_wrap=True)
    for m in audit.ranking().tolist():
        table.add_row(
            Text(_shown(audit.ids[m])),
            f"{audit.lengths[m]:,}",
            f"{audit.log_odds[m]:+,.1f}",
            f"{audit.expert_proba[m]:.3f}",
            f"{audit.reliability[m]:.2f}",
            Text(audit.verdicts[m], style=_COLOURS[audit.verdicts[m]]),
            " ".join(map(str, audit.worst_steps(m))),
            *([groups.get(audit.ids[m], "")] if groups else []),
        )
    _console().print(table)


def show_demonstrators(audit: Audit) -> None:
    """The demonstrators as a table, the most trusted first; nothing where nobody is known."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    if not audit.demonstrators:
        return
    table = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    table.add_column("demonstrator", overflow="fold")
    for title in ("trust", "95 %", "demonstrations", *_COLOURS):
        table.add_column(title, justify="right", no_wrap=True)
    for who in audit.demonstrators:
        counts = who.n_demonstrations, who.experts, who.uncertain, who.adversaries
        trust = who.trust
        cells = f"{trust.mean:.2f}", f"{trust.low:.2f} to {trust.high:.2f}", *(f"{count:,}" for count in counts)
        table.add_row(Text(_shown(who.name)), *cells)
    _console().print("")
    _console().print(table)


def headline(audit: Audit) -> str:
    """The audit in one sentence."""
    n = {verdict: audit.verdicts.count(verdict) for verdict in _COLOURS}
    size = f"{len(audit.ids):,} demonstrations ({audit.offsets[-1]:,} steps)"
    return f"Of {size}, {n['expert']} can be trusted, {n['adversary']} cannot, and {n['uncertain']} remain uncertain."


def suggestion(audit: Audit, k: int) -> str:
    """Whom to look at, in one sentence."""
    asked = audit.suggest_labels(k)
    if not asked:
        return "Every demonstration is labelled already."
    return f"To learn most about the others, label {_listed(asked)}, in this order; leave out what you cannot judge."


def show_ambiguity(audit: Audit, labels_file: str, warning: str = "") -> None:
    """What cannot be known, and what the user can do about it.

    Parameters
    ----------
    audit : Audit
        With ``identifiable`` False.
    labels_file : str
        Where to write the labels.
    warning : str
        What to bear in mind until then.
    """
    from rich.panel import Panel
    from rich.text import Text

    lines = [
        f"{len(audit.competing)} groups of demonstrations each agree among themselves, and nothing in the data says "
        "which of them is the expert; their verdicts stay uncertain.",
        "",
        *(
            f"Group {_LETTERS[k]}, {len(members)} demonstrations: {_listed(members)}"
            for k, members in enumerate(audit.competing)
        ),
        "",
        f"Look at one demonstration of each group, say {_listed(audit.to_label, ' and ')}, and write your judgement to "
        f"{labels_file}; if the first is good and the others bad:",
        "",
        *(f"    {line}" for line in _label_lines(audit.to_label, labels_file)),
    ]
    if warning:
        lines += ["", warning]
    console = _console()
    panel = Panel(Text("\n".join(lines)), title="Cannot be known", border_style="yellow", width=min(console.width, 100))
    console.print(panel)


def _label_lines(ids: Sequence[Any], labels_file: str) -> list[str]:
    """The labels file if the first of `ids` is an expert's."""
    labels = {_shown(name): "adversary" if k else "expert" for k, name in enumerate(ids)}
    if labels_file.lower().endswith(".json"):
        return [json.dumps(labels)]
    return ["id,label", *(f"{name},{label}" for name, label in labels.items())]


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
