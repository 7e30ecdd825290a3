"""Names from data are shown as they are, but for characters that cannot be seen."""

from __future__ import annotations

import pytest

from rpil.data.text import counted, duration, for_others, listed, moment, one_line, printable


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        (7, "7"),
        ("naïve 漢字", "naïve 漢字"),
        ("two\nlines\tand a tab", r"two\nlines\tand a tab"),
        ("\x1b[31mred", r"\x1b[31mred"),
        ("right \u202e left", r"right \u202e left"),
        ("half \ud800", r"half \ud800"),
    ],
)
def test_invisible_characters_are_escaped(name, shown):
    assert printable(name) == shown
    printable(name).encode("utf-8")


def test_lines_may_stay_or_become_spaces():
    assert printable("a\n\tb\x1b", kept="\n\t") == "a\n\tb\\x1b"
    assert one_line(" a\n\tb ") == "a b"


def test_five_names_are_listed_and_the_others_counted():
    assert listed(["a"]) == "a"
    assert listed([1, "b\x1b", 3]) == r"1, b\x1b and 3"
    assert listed(range(1005)) == "0, 1, 2, 3, 4 and 1,000 more"
    assert listed(["a", ""], last=", ") == "a, no name"
    assert (counted(1, "step"), counted(2_000, "step")) == ("1 step", "2,000 steps")


def test_times_are_seconds_where_these_are_known():
    assert [duration(n, 0.05) for n in (1, 19, 20, 995)] == ["0.05 s", "0.95 s", "1.0 s", "49.8 s"]
    assert [duration(n, None) for n in (1, 12.4)] == ["1 step", "12 steps"]
    assert [moment(995, seconds) for seconds in (0.05, None)] == ["49.8 s", "step 995"]


def test_no_home_folder_is_named(monkeypatch):
    monkeypatch.setenv("HOME", "/srv/ann")
    for text, shown in (
        (
            "rpil audit /srv/ann/work/d.csv --operator '/srv/ann/a b.csv'",
            "rpil audit ~/work/d.csv --operator '~/a b.csv'",
        ),
        ("/srv/ann", "~"),
        ("/srv/anna/d.csv", "/srv/anna/d.csv"),  # of another folder
        ("file:///srv/ann/work/d.csv", "file://~/work/d.csv"),
        ("/home/bob/d.csv /Users/bob/d.csv", ".../d.csv .../d.csv"),
        ("/mnt/sets/d.csv ../d.csv s3://home/bob/d.csv", "/mnt/sets/d.csv ../d.csv s3://home/bob/d.csv"),
    ):
        assert for_others(text) == shown
    monkeypatch.setenv("HOME", "/")
    assert for_others("rpil audit /mnt/e.csv 1 / 2") == "rpil audit /mnt/e.csv 1 / 2"
