"""``rpil keep`` and ``rpil convert``: demonstrations as files again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rpil.cli.commands import (
    audit_data,
    check_paths,
    look_for_faults,
    open_recording,
    open_with_missing,
    read_data,
    tell_of_set_aside,
)
from rpil.cli.options import (
    CHOICE_OPTIONS,
    COLUMN_OPTIONS,
    JUDGE_OPTIONS,
    RunOptions,
    pop_columns,
    quiet_option,
    with_options,
)
from rpil.cli.outputs import choice_asked, look_lines
from rpil.cli.terminal import print_lines, show_stages
from rpil.data.errors import DataError
from rpil.data.held import holding
from rpil.data.text import counted

if TYPE_CHECKING:
    from rpil.formats.recording import Recording
    from rpil.results.choice import Asked, Choice, Table


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="NEW", required=True, help="A new file or folder; or a list: ids.json."
)
@click.option("--share", metavar="S", type=click.FloatRange(0, 1, min_open=True), help="Keep this share, as .8.")
@click.option(
    "--at-least", metavar="P", type=click.FloatRange(0, 1), help="Keep those with a probability of P or more."
)
@click.option(
    "--verdicts",
    type=click.Path(),
    metavar="FILE",
    help="Verdicts or a list to keep that rpil wrote, or labels: keep by these, and judge nothing.",
)
@with_options(*CHOICE_OPTIONS, *JUDGE_OPTIONS)
@holding()
def keep(
    file: str,
    output: str,
    share: float | None,
    at_least: float | None,
    verdicts: str | None,
    **options: Any,
) -> None:
    """Write demonstrations to a new file of the same format, without those that are bad; or, to ids.json, their list.

    Those are bad that a label, or an outcome of 0, calls so; and those that an audit calls bad, after two answers, of
    which one is good or better and one bad or worse. All others are kept, unless --share or --at-least says otherwise.
    """
    if share is not None and at_least is not None:
        raise click.UsageError("--share and --at-least exclude each other: leave one out")
    from rpil.formats.registry import find

    source, given = find(file), RunOptions.of(options)
    source.check_output(output, given.columns)
    with show_stages(given.quiet) as progress:
        audit = None
        if verdicts is None:
            read, reference = read_data(file, given, progress)
            audit = audit_data(file, read, reference, given, progress).audit
            table: Table = audit.table()
        else:
            read = open_with_missing(file, given.columns, progress)
            table = _verdicts_on(read, verdicts)
        faults = look_for_faults(read, progress, True, given.without_faults) if given.without_faults else None
        asked = choice_asked(given, faults, share, at_least)
        choice, n_unnamed = _choice(read, table, asked)
        _check_left(choice, file, verdicts, table)
        from rpil.results.lost import lost_places

        lost = () if given.quiet else lost_places(read.demonstrations, choice.kept)
        progress(f"writing {output}")
        read.keep(choice.kept, output)
    tell_of_set_aside(read)
    click.echo(f"Kept {len(choice.kept):,} of {len(read.ids):,} demonstrations: {output}")
    if n_unnamed:
        click.echo(f"{n_unnamed:,} of these are not named in {verdicts}: --only IDS keeps some alone.")
    print_lines(choice.lines())
    if not given.quiet:
        look_at = () if audit is None else look_lines(audit, choice, faults)
        lines = source.commands_to_keep(read.ids, choice.kept, output)
        more = ["These ids are kept; rpil convert with --only IDS writes a table of them."]
        print_lines([*look_at, *lost, *lines, *(more if source.is_list(output) and not lines else ())])


def _check_left(choice: Choice, file: str, verdicts: str | None, table: Table) -> None:
    """A `DataError` where nothing is left to keep."""
    if not choice.kept:
        source = f"the verdicts of {verdicts}" if verdicts else "the audit"
        is_graded = "log_odds" in table and {*table.get("label", [""])} != {"bad"}  # which no share keeps
        ways = ["choose with --share"] * is_graded + ["change labels"]
        raise DataError(f"{file}: no demonstration is left by {source}; {', or '.join(ways)}.")


def _choice(read: Recording, table: Table, asked: Asked) -> tuple[Choice, int]:
    """The choice among all that is read, and how many are kept although the table does not name them: all without a
    named fault. Ids are compared as text."""
    from rpil.results.choice import choose

    choice, ids, named = choose(table, asked), read.demonstrations.ids, {*map(str, table["id"])}
    others = [name for name in ids if str(name) not in named]
    faulty = [name for name in others if str(name) in asked.faulty]
    rejected = dict(choice.rejected)
    if faulty:
        rejected["faults"] = (*rejected.get("faults", ()), *faulty)
    wanted = {*map(str, (*choice.kept, *others))} - {*map(str, faulty)}
    kept = tuple(name for name in ids if str(name) in wanted)
    return replace(choice, kept=kept, rejected=rejected), len(others) - len(faulty)


def _verdicts_on(read: Recording, path: str) -> Table:
    """The rows of a file of verdicts about the demonstrations that are read; others in the same file have none."""
    from rpil.data.id_values import check_ids
    from rpil.results.choice import read_verdicts, rows_of

    table = read_verdicts(path, read.ids)
    check_ids(table["id"], read.ids, path, "the ids")
    return rows_of(table, {*map(str, read.demonstrations.ids)})


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", type=click.Path(), metavar="OUT.parquet|OUT.csv|OUT.npz", required=True, help="The file to write."
)
@quiet_option
@with_options(*COLUMN_OPTIONS)
def convert(file: str, output: str, quiet: bool, **options: Any) -> None:
    """Write the demonstrations as one table, or as NumPy's arrays: one row per step.

    It holds the observations, the actions, and for each demonstration its operator and task, where the file names them.
    """
    columns = pop_columns(options)
    operator = columns.operator
    with show_stages(quiet) as progress:
        from rpil import formats

        formats.writer_of(output)
        check_paths((file, operator), output)
        recording = open_recording(file, columns, progress)
        demonstrations = recording.demonstrations.select(slice(None))  # in memory
        operators = formats.read_demonstrators(operator, recording) if operator else dict(recording.operators)
        about = {"operator": operators, "task": recording.tasks}
        ids = [str(name) for name in demonstrations.ids]
        truth = {what: [str(of.get(m, "")) for m in ids] for what, of in about.items() if of}
        progress(f"writing {output}")
        formats.write(output, demonstrations, truth)
    tell_of_set_aside(recording)
    n = len(demonstrations)
    size = f"{counted(n, 'demonstration')}, {demonstrations.n_steps:,} steps"
    click.echo(f"{size}: {output}")
