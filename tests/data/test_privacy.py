"""What texts that others may read leave out: secrets in addresses, and home folders."""

from __future__ import annotations

import time

import pytest

from rpil.data.privacy import for_others, without_secrets

S = "HIDDEN"
NAMES = (
    *("token", "access_key", "secret_key", "X-Amz-Signature", "AWSAccessKeyId", "sig", "password", "passwd", "pass"),
    *("pwd", "auth", "authorization", "Authorization", "sas", "code", "jwt", "client_secret", "x-goog-credential"),
)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("s3://AKIA:secret@bucket/x", "s3://***@bucket/x"),
        ("s3://AKIA:sec/ret+@bucket/x", "s3://***@bucket/x"),
        ("s3:/AKIA:sec/ret@bucket/x", "s3:/***@bucket/x"),  # as a path has it
        ("https://token@h/x", "https://***@h/x"),
        (
            "rpil audit 'https://h/x.csv?a=1&X-Amz-Signature=ab%2F&b=2'",
            "rpil audit 'https://h/x.csv?a=1&X-Amz-Signature=***&b=2'",
        ),
        ("hf://datasets/a/b?token=hf_abc", "hf://datasets/a/b?token=***"),
        ("hf://datasets/me/set@main/data", "hf://datasets/me/set@main/data"),
        ("rpil audit me@home/key=3.csv", "rpil audit me@home/key=3.csv"),
        ("s3://b/x?token=a: it is empty; write it again.", "s3://b/x?token=***: it is empty; write it again."),
        ("'s3://a:b@c/x' and s3://d:e@f", "'s3://***@c/x' and s3://***@f"),
    ],
)
def test_addresses_keep_their_secrets(text, shown):
    assert without_secrets(text) == for_others(text) == shown


@pytest.mark.parametrize("sign", "?&;#")
def test_every_name_of_a_secret_is_known(sign):
    for name in NAMES:
        assert without_secrets(f"https://h/x.csv{sign}{name}={S}&b=2") == f"https://h/x.csv{sign}{name}=***&b=2"


def test_a_hostile_text_takes_no_time():
    start = time.process_time()
    for text in (":/" * 50_000, "?" + "key" * 30_000, "?key=" * 20_000, "://a:" * 20_000, "/home/" * 20_000):
        for_others(text)
    assert time.process_time() - start < 5


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
