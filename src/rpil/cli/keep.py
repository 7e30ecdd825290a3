"""``rpil keep`` and ``rpil convert``: demonstrations as files again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from rpil.cli.commands import (
    CommandSettings,
    audit_by_task,
    check_paths,
    connect_engine,
    load_into_memory,
    open_recording,
    read_reference,
    resolve_stream,
)
from rpil.cli.options import (
    DataFile,
    FitOptions,
    pop_columns,
    quiet_option,
    with_column_options,
    with_judge_options,
)
from rpil.cli.outputs import lost_without
from rpil.cli.progress import StageProgress, show_stages
from rpil.cli.terminal import print_lines
from rpil.data.errors import DataError

if TYPE_CHECKING:
    from rpil.data.demonstrations import Demonstrations
    from rpil.formats.columns import ColumnOptions
    from rpil.formats.dataset import Dataset


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", type=click.Path(), metavar="NEW", help="A new file, or folder.")
@click.option("--in-place", is_flag=True, help="Only list them in FILE itself, as mask/rpil_kept: HDF5 of robomimic.")
@click.option("--share", metavar="S", type=click.FloatRange(0, 1, min_open=True), help="Keep this share, as .8.")
@click.option(
    "--at-least", metavar="P", type=click.FloatRange(0, 1), help="Keep those with a probability of P or more."
)
@click.option(
    "--verdicts",
    type=click.Path(),
    metavar="FILE",
    help="Verdicts that rpil audit wrote, or labels: keep by these, and judge nothing.",
)
@with_judge_options
def keep(
    file: str,
    output: str | None,
    in_place: bool,
    share: float | None,
    at_least: float | None,
    verdicts: str | None,
    **options: Any,
) -> None:
    """Write demonstrations to a new file of the same format, without those that an audit calls unlike or bad.

    All others are kept, unless --share or --at-least says otherwise.
    """
    if share is not None and at_least is not None:
        raise click.UsageError("--share and --at-least exclude each other: leave one out")
    from rpil.audit.choice import Table, kept_ids, read_verdicts
    from rpil.audit.verdict_table import verdict_columns
    from rpil.data.id_values import check_ids
    from rpil.formats.registry import find

    if in_place == (output is not None):
        raise click.UsageError("--output NEW or --in-place says where they are written: give one of them")
    found = find(file)
    if output is not None:
        found.check_output(output)
    else:
        found.check_mask()
    quiet, stream, scheduler = (options.pop(name) for name in ("quiet", "stream", "scheduler"))
    reference = options.pop("reference")
    columns = pop_columns(options)
    if options["features"] == "auto":
        options["features"] = "folded"  # the judge's, as in an audit: no policy is kept
    with show_stages(quiet, CommandSettings.current().timing) as progress:
        if verdicts is None:
            with connect_engine(scheduler, progress) as engine:
                read = open_recording(file, columns, progress, resolve_stream(file, stream, scheduler, reference))
                good = read_reference(reference, file, columns, progress)
                audit, who = audit_by_task(file, read, FitOptions(**options), progress, engine, reference=good)
            table: Table = verdict_columns(audit, who)
            demonstrations, why = read.demonstrations, f" ({audit.finding})"
        else:
            table, why = read_verdicts(verdicts), ""
            demonstrations = _read_all(file, columns, progress, stream)
            check_ids(table["id"], demonstrations.ids, verdicts, "the ids")
        kept = kept_ids(table, share, at_least)
        if not kept:
            raise DataError(f"{file}: no demonstration is left{why}; give labels, or choose with --share.")
        lost = () if quiet else lost_without(demonstrations, kept)
        progress(f"writing {output or file}")
        if output is None:
            found.mask(kept)
        else:
            found.keep(output, kept, columns)
    ids = demonstrations.ids
    click.echo(f"Kept {len(kept):,} of {len(ids):,} demonstrations: {output or file}")
    if not quiet:
        print_lines([*lost, *found.commands_to_keep(ids, kept, output or "")])


def _read_all(
    file: str, columns: ColumnOptions, progress: StageProgress, stream: bool | None
) -> Demonstrations | Dataset:
    """The demonstrations of a file, some of which may have missing values."""
    from rpil.data.missing import allow_missing

    with allow_missing():
        return open_recording(file, columns, progress, stream).demonstrations


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o",
    "--output",
    type=DataFile(),
    metavar="OUT.parquet|OUT.csv|OUT.npz",
    required=True,
    help="The file to write.",
)
@quiet_option
@with_column_options
def convert(file: str, output: str, quiet: bool, **options: Any) -> None:
    """Write the demonstrations as one table, or as NumPy's arrays: one row per step.

    It holds the observations, the actions, and for each demonstration its operator and task, where the file names them.
    """
    check_paths((file, options["operator"]), output)
    operator = options["operator"]
    columns = pop_columns(options)
    with show_stages(quiet, CommandSettings.current().timing) as progress:
        from rpil import formats

        recording = open_recording(file, columns, progress)
        demonstrations = load_into_memory(recording.demonstrations)
        operators = formats.read_demonstrators(operator, recording) if operator else dict(recording.operators)
        about = {"operator": operators, "task": recording.tasks}
        ids = [str(name) for name in demonstrations.ids]
        truth = {what: [str(of.get(m, "")) for m in ids] for what, of in about.items() if of}
        progress(f"writing {output}")
        formats.write(output, demonstrations, truth)
    size = f"{len(demonstrations):,} demonstrations, {demonstrations.n_steps:,} steps"
    click.echo(f"{size}: {output}")
