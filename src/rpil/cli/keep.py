"""``rpil keep`` and ``rpil convert``: demonstrations as files again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from rpil.cli.commands import (
    CommandSettings,
    audit_data,
    check_paths,
    load_into_memory,
    look_for_faults,
    lost_without,
    open_recording,
    read_data,
    tell_of_set_aside,
)
from rpil.cli.options import (
    DataFile,
    RunOptions,
    pop_columns,
    quiet_option,
    with_choice_options,
    with_column_options,
    with_judge_options,
)
from rpil.cli.outputs import ChoiceOptions, deciding_lines
from rpil.cli.progress import StageProgress, show_stages
from rpil.cli.terminal import print_lines
from rpil.data.errors import DataError
from rpil.data.held import holding
from rpil.data.text import counted

if TYPE_CHECKING:
    from rpil.data.arrays import Id
    from rpil.formats.recording import Recording
    from rpil.formats.registry import Found
    from rpil.results.choice import Asked, Choice, Table
    from rpil.results.record import Audit


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
@click.option("--only-named", is_flag=True, help="Keep nothing that the FILE of --verdicts does not name.")
@click.option("--trim", is_flag=True, help="Cut idle heads and tails, as rpil check lists them: folders of LeRobot.")
@with_choice_options
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
) -> int:
    """Write demonstrations to a new file of the same format, without those that an audit calls bad or unlike.

    All others are kept, unless --share or --at-least says otherwise. Without two answers no more than a fifth is
    rejected as unlike; where more are, all of these are kept, and the exit code is 3.
    """
    only_named = options.pop("only_named")
    _check_rules(share, at_least, verdicts, only_named)
    wanted = ChoiceOptions.of(options, output or file)
    from rpil.formats.registry import find

    found = find(file)
    _check_output(found, output, options.pop("in_place"), trim)
    given = RunOptions.of(options)
    with show_stages(given.quiet, CommandSettings.current().timing) as progress:
        if verdicts is None:
            read, table, audit = _judged(file, given, progress)
        else:
            read, audit = _read_all(file, given, progress), None
            table = _verdicts_on(read, verdicts)
        faults = look_for_faults(read, progress, skip_bad=True) if trim or wanted.faults else None
        asked = wanted.asked(faults, share, at_least)
        choice, n_unnamed = _choice(read, table, asked, only_named)
        _check_left(choice, file, verdicts, table, only_named)
        lost = () if given.quiet else lost_without(read.demonstrations, choice.kept)
        trims = {name: faults.trims[name] for name in choice.kept if name in faults.trims} if trim and faults else {}
        progress(f"writing {output or file}")
        if output is None:
            found.mask(choice.kept)
        else:
            found.keep(output, choice.kept, given.columns, trims)
    tell_of_set_aside(read)
    _print_kept(read, choice.kept, output or file, trims if trim else None)
    if n_unnamed:
        click.echo(f"{n_unnamed:,} of these are not named in {verdicts}: --only-named leaves them out.")
    print_lines(choice.lines())
    if not given.quiet:
        deciding = deciding_lines(audit, choice) if audit is not None and choice.undecided else ()
        print_lines([*deciding, *lost, *found.commands_to_keep(read.ids, choice.kept, output or "")])
    return wanted.exit_code(choice)


def _check_rules(share: float | None, at_least: float | None, verdicts: str | None, only_named: bool) -> None:
    """Refuse, before any work, rules that exclude each other."""
    if share is not None and at_least is not None:
        raise click.UsageError("--share and --at-least exclude each other: leave one out")
    if only_named and verdicts is None:
        raise click.UsageError("--only-named needs the file that names them: give --verdicts FILE")


def _check_left(choice: Choice, file: str, verdicts: str | None, table: Table, only_named: bool) -> None:
    """A `DataError` where nothing is left to keep."""
    if not choice.kept:
        source = f"the verdicts of {verdicts}" if verdicts else "the audit"
        is_graded = "log_odds" in table and {*table.get("label", [""])} != {"bad"}  # which no share keeps
        ways = ["choose with --share"] * is_graded + ["leave out --only-named"] * only_named + ["change labels"]
        raise DataError(f"{file}: no demonstration is left by {source}; {', or '.join(ways)}.")


def _choice(read: Recording, table: Table, asked: Asked, only_named: bool) -> tuple[Choice, int]:
    """The choice among all that is read, and how many are kept although the table does not name them: all without a
    named fault, and none with `only_named`. Ids are compared as text."""
    from rpil.results.choice import Asked, choose
    from rpil.results.settings import KeepSettings

    named, ids = {*map(str, table["id"])}, read.demonstrations.ids
    others = [name for name in ids if str(name) not in named]
    choice = choose(table, KeepSettings(), asked)
    rest = choose({"id": others, "verdict": ["open"] * len(others)}, KeepSettings(), Asked(faulty=asked.faulty))
    rejected = dict(choice.rejected)
    for rule, names in (*rest.rejected.items(), *((("unnamed", rest.kept),) if only_named and rest.kept else ())):
        rejected[rule] = (*rejected.get(rule, ()), *names)
    wanted = {*map(str, choice.kept), *(() if only_named else map(str, rest.kept))}
    kept = tuple(name for name in ids if str(name) in wanted)
    return replace(choice, kept=kept, rejected=rejected), 0 if only_named else len(rest.kept)


def _print_kept(read: Recording, kept: Sequence[Id], where: str, trims: Mapping[Id, tuple[int, int]] | None) -> None:
    """Print how many demonstrations were kept, and how many steps were cut from them."""
    click.echo(f"Kept {len(kept):,} of {len(read.ids):,} demonstrations: {where}")
    if trims is not None:
        lengths = dict(zip(read.demonstrations.ids, read.demonstrations.lengths.tolist(), strict=True))
        n = sum(lengths[name] - end + first for name, (first, end) in trims.items())
        click.echo(f"Trimmed {len(trims):,} of them by {n:,} steps in which nothing moves.")


def _judged(file: str, given: RunOptions, progress: StageProgress) -> tuple[Recording, Table, Audit | None]:
    """What is read, and the verdicts of its audit; without one of a single demonstration, which has its label only."""
    read, reference = read_data(file, given, progress)
    if len(read.demonstrations) == 1 and reference is None:
        from rpil.estimators.within_tasks import Statements

        label = {1: "good", -1: "bad"}.get(Statements.of(read, given.labels, given.operator).answers.labels[0], "")
        ids = read.demonstrations.ids
        return read, {"id": ids, "verdict": [label or "open"], "label": [label], "log_odds": [0.0]}, None
    audit = audit_data(file, read, reference, given, progress).audit
    from rpil.results.verdict_table import deciding_columns

    return read, deciding_columns(audit), audit


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


def _read_all(file: str, given: RunOptions, progress: StageProgress) -> Recording:
    """The recording in a file, of whose demonstrations some may have missing values."""
    from rpil.data.missing import allow_missing

    with allow_missing():
        read = open_recording(file, given.columns, progress, given.stream)
        read.demonstrations  # noqa: B018  # are read here
        return read


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
    size = f"{counted(n, 'demonstration')}, {demonstrations.n_steps:,} steps"
    click.echo(f"{size}: {output}")
