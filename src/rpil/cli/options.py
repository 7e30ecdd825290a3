"""The options of the commands, and their types."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, fields
from functools import reduce
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from rpil.data.files import StrPath, check_extension

if TYPE_CHECKING:
    from rpil.formats.columns import ColumnOptions


LABELS_FILE = "labels.csv"

Value = Any
"""The value of an option: click has no types for it."""

Option = Callable[[Callable[..., Value]], Callable[..., Value]]
"""Gives a command an option."""


@dataclass(frozen=True)
class RunOptions:
    """Options of the command line about the data and about how to judge or fit them; see ``rpil audit --help``."""

    columns: ColumnOptions
    labels: str | None
    adversary: str
    quiet: bool
    reference: str | None = None
    without_faults: tuple[str, ...] = ()
    """Rules of ``rpil check`` that reject."""

    @classmethod
    def of(cls, options: dict[str, Value]) -> RunOptions:
        columns = pop_columns(options)
        options.pop("session", None)  # is one of the columns
        options["adversary"] = options["adversary"].replace("-", " ")
        return cls(columns, **options)


# The names once more: the module that defines them takes too long to import for --help; a test compares them.
ADVERSARY_CHOICE = click.Choice(
    ("auto", "constant", "uniform", "marginal", "complement", "normalised-complement", "confusion", "own-policy")
)
"""With hyphens for the spaces of the library."""


class OutputFile(click.Path):
    """A file to write, whose name ends in one of `extensions`: another one is refused before any work."""

    def __init__(self, *extensions: str) -> None:
        super().__init__(path_type=str)
        self.extensions = extensions

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "|".join(f"OUT{extension}" for extension in self.extensions)

    def convert(self, value: StrPath, param: click.Parameter | None, ctx: click.Context | None) -> str:
        return str(check_extension(value, self.extensions, param.opts[-1] if param else ""))


def verdict_limit(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """``outlier`` or ``bad``, with a number that is allowed, as ``outlier:2``."""
    if value is not None and re.fullmatch(r"(outlier|bad)(:\d{1,9})?", value) is None:
        raise click.BadParameter(f"{value!r} is neither outlier nor bad, with a number as in outlier:2")
    return value


def _rule_names(ctx: click.Context, param: click.Parameter, texts: tuple[str, ...]) -> tuple[str, ...]:
    """The names of rules of ``rpil check`` in texts that have commas between them."""
    if not texts:
        return ()
    from rpil.faults.report import rule_name

    return tuple(rule_name(name.strip(), param.opts[0]) for text in texts for name in text.split(","))


quiet_option = click.option("--quiet", "-q", is_flag=True, help="Print results only: no progress, no hints.")
format_option = click.option(
    "--format",
    "form",
    type=click.Choice(("text", "json", "markdown", "sarif")),
    default="text",
    show_default=True,
    help="What to print: text, one object of JSON, Markdown for a pull request, SARIF for code scanning.",
)
outcome_option = click.option(
    "--outcome",
    metavar="[-]COLUMN|FILE",
    multiple=True,
    help="How each demonstration ended: a column, or a CSV file (id,value), of success (0 is bad), return or rewards; "
    "or length, its steps. - means that less is better. Name several, one each: rpil learns how reliable each is.",
)
session_option = click.option(
    "--session", metavar="COLUMN|file", help="Judge within sessions: a column, or the file of each demonstration."
)
_SAY_SECONDS: Value = {"type": click.FloatRange(0, min_open=True), "metavar": "SECONDS"}
COLUMN_OPTIONS = (
    click.option("--id", metavar="COLUMN", help="The column that names the demonstration of a step."),
    click.option("--action", metavar="COLUMNS", multiple=True, help="The column of the action, or several, as a,b."),
    click.option("--observations", metavar="COLUMNS", multiple=True, help="Observations, as a,b or 'joint_*'."),
    click.option("--exclude", metavar="COLUMNS", multiple=True, help="Columns to leave out."),
    click.option("--order", metavar="COLUMN", help="The column that orders the steps of a demonstration."),
    click.option(
        "--operator",
        metavar="COLUMN|FILE",
        help="Who gave each demonstration: a column of FILE, or a CSV file (id,demonstrator).",
    ),
    click.option("--task", metavar="COLUMN", help="The column that names the task."),
    click.option("--split-gap", **_SAY_SECONDS, help="Split where timestamps jump by more than this, or go back."),
    click.option("--segment", **_SAY_SECONDS, help="Judge stretches of this length instead of demonstrations."),
    click.option(
        "--action-kind",
        type=click.Choice(("auto", "discrete", "continuous")),
        default="auto",
        show_default=True,
        help="Whether columns of whole numbers hold classes or amounts.",
    ),
    click.option("--only", metavar="IDS", multiple=True, help="Read only these demonstrations, as 0-16,22."),
    click.option("--without", metavar="IDS", multiple=True, help="Leave these demonstrations out, as 3,7."),
    click.option("--skip-bad", is_flag=True, help="Leave out demonstrations with missing values, and damaged ones."),
    click.option(
        "--memory",
        metavar="SIZE",
        help="Memory for data, such as 4GB; by default half of what is free, at most 512MB. Larger data stay on disk.",
    ),
)
FIT_OPTIONS = (
    *COLUMN_OPTIONS,
    click.option(
        "--labels",
        type=click.Path(),
        metavar="FILE",
        help="A CSV file (id,label) of answers: good, bad, better than ID, same as ID.",
    ),
    outcome_option,
    click.option(
        "--adversary",
        type=ADVERSARY_CHOICE,
        default="auto",
        show_default=True,
        help="Model of the actions of bad demonstrators; auto needs none.",
    ),
    quiet_option,
)
LABEL_OPTIONS = (*FIT_OPTIONS, session_option)
"""Options of an audit but --reference, which has no effect once answers are learned."""
JUDGE_OPTIONS = (
    *LABEL_OPTIONS,
    click.option(
        "--reference",
        type=click.Path(),
        metavar="FILE",
        help="A file of good demonstrations; rpil judges them together with those of FILE, and does not print them.",
    ),
)

faults_option = click.option(
    "--without-faults",
    metavar="RULES",
    multiple=True,
    callback=_rule_names,
    help="Reject demonstrations with these faults, as jump,frozen-sensor.",
)
SEGMENT_OPTIONS = (
    click.option("--ranges", type=OutputFile(".json"), help="Also write the rows to keep of each demonstration."),
    click.option(
        "--idle",
        type=click.Choice(("keep", "drop", "openpi")),
        default="keep",
        show_default=True,
        help="With --ranges: drop rows in which nothing moves, or the rows that openpi drops.",
    ),
    click.option(
        "--ranges-id", metavar="PATTERN", help="With --ranges: the key of each list, as '{folder}--{file}' by columns."
    ),
    click.option(
        "--segments",
        type=OutputFile(".parquet", ".csv", ".json"),
        help="Also write a table of segments: acts, idle rows, takeovers, with scores.",
    ),
)


def with_options(*options: Option) -> Option:
    """Give a command all of these options, in the order in which its help shows them."""
    return lambda command: reduce(lambda wrapped, option: option(wrapped), reversed(options), command)


def pop_columns(options: dict[str, Value]) -> ColumnOptions:
    """The options for reading, removed from `options`; the session stays, because a fit needs it too."""
    from rpil.formats.columns import ColumnOptions

    names = {one.name for one in fields(ColumnOptions)} - {"session", "allow_missing", "on_disk"}
    return ColumnOptions(session=options.get("session"), **{name: options.pop(name) for name in names & options.keys()})


_NOT_AGAIN = "labels", "quiet", "memory", "browser"


def command_words(ctx: click.Context, name: str, without: Collection[str] = _NOT_AGAIN) -> list[str]:
    """The command `name` with the arguments of `ctx`, `without` some options: the memory of now may be too little."""
    words = ["rpil", name]
    for param in ctx.command.params:
        value = ctx.params.get(str(param.name))
        if isinstance(param, click.Argument):
            words.append(str(value))
        elif param.name not in without and ctx.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE:
            if isinstance(value, bool):
                words += param.opts[:1] if value else param.secondary_opts[:1]
            else:
                for one in value if isinstance(value, tuple) else (value,):
                    words += [param.opts[0], f"{one:g}" if isinstance(one, float) else str(one)]
    return words
