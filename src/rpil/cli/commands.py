"""Shared parts of the commands: error messages, reading the data, and a fit with the options of the command line."""

from __future__ import annotations

import errno
import io
import os
import shlex
import sys
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NoReturn

import click
from click.core import ParameterSource

from rpil.cli.options import RunOptions, Value, command_words
from rpil.cli.terminal import LOADING, StageProgress, print_warnings, to_one_line
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import StrPath

if TYPE_CHECKING:
    from rpil.faults.report import FaultReport
    from rpil.formats.columns import ColumnOptions
    from rpil.formats.recording import Recording
    from rpil.results.choice import Asked, Choice
    from rpil.results.record import Audit


_OF_STREAMS = errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EBADF  # of stdout and stderr, without a name


class Commands(click.Group):
    """Commands that end an error of the user with a sentence on stderr and code 2, an interruption with code 130."""

    def main(self, *args: Any, standalone_mode: bool = True, **more: Any) -> Any:
        run: Any = super().main
        if not standalone_mode:
            return run(*args, standalone_mode=False, **more)
        for stream in (sys.stdout, sys.stderr):
            if isinstance(stream, io.TextIOWrapper):  # the terminal may have no code for a character of an id
                stream.reconfigure(errors="backslashreplace")
        try:
            with print_warnings():
                code = run(*args, standalone_mode=False, **more)
        except click.Abort:
            _exit_with_error("interrupted.", 130)  # as shells have it
        except SystemExit as error:  # of click, where nobody reads stdout any more, with the 1 of faults found
            sys.exit(2 if error.code == 1 else error.code)
        except click.UsageError as error:
            command = error.ctx.command_path if error.ctx else "rpil"
            message = error.format_message().rstrip(".?").replace(". Did", "; did").replace(". (Did", " (did")
            if isinstance(error, click.NoSuchOption) and error.option_name == "--video":
                message = "No such option '--video': --without-faults frozen-picture of rpil keep looks by itself"
            _exit_with_error(f"{message}; see {command} --help.")
        except DataError as error:
            _exit_with_error(error.in_shell)
        except (click.ClickException, MissingExtraError) as error:
            _exit_with_error(str(error))
        except OSError as error:
            if error.filename is None and error.errno not in _OF_STREAMS:
                raise
            _exit_with_error(f"{error.filename or 'stdout'}: {error.strerror}; check the path.")
        sys.exit(code)


def _exit_with_error(sentence: str, code: int = 2) -> NoReturn:
    with suppress(OSError):  # of stderr
        click.echo(f"rpil: {to_one_line(sentence)}", err=True)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:  # Python would flush it again at its end, and fail
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def check_paths(inputs: Iterable[StrPath | None], *outputs: StrPath | None) -> None:
    """A `DataError`, before any work, where an output cannot be written, or is or joins an input."""
    from rpil.data import files

    given, tables = list(inputs), []
    if any(path and os.path.isdir(path) for path in given):  # else the import of all formats, which is slow, can wait
        from rpil.formats.registry import suffixes

        tables = suffixes()
    files.check_outputs(given, outputs, tables)


def open_recording(
    file: str, columns: ColumnOptions, progress: StageProgress, on_disk: bool | None = None
) -> Recording:
    """What a file holds; on disk where it does not fit in memory, unless `on_disk` is False."""
    from rpil import formats

    progress(f"reading {file}")
    recording = formats.read_recording(file, columns, on_disk=on_disk)
    if recording.columns.guessed:
        click.echo(to_one_line(recording.columns.guess.in_shell), err=True)
        ctx = click.get_current_context()
        for name, guess in recording.columns.guessed.items():  # so that the commands that are printed have it
            ctx.params[name] = guess if name == "id" else (guess,)
            ctx.set_parameter_source(name, ParameterSource.COMMANDLINE)
    if columns.allow_missing:
        recording.demonstrations  # noqa: B018  # are read here
    return recording


def tell_of_set_aside(recording: Recording) -> None:
    """Name what --skip-bad left out, for commands that do not print what was read."""
    for line in recording.left_out:
        click.echo(line, err=True)


@dataclass(frozen=True, eq=False)
class AuditRun:
    """An audit, and the recording that it is of."""

    audit: Audit
    source: str
    """The path of the data."""
    recording: Recording
    demonstrators: Mapping[str, str]
    """By the ids of their demonstrations."""
    faults: FaultReport | None = None
    asked: Asked | None = None
    """What the user says of which demonstrations to keep."""

    @cached_property
    def choice(self) -> Choice:
        """Those to keep, and why the others are not."""
        from rpil.results.choice import Asked, choose

        return choose(self.audit.table(), self.asked or Asked())

    @cached_property
    def lost(self) -> tuple[str, ...]:
        """What is lost without those that are not kept."""
        from rpil.results.lost import lost_places

        return lost_places(self.recording.demonstrations, self.choice.kept)


def judge(file: str, given: RunOptions, progress: StageProgress) -> AuditRun:
    """Judge the demonstrations in `file` within their tasks and sessions, beside those of the --reference, which is
    read by the same columns; then the data are read into memory."""
    columns, reference = given.columns, given.reference
    recording, beside = open_recording(file, columns, progress, None if reference is None else False), None
    if columns.only and reference is None and len(recording.demonstrations) == 1:
        raise DataError(f"{file}: one demonstration alone cannot be judged; rpil convert --only writes it as it is.")
    if reference is not None:
        if os.path.realpath(reference) == os.path.realpath(file):
            raise DataError(f"{reference}: the reference is the data themselves; give other demonstrations.")
        named: dict[str, Value] = {**recording.columns.guessed, "guess": False}  # without ids of the data
        beside = open_recording(reference, replace(columns, only=(), without=(), **named), progress, False)
    progress(LOADING)
    from rpil.estimators.auditing import JUDGE_FEATURES, audit_recording
    from rpil.estimators.pipeline import FitOptions
    from rpil.estimators.settings import Settings
    from rpil.estimators.within_tasks import Statements

    stated, ctx = Statements.of(recording, given.labels, None, reference=beside), click.get_current_context()
    features = JUDGE_FEATURES if given.features == "auto" else given.features  # no policy is kept
    command = shlex.join(command_words(ctx, str(ctx.info_name), without=("quiet",)))
    chosen = FitOptions(features, given.adversary, given.seed, ctx.obj or Settings(), progress)
    audit = audit_recording(recording, stated, chosen, file, command, (given.labels, reference, *columns.files))
    return AuditRun(audit, file, recording, {name: str(who) for name, who in stated.demonstrators.items()})


def look_for_faults(
    recording: Recording, progress: StageProgress, skip_bad: bool = False, rules: Iterable[str] = ()
) -> FaultReport:
    """What the rules of ``rpil check`` find in the steps, without those with missing values if `skip_bad`; in files and
    videos as far as `rules` asks for it, which takes longer."""
    from rpil.faults.checking import check
    from rpil.faults.recorded import BY_LOOKING, FOLDER_RULES

    progress("looking for recording faults")
    wanted = {*rules}
    looks, reads = (any(rule.name in wanted for rule in some) for some in (BY_LOOKING, FOLDER_RULES))
    return check(recording if reads else replace(recording, find_defects=None), video=looks, skip_bad=skip_bad)
