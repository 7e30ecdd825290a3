"""The commands on folders of Parquet files and on large files."""

from __future__ import annotations

import click
import pyarrow.parquet as pq
import pytest

from command_line import call, ok
from recorded import demonstrations
from rpil import Dataset, formats
from rpil.cli import commands
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from small import SMALL


def command(*arguments):
    return ok(*arguments, settings=SMALL).stdout


def test_a_large_file_is_read_block_by_block(tmp_path):
    formats.write(tmp_path / "a.parquet", demonstrations())

    def read(stream, memory=None):
        path = str(tmp_path / "a.parquet")
        with click.Context(click.Command("audit")):
            return commands.open_recording(path, ColumnOptions(memory=memory), lambda _: None, stream).demonstrations

    assert isinstance(read(None), Demonstrations)
    on_disk = read(None, "100kB")
    assert isinstance(on_disk, Dataset)
    for into_memory in (lambda: read(False, "100kB"), lambda: on_disk.select(slice(None))):
        with pytest.raises(DataError, match=r"more than the 0\.1 MB that it may; allow more"):
            into_memory()
    for size in ("300kB", "300MB"):
        command("audit", tmp_path / "a.parquet", "--memory", size, "--weights", tmp_path / f"{size}.parquet")
    one, other = (pq.read_table(tmp_path / f"{size}.parquet") for size in ("300kB", "300MB"))
    assert one["log_odds"].equals(other["log_odds"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["audit", "a.parquet", "--memory", "much"], "'much' is no amount of memory; give one such as 4GB"),
        (["audit", "a.csv", "--memory", "1kB", "--reference", "a.npz"], "a.csv: to read it would take"),
        (["audit", "a.npz", "--memory", "1kB"], "a.npz: to read it would take"),
    ],
)
def test_options_that_exclude_each_other_are_refused(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "a.npz", "a.parquet"):
        formats.write(name, demonstrations())
    result = call(*arguments)
    assert result.exit_code == 2
    (error,) = result.stderr.splitlines()
    assert message in error
