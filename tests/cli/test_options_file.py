"""``rpil.toml`` beside the data."""

from __future__ import annotations

import json
import os
import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from command_line import call, ok, refused
from rpil import formats
from rpil.cli.main import main
from rpil.cli.options_file import KEYS, NAME, read_options, write_options
from rpil.data.errors import DataError


@pytest.fixture
def data() -> Path:
    """A table of which a bout is a demonstration, in a folder of its own."""
    Path("drive").mkdir()
    x = np.random.default_rng(0).normal(size=(60, 3))
    owner = np.repeat(np.arange(6), 10)
    columns = {"bout": owner, "x": x[:, 0], "height": x[:, 1], "action": x[:, 2], "success": owner % 2 == 0}
    pq.write_table(pa.table(columns), "drive/a.parquet")
    return Path("drive/a.parquet")


def described(*words) -> dict[str, object]:
    return json.loads(ok("info", *words, "--json").stdout)


def test_options_beside_the_data_are_those_of_every_command(data):
    Path("drive", NAME).write_text('id = "bout"\nexclude = ["height"]\nonly = "0-4"\nwithout = [3]\n')
    for where in (data, data.parent):  # the file, and the folder
        result = ok("info", where, "--json")
        said = json.loads(result.stdout)
        assert (said["id_column"], said["observations"], said["demonstrations"]) == ("bout", ["x"], 4)
        assert result.stderr == f"Options from {data.parent / NAME}: id, exclude, only, without.\n"
    ok("convert", data, "-o", "some.csv")
    assert formats.read("some.csv").ids == (0, 1, 2, 4)
    for words in (["audit"], ["keep", "-o", "k.parquet"], ["fit", "-o", "p", "--method", "cloning"], ["check"]):
        assert "Options from" in ok(words[0], data, *words[1:]).stderr


def test_the_command_line_comes_before_the_file(data):
    Path("drive", NAME).write_text('id = "bout"\nexclude = "height"\nskip_bad = true\naction-kind = "continuous"\n')
    assert described(data, "--exclude", "x")["observations"] == ["height"]
    assert described("--exclude", "x", data)["observations"] == ["height"]
    assert described(data)["observations"] == ["x"]


def test_what_a_command_has_no_option_for_is_not_used(data):
    Path("drive", NAME).write_text('id = "bout"\noutcome = "success"\nsession = "file"\n')
    assert ok("convert", data, "-o", "b.csv").stderr.startswith(f"Options from {data.parent / NAME}: id.\n")
    ok("fit", data, "-o", "p", "--method", "cloning")  # which has no outcome, unless it is on the command line
    result = call("fit", data, "-o", "q", "--method", "cloning", "--outcome", "success")
    assert "--outcome has no effect with --method cloning" in result.stderr


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour = 1", "there is no option 'colour'; write some of id, "),
        ("labels = 'labels.csv'", "there is no option 'labels'"),
        ("embeddings = '/etc/x.npz'", "there is no option 'embeddings'"),
        ("operator = 'who.csv'", "operator needs a column"),
        ("id = ['a', 'b']", "id needs a text"),
        ("id = true", "id needs a text"),
        ("exclude = {a = 1}", "exclude needs a text or a list"),
        ("only = [1, [2]]", "only needs a text or a list"),
        ("skip-bad = 'yes'", "skip-bad needs true or false"),
        ("only = ", "not valid TOML"),
        ("only = " + "[" * 10_000, "not valid TOML"),
        ("#" * (1 << 15), "longer than 16 KiB"),
        ("a." * 8_000 + "b = 1", "a key in it has more than 8 dots"),
        ("action-kind = 'odd'", "--action-kind"),
        ("exclude = 'colour'", "no column is called 'colour'"),
    ],
)
def test_what_is_wrong_is_one_sentence(data, text, message):
    Path("drive", NAME).write_text(text)
    result = [line for line in refused_with(message, data).splitlines() if line.startswith("rpil: ")]
    assert len(result) == 1


def refused_with(message: str, data: Path) -> str:
    result = call("info", data)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr
    return result.stderr


def test_bytes_that_are_no_text_are_refused(data):
    Path("drive", NAME).write_bytes(b"id = '\xff'")
    refused("not valid TOML in UTF-8", "info", data)


def test_a_link_out_of_the_folder_is_not_followed(data):
    Path("secret").write_text("password = 1")
    os.symlink(Path("secret").absolute(), Path("drive", NAME))
    assert "password" not in refused("a link that leads out of drive", "info", data)


def test_what_is_no_file_is_not_read(data):
    os.mkfifo(Path("drive", NAME))
    assert "Options" not in ok("info", data, "--id", "bout").stderr


def test_options_are_written_and_read_again(data):
    first = ["--id", "bout", "--exclude", "height", "--exclude", 'a "b"\\c', "--outcome", "-success", "--only", "0-3,5"]
    pq.write_table(pq.read_table(data).append_column('a "b"\\c', [[0.5] * 60]), data)
    assert ok("info", data, *first, "--write-options").stdout.endswith(f"Options: {data.parent / NAME}\n")
    said = tomllib.loads(Path("drive", NAME).read_text())
    expected = {"id": "bout", "outcome": "-success", "exclude": ["height", 'a "b"\\c'], "only": ["0-3,5"]}
    assert said == expected
    assert described(data) == described(data, *first)
    Path("drive", NAME).rename("old.toml")
    ok("info", data, *first, "--without", "1", "--skip-bad", "--write-options")
    assert tomllib.loads(Path("drive", NAME).read_text()) == expected | {"without": ["1"], "skip-bad": True}
    assert described(data)["demonstrations"] == 4


def test_options_that_are_there_are_not_written_over(data):
    Path("drive", NAME).write_text("# my own\nid = 'bout'\n")
    before = Path("drive", NAME).read_bytes()
    result = call("info", data, "--without", "1", "--write-options")
    assert result.exit_code == 2
    assert f"rpil: {data.parent / NAME}: it is there already; change it with an editor" in result.stderr
    assert Path("drive", NAME).read_bytes() == before


def test_options_are_not_written_through_a_link(data):
    os.symlink(Path("elsewhere").absolute(), Path("drive", NAME))
    result = call("info", data, "--id", "bout", "--write-options")
    assert result.exit_code == 2
    assert "it is there already" in result.stderr
    assert not Path("elsewhere").exists()


def test_options_that_cannot_be_read_with_are_not_written(data):
    refused("no column is called 'colour'", "info", data, "--id", "colour", "--write-options")
    assert not Path("drive", NAME).exists()


def test_every_key_is_an_option_and_every_text_survives(tmp_path):
    options = {param.name for command in main.commands.values() for param in command.params}
    assert {key.replace("-", "_") for key in KEYS} <= options
    odd = "".join(map(chr, range(1, 200))) + "\U0001f600"
    path = write_options(str(tmp_path), {"id": odd, "exclude": (odd, "b"), "fill_missing": True, "action_kind": "auto"})
    assert read_options(path) == {"id": odd, "exclude": [odd, "b"], "fill-missing": True}
    (tmp_path / NAME).write_text("size = 1")
    with pytest.raises(DataError, match="no option 'size'"):
        read_options(tmp_path / NAME)
