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
    tell_of_set_aside,
)
from rpil.cli.options import (
    DataFile,
    FitOptions,
    pop_columns,
    quiet_option,
    with_column_options,
    with_judge_options,
)
from rpil.cli.options_file import file_argument
from rpil.cli.outputs import lost_without
from rpil.cli.progress import StageProgress, show_stages
from rpil.cli.terminal import print_lines
from rpil.data.errors import DataError
from rpil.data.held import holding

if TYPE_CHECKING:
    from rpil.data.arrays import Id
    from rpil.formats.columns import ColumnOptions
    from rpil.formats.recording import Recording
    from rpil.formats.registry import Found
    from rpil.results.choice import Table
    from rpil.scale.protocol import Engine


@click.command()
@file_argument
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
@click.option("--trim", is_flag=True, help="Cut idle heads and tails, as rpil check lists them: folders of LeRobot.")
@with_judge_options
@holding()
def keep(
    file: str,
    output: str | None,
    share: float | None,
    at_least: float | None,
    verdicts: str | None,
    trim: bool,
    **options: Any,
) -> None:
    """Write demonstrations to a new file of the same format, without those that an audit calls unlike or bad.

    All others are kept, unless --share or --at-least says otherwise.
    """
    if share is not None and at_least is not None:
        raise click.UsageError("--share and --at-least exclude each other: leave one out")
    from rpil.formats.registry import find
    from rpil.results.choice import kept_ids

    found = find(file)
    _check_output(found, output, options.pop("in_place"), trim)
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
                table, why = _judged(file, read, FitOptions(**options), progress, engine, good)
        else:
            why, read = "", _read_all(file, columns, progress, stream)
            table = _verdicts_on(read, verdicts)
        demonstrations = read.demonstrations
        kept = kept_ids(table, share, at_least)
        if not kept:
            raise DataError(f"{file}: no demonstration is left{why}; give labels, or choose with --share.")
        lost = () if quiet else lost_without(demonstrations, kept)
        trims = _idle_ends(read, kept) if trim else {}
        progress(f"writing {output or file}")
        if output is None:
            found.mask(kept)
        else:
            found.keep(output, kept, columns, trims)
    ids, whole = demonstrations.ids, read.ids
    tell_of_set_aside(read)
    click.echo(f"Kept {len(kept):,} of {len(whole):,} demonstrations: {output or file}")
    if trim:
        n = sum(int(demonstrations.lengths[ids.index(name)]) - end + first for name, (first, end) in trims.items())
        click.echo(f"Trimmed {len(trims):,} of them by {n:,} steps in which nothing moves.")
    if not quiet:
        print_lines([*lost, *found.commands_to_keep(whole, kept, output or "")])


def _judged(
    file: str,
    read: Recording,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None,
    good: Recording | None,
) -> tuple[Table, str]:
    """The verdicts on what is read, and why; nothing can be compared with one demonstration alone, which stays open."""
    from rpil.results.verdict_table import verdict_columns

    if len(read.demonstrations) == 1 and good is None:
        return {"id": read.demonstrations.ids, "verdict": ["open"], "log_odds": [0.0]}, ""
    audit, who = audit_by_task(file, read, options, progress, engine, reference=good)
    return verdict_columns(audit, who), f" ({audit.finding})"


def _check_output(found: Found, output: str | None, in_place: bool, trim: bool) -> None:
    """Refuse, before any work, an output that cannot be written."""
    if in_place == (output is not None):
        raise click.UsageError("--output NEW or --in-place says where they are written: give one of them")
    if trim and in_place:
        raise click.UsageError("--trim changes demonstrations: write them to a new folder with -o")
    if output is None:
        found.check_mask()
    else:
        found.check_output(output, trim)


def _read_all(file: str, columns: ColumnOptions, progress: StageProgress, stream: bool | None) -> Recording:
    """The recording in a file, of whose demonstrations some may have missing values."""
    from rpil.data.missing import allow_missing

    with allow_missing():
        read = open_recording(file, columns, progress, stream)
        read.demonstrations  # noqa: B018  # are read here
        return read


def _verdicts_on(read: Recording, path: str) -> Table:
    """The rows of a file of verdicts about the demonstrations that are read; others in the same file have none."""
    from rpil.data.id_values import check_ids
    from rpil.results.choice import read_verdicts, rows_of

    table = read_verdicts(path)
    check_ids(table["id"], read.ids, path, "the ids")
    return rows_of(table, {*map(str, read.demonstrations.ids)})


def _idle_ends(read: Recording, kept: list[Id]) -> dict[Id, tuple[int, int]]:
    """The steps to keep of the kept demonstrations with idle ends, by the rules of ``rpil check``."""
    from rpil.faults.recorded import faults_of
    from rpil.faults.settings import FaultSettings

    names = set(map(str, kept))  # of a table of verdicts they are texts
    return {
        name: ends
        for name, ends in faults_of(read, None, None, True, FaultSettings()).trims.items()
        if str(name) in names
    }


@click.command()
@file_argument
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
    tell_of_set_aside(recording)
    n = len(demonstrations)
    size = f"{n:,} demonstration{'s' * (n != 1)}, {demonstrations.n_steps:,} steps"
    click.echo(f"{size}: {output}")
