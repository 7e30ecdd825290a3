"""The page of public data sets: what the script prints of a set, and that the page has every set."""

from __future__ import annotations

import runpy
from pathlib import Path

import public

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "public.md"


def test_the_worst_of_a_set_is_printed_and_an_absent_one_is_named(tmp_path, monkeypatch, capsys):
    there = public.PublicSet("ann/drives", "0123456789ab", "data", "made-up drives", "Looked at.")
    absent = public.PublicSet("bob/absent", "ba9876543210", "", "nothing", "")
    monkeypatch.setattr(public, "SETS", (there, absent))
    folder = tmp_path / "ann+drives" / "data"
    folder.mkdir(parents=True)
    runpy.run_path(str(ROOT / "tools" / "path_of_audit.py"))["write_demonstrations"](folder / "drives.csv")
    assert public.main([str(tmp_path)]) == 0
    printed = capsys.readouterr()
    assert "## ann/drives\n\nMade-up drives: 12 demonstrations, 240 steps, at commit 0123456789ab." in printed.out
    assert "**Seen:** Looked at." in printed.out
    assert "git clone https://github.com/bob/absent" in printed.err


def test_few_sentences_stand_for_many():
    assert public.listed(["a", "b"]) == "  - a\n  - b\n"
    assert len(public.listed([*"abcdefgh"]).splitlines()) == public.MAX_SENTENCES
    assert public.counted({}) == "no recording faults"


def test_the_page_has_every_set_and_its_commit():
    text = PAGE.read_text(encoding="utf-8")
    assert text.startswith(public.HEAD)
    for each in public.SETS:
        assert f"## {each.repository}\n" in text
        assert f"at commit {each.commit}." in text
        assert f"**Seen:** {each.seen}\n" in text
