"""``rpil info``: what is in a file, before anything is judged."""

from __future__ import annotations

import shlex
from typing import Any

import click

from rpil.cli import terminal
from rpil.cli.commands import open_recording
from rpil.cli.options import (
    COLUMN_OPTIONS,
    command_words,
    outcome_option,
    pop_columns,
    session_option,
    with_options,
)


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "--format", "form", type=click.Choice(("text", "json")), default="text", show_default=True, help="What to print."
)
@outcome_option
@session_option
@with_options(*COLUMN_OPTIONS)
@click.pass_context
def info(ctx: click.Context, /, file: str, form: str, **options: Any) -> None:
    """Print how a file is read: demonstrations, observations, actions, and what is ignored and why."""
    columns = pop_columns(options, guess=True)
    recording = open_recording(file, columns, lambda _: None)
    if form == "json":
        click.echo(terminal.to_json(recording.description.to_dict()))
    else:
        terminal.print_lines(recording.description.lines())
    recording.demonstrations  # noqa: B018  # what cannot be audited is an error
    if form == "text":
        words = command_words(ctx, "audit", without=())
        operator = recording.description.operator_column
        more = ["--operator", operator] if operator and columns.operator is None else []
        click.echo(f"\nNext: {shlex.join([*words, *more])}")
