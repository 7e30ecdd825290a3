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
    json_option,
    outcome_option,
    pop_columns,
    session_option,
    stream_option,
    with_options,
)


@click.command()
@click.argument("file", type=click.Path())
@json_option
@stream_option
@outcome_option
@session_option
@with_options(*COLUMN_OPTIONS)
@click.pass_context
def info(ctx: click.Context, /, file: str, json_wanted: bool, stream: bool | None, **options: Any) -> None:
    """Print how a file is read: demonstrations, observations, actions, and what is ignored and why."""
    columns = pop_columns(options, guess=True)
    recording = open_recording(file, columns, lambda _: None, stream)
    if json_wanted:
        click.echo(terminal.to_json(recording.description.to_dict()))
    else:
        terminal.print_lines(recording.description.lines())
    recording.demonstrations  # noqa: B018  # what cannot be audited is an error
    if not json_wanted:
        words = command_words(ctx, "audit", without=())
        operator = recording.description.operator_column
        more = ["--operator", operator] if operator and columns.operator is None else []
        click.echo(f"\nNext: {shlex.join([*words, *more])}")
