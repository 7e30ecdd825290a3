"""``rpil info``: what is in a file, before anything is judged."""

from __future__ import annotations

from typing import Any

import click

from rpil.cli import terminal
from rpil.cli.commands import open_recording
from rpil.cli.options import json_option, pop_columns, stream_option, with_column_options


@click.command()
@click.argument("file", type=click.Path())
@json_option
@stream_option
@with_column_options
def info(file: str, json_wanted: bool, stream: bool | None, **options: Any) -> None:
    """Print how a file is read: demonstrations, observations, actions, and what is ignored and why."""
    recording = open_recording(file, pop_columns(options), lambda _: None, stream)
    if json_wanted:
        click.echo(terminal.to_json(recording.description.to_dict()))
    else:
        terminal.print_lines(recording.description.lines())
    recording.demonstrations  # noqa: B018  # what cannot be audited is an error
