"""What texts that others may read leave out: home folders."""

from __future__ import annotations

import pytest

from rpil.data.privacy import for_others


@pytest.fixture
def home(tmp_path, monkeypatch):
    """A home folder, and a folder in it that is the current one."""
    home = tmp_path / "ann"
    (home / "work").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(home / "work")
    return home


def test_no_home_folder_is_named(home):
    for text, shown in (
        ("rpil audit {home}/work/d.csv --operator {home}/who.csv", "rpil audit d.csv --operator ~/who.csv"),
        ("rpil audit '{home}/work/my data.csv'", "rpil audit 'my data.csv'"),
        ("rpil.audit('{home}/work/a/d.csv')", "rpil.audit('a/d.csv')"),
        ("{home}", "~"),
        ("{home}/work", "."),
        ("rpil audit {home}/work/ --keep k.json", "rpil audit . --keep k.json"),
        ("rpil.audit('{home}/work')", "rpil.audit('.')"),
        ("{home}/work2 {home}/work.csv", "~/work2 ~/work.csv"),
        ("{home}a/d.csv", "{home}a/d.csv"),  # of another folder
        ("file://{home}/work/d.csv", "file://~/work/d.csv"),
        ("/home/bob/d.csv /Users/bob/d.csv", ".../d.csv .../d.csv"),
        ("/mnt/sets/d.csv ../d.csv d.csv s3://home/bob/d.csv", "/mnt/sets/d.csv ../d.csv d.csv s3://home/bob/d.csv"),
    ):
        assert for_others(text.format(home=home)) == shown.format(home=home)


@pytest.mark.parametrize("folder", ["/", ""])
def test_a_home_folder_that_is_no_ones_hides_nothing(home, monkeypatch, folder):
    monkeypatch.setenv("HOME", folder)
    monkeypatch.chdir("/")
    for text in ("rpil audit s3://b/x.csv d/e.csv", "rpil audit /mnt/e.csv", "/mnt", "1 / 2 / 3", "/"):
        assert for_others(text) == text


def test_a_deleted_folder_hides_nothing(home, monkeypatch):
    (home / "gone").mkdir()
    monkeypatch.chdir(home / "gone")
    (home / "gone").rmdir()
    assert for_others(f"rpil audit {home}/d.csv /mnt/e.csv") == "rpil audit ~/d.csv /mnt/e.csv"
    monkeypatch.chdir(home)
