"""``rpil keep`` and ``rpil convert``: demonstrations as files again."""

from __future__ import annotations

from collections.abc import Collection, Mapping
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
@click.option("--only-named", is_flag=True, help="Keep nothing that the FILE of --verdicts does not name.")
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

    All others are kept, unless --share or --at-least says otherwise. What is labelled bad is never kept.
    """
    only_named = options.pop("only_named")
    _check_rules(share, at_least, verdicts, only_named)
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
                table = _judged(file, read, FitOptions(**options), progress, engine, good)
        else:
            read = _read_all(file, columns, progress, stream)
            table = _verdicts_on(read, verdicts)
        kept, n_unnamed = _with_unnamed(read, table, kept_ids(table, share, at_least), only_named)
        _check_left(kept, file, verdicts, table, only_named)
        lost = () if quiet else lost_without(read.demonstrations, kept)
        trims = _idle_ends(read, kept) if trim else {}
        progress(f"writing {output or file}")
        if output is None:
            found.mask(kept)
        else:
            found.keep(output, kept, columns, trims)
    tell_of_set_aside(read)
    _print_kept(read, kept, output or file, trims if trim else None)
    if n_unnamed:
        click.echo(f"{n_unnamed:,} of these are not named in {verdicts}: --only-named leaves them out.")
    if not quiet:
        print_lines([*lost, *found.commands_to_keep(read.ids, kept, output or "")])


def _check_rules(share: float | None, at_least: float | None, verdicts: str | None, only_named: bool) -> None:
    """Refuse, before any work, rules that exclude each other."""
    if share is not None and at_least is not None:
        raise click.UsageError("--share and --at-least exclude each other: leave one out")
    if only_named and verdicts is None:
        raise click.UsageError("--only-named needs the file that names them: give --verdicts FILE")


def _check_left(kept: list[Id], file: str, verdicts: str | None, table: Table, only_named: bool) -> None:
    """A `DataError` where nothing is left to keep."""
    if not kept:
        source = f"the verdicts of {verdicts}" if verdicts else "the audit"
        is_graded = "log_odds" in table and {*table.get("label", [""])} != {"bad"}  # which no share keeps
        ways = ["choose with --share"] * is_graded + ["leave out --only-named"] * only_named + ["change labels"]
        raise DataError(f"{file}: no demonstration is left by {source}; {', or '.join(ways)}.")


def _with_unnamed(read: Recording, table: Table, chosen: Collection[object], only_named: bool) -> tuple[list[Id], int]:
    """The ids of what is read that are `chosen`, or not in the table unless `only_named`, and the number of the last;
    ids are compared as text."""
    wanted, named = {*map(str, chosen)}, {*map(str, table["id"])}
    unnamed = set() if only_named else {str(name) for name in read.demonstrations.ids} - named
    return [name for name in read.demonstrations.ids if str(name) in wanted | unnamed], len(unnamed)


def _print_kept(read: Recording, kept: list[Id], where: str, trims: Mapping[Id, tuple[int, int]] | None) -> None:
    """Print how many demonstrations were kept, and how many steps were cut from them."""
    click.echo(f"Kept {len(kept):,} of {len(read.ids):,} demonstrations: {where}")
    if trims is not None:
        lengths = dict(zip(read.demonstrations.ids, read.demonstrations.lengths.tolist(), strict=True))
        n = sum(lengths[name] - end + first for name, (first, end) in trims.items())
        click.echo(f"Trimmed {len(trims):,} of them by {n:,} steps in which nothing moves.")


def _judged(
    file: str,
    read: Recording,
    options: FitOptions,
    progress: StageProgress,
    engine: Engine | None,
    good: Recording | None,
) -> Table:
    """The verdicts on what is read; nothing can be compared with one demonstration alone, which has its label only."""
    from rpil.estimators.within_tasks import Known
    from rpil.results.verdict_table import verdict_columns

    ids = read.demonstrations.ids
    if len(ids) == 1 and good is None:
        label = Known.of(read, options.labels, options.operator, None, None).labels.get(str(ids[0]), "")
        return {"id": ids, "verdict": [label or "open"], "label": [label], "log_odds": [0.0]}
    return verdict_columns(*audit_by_task(file, read, options, progress, engine, reference=good))


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

    table = read_verdicts(path, read.ids)
    check_ids(table["id"], read.ids, path, "the ids")
    return rows_of(table, {*map(str, read.demonstrations.ids)})


def _idle_ends(read: Recording, kept: list[Id]) -> dict[Id, tuple[int, int]]:
    """The steps to keep of the kept demonstrations with idle ends, by the rules of ``rpil check``."""
    from rpil.faults.recorded import faults_of
    from rpil.faults.settings import FaultSettings

    trims = faults_of(read, None, None, True, FaultSettings()).trims
    return {name: ends for name, ends in trims.items() if name in kept}


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
