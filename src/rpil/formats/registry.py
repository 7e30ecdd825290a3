"""The formats that are read: each is a module, and a line here."""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import pyarrow as pa

from rpil.data import files
from rpil.data.arrays import Id
from rpil.data.errors import DataError, guarded
from rpil.data.files import StrPath
from rpil.data.id_values import check_ids
from rpil.data.memory import FREE_SHARE, MOST_IN_MEMORY, Size, TooLargeError, check_memory, free_memory
from rpil.formats import table_folder
from rpil.formats.columns import ColumnOptions
from rpil.formats.format import Format, StepTables, called, from_arrow
from rpil.formats.recording import Recording, from_tables


def known_formats() -> Iterator[Format]:
    """The formats of `rpil.formats`, and of other packages, in the order in which a path is shown to them: extensions
    of one format come first, because no file is opened for them; what any folder may be comes last. A module is
    imported when its turn comes."""
    for module in ("parquet", "csv", "lerobot.folder", "array_files", "json_lines", "table_folder"):
        yield import_module(f"rpil.formats.{module}").FORMAT
    for point in entry_points(group="rpil.formats"):
        yield Format(point.name, called(point.name), partial(_read_foreign, point), suffixes=(point.name,))


def _read_foreign(point: EntryPoint, path: Path, options: ColumnOptions) -> StepTables:
    """The recording in the tables that the function of another package yields of a file."""

    def checked() -> Iterator[pa.Table]:
        n_bytes = 0
        for table in point.load()(path):
            n_bytes += table.nbytes
            check_memory(0 if options.on_disk else n_bytes, path.name, options.memory)
            yield table

    return from_arrow(checked(), options, path.name, point.name)


def find_format(path: StrPath) -> Format | None:
    """The format that claims a file or a folder, if any; a `DataError`, before anything is opened, where it is not
    there, or `check_folder` raises one."""
    files.check_folder(place := files.check_exists(path))
    return next((one for one in known_formats() if one.claims(place)), None)


@dataclass(frozen=True)
class ClaimedPath:
    """A path and the format that claims what is there, so that formats are asked once."""

    path: StrPath
    format: Format

    def read(self, options: ColumnOptions = ColumnOptions(), *, on_disk: bool | None = False) -> Recording:
        """The recording; see `rpil.formats.read_recording`."""
        if on_disk is None:
            with suppress(TooLargeError):
                return self._read(options, options.memory or min(MOST_IN_MEMORY, FREE_SHARE * free_memory()))
            folder = tempfile.gettempdir()
            logging.getLogger("rpil").warning("%s: large, so read from a copy on disk, in %s.", self.path, folder)
        return self._read(replace(options, on_disk=on_disk is not False), options.memory)

    def _read(self, options: ColumnOptions, memory: Size | None) -> Recording:
        """The recording, whose rows may take so much `memory`."""
        with guarded(str(self.path)):
            if (place := Path(self.path)).is_file():
                files.check_readable(place)
            recording = from_tables(self.format.read(place, replace(options, memory=memory)), options)
            return replace(
                recording,
                write_some=lambda ids, new: self.keep(new, ids, options, recording.ids),
                find_defects=self.format.find_defects and partial(self.format.find_defects, place),
            )

    def keep(
        self, output: StrPath, ids: Sequence[Id], options: ColumnOptions = ColumnOptions(), there: Sequence[Id] = ()
    ) -> None:
        """Write some demonstrations as `Recording.keep` does; `there` are the ids of all, where they are known."""
        with guarded(str(self.path)):
            new, path = self.check_output(output, options), Path(self.path)
            if not ids:
                raise DataError(f"{self.path}: no demonstration is to be kept; choose others.")
            there, wanted = there or self.read(options).ids, {*map(str, ids)}
            check_ids(ids, there, path.name, "the ids")
            with files.replacing(new) as temporary:
                if self.is_list(new):
                    kept, is_json = [m for m in there if str(m) in wanted], new.suffix.lower() == ".json"
                    text = json.dumps({"episodes": kept}, indent=1) if is_json else "\n".join(map(str, kept))
                    temporary.write_text(f"{text}\n", encoding="utf-8")
                    return
                assert self.format.keep is not None, "check_output refuses what is not written"
                if path.is_dir():
                    temporary.mkdir()
                self.format.keep(path, temporary, wanted, options)

    def is_list(self, output: StrPath) -> bool:
        """Whether `keep` writes the list of the ids to an output of this name."""
        suffix = Path(output).suffix.lower()
        return suffix in (".json", ".txt") and suffix != Path(self.path).suffix.lower()

    def unkept(self, options: ColumnOptions = ColumnOptions()) -> str:
        """Name of the data that `keep` writes no new file of, in words; empty where it writes one."""
        if self.format.keep is None:
            return self.format.name.removeprefix("a ")
        return self.format.unkept(Path(self.path), options)

    def annotate(self, output: StrPath, columns: Mapping[str, Mapping[str, object]]) -> None:
        """Write a copy of the folder that says more of each demonstration, which `columns` hold by name and id."""
        with guarded(str(self.path)):
            new, annotate = self.check_annotate(output)
            annotate(Path(self.path), new, columns)

    def check_annotate(self, output: StrPath) -> tuple[Path, Callable[..., None]]:
        """The path of the output and what writes it, or a `DataError`, before any work, where that is not possible."""
        if self.format.annotate is None or not any(Path(self.path).glob("meta/episodes/**/*.parquet")):
            raise DataError(f"{self.path}: it is no folder of LeRobot 3.0 with a table of episodes; use --verdicts.")
        return self.check_output(output), self.format.annotate

    def check_output(self, output: StrPath, options: ColumnOptions = ColumnOptions()) -> Path:
        """The path of the `output`, or a `DataError`, before any work, where `keep` cannot write there."""
        times = (("--split-gap", options.split_gap), ("--segment", options.segment))
        if asked := " ".join(f"{name} {seconds:g}" for name, seconds in times if seconds):
            first = f"first run rpil convert {self.path} {asked} -o ALL.parquet"
            raise DataError(f"{self.path}: keep cannot cut a file at times; {first}, then keep from that table.")
        new, path = Path(output), files.check_exists(self.path)
        if path.resolve() in (new.resolve(), *new.resolve().parents):
            raise DataError(f"{new}: it is the data themselves, or in them; give another path.")
        if new.is_dir() or (path.is_dir() and not self.is_list(new) and new.exists()):
            raise DataError(f"{new}: it is there already; give the path of a new folder.")
        if self.is_list(new):
            return files.check_writable(new)
        with guarded(str(path)):
            if layout := self.unkept(options):
                ways = "write the list with -o ids.json, or a table with rpil convert"
                raise DataError(f"{self.path}: keep writes no {layout}; {ways}.")
            if path.is_dir() and new.name.lower().endswith(tuple(suffixes())):
                raise DataError(f"{new}: the data are a folder, so name a folder, or write a table with rpil convert.")
            extension = path.suffix.lower() or "".join(self.format.suffixes[:1])
            if path.is_file() and new.suffix.lower() != extension:
                raise DataError(f"{new}: give it the extension {extension}, or write another format with rpil convert.")
        return files.check_writable(new)


def find(path: StrPath) -> ClaimedPath:
    """`path` with its format; a `DataError` where there is nothing, or nothing that is known."""
    if "://" in str(path):
        scheme, _, _ = str(path).partition("://")  # the rest may hold a password
        raise DataError(f"{scheme}://...: addresses are not read; download the data, and give their path.")
    known = find_format(path)
    if known is None:
        table_folder.refuse_others(there := Path(path), [there.name])
        files.check_extension(there, suffixes())
    assert known is not None, "an extension that is known is claimed"
    return ClaimedPath(path, known)


def writer_of(path: StrPath) -> Format:
    """The format that is written to files with the extension of `path`; a `DataError` that names these extensions."""
    writers = {one.suffixes[0]: one for one in known_formats() if one.write is not None}
    return writers[files.check_extension(path, writers).suffix.lower()]


def suffixes() -> list[str]:
    """The extensions of files of all formats."""
    return [suffix for one in known_formats() for suffix in one.suffixes]
