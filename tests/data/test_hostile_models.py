"""Saved models that were edited: each is refused in one sentence, and none takes more than 1 GiB."""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from pathlib import Path

import pytest
from numpy.lib import format as npy

from hostile import MAX_BYTES, assert_refused, read_all

MODEL = Path(__file__).parents[1] / "golden" / "discrete_judge.rpil"
WEIGHTS = "policy/weights.npy"
GIANT = (3 * 10**8, 2)  # of float64: 4.8 GB


def edited(change=lambda header: None, members=(), sizes=(), again=()):
    """The model with its header changed in place or to other text, and other members.

    `sizes` are said of members that are smaller; members `again` are there twice.
    """

    def make(path):
        with zipfile.ZipFile(MODEL) as archive:
            content = {name: archive.read(name) for name in archive.namelist()}
        header = json.loads(content["header.json"])
        text = change(header)
        content["header.json"] = (text if isinstance(text, str) else json.dumps(header)).encode()
        with zipfile.ZipFile(path, "w") as archive, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of two members with one name
            for name, part in [*(content | dict(members)).items(), *((name, content[name]) for name in again)]:
                archive.writestr(name, part)
            for name, size in sizes:
                archive.getinfo(name).file_size = size

    return make


def head_of_giant():
    stream = io.BytesIO()
    npy.write_array_header_1_0(stream, {"descr": "<f8", "fortran_order": False, "shape": GIANT})
    return stream.getvalue()


GIANT_SIZE = len(head_of_giant()) + 8 * GIANT[0] * GIANT[1]


def nested(depth):
    return lambda header: json.dumps(header).replace(
        '"params": {', '"params": {"x": ' + "[" * depth + "]" * depth + ", "
    )


def set_field(name, value):
    return lambda header: header["fitted"]["audit_"]["fields"].update({name: value})


FILES = {
    "class-list.rpil": edited(lambda header: header.update({"class": ["RPIL"]})),
    "class-object.rpil": edited(lambda header: header.update({"class": {"RPIL": "RPIL" * 10_000}})),
    "nested-600.rpil": edited(nested(600)),
    "nested-100000.rpil": edited(nested(100_000)),
    "large-number.rpil": edited(set_field("finding", 10**400)),
    "large-prior.rpil": edited(set_field("prior", 10**400)),
    "large-ridge.rpil": edited(
        lambda header: header["fitted"]["policy_"]["fields"].update(ridge=10**400, path=10**400)
    ),
    "digits.rpil": edited(lambda header: json.dumps(header).replace('"version": ', '"version": ' + "5" * 5000)),
    "array-of-no-name.rpil": edited(lambda header: header.update(classes={"array": ["classes"]})),
    "fields-list.rpil": edited(lambda header: header["fitted"]["audit_"].update(fields=[1])),
    "class-of-part-list.rpil": edited(lambda header: header["fitted"]["audit_"].update({"class": [1]})),
    "unknown-giant.rpil": edited(members=[("more.npy", head_of_giant())], sizes=[("more.npy", GIANT_SIZE)]),
    "known-giant.rpil": edited(members=[(WEIGHTS, head_of_giant())], sizes=[(WEIGHTS, GIANT_SIZE)]),
    "giant-header.rpil": edited(sizes=[("header.json", 6 * 10**9)]),
    "unknown.rpil": edited(members=[("more.npy", head_of_giant())]),
    "twice.rpil": edited(again=[WEIGHTS]),
}


@pytest.fixture(scope="module")
def ends(tmp_path_factory):
    files = {name: (make, "rpil:load") for name, make in FILES.items()}
    return read_all(tmp_path_factory.mktemp("hostile"), files)


@pytest.mark.parametrize("name", FILES)
def test_it_is_refused_in_one_sentence(ends, name):
    assert_refused(ends[0][name], name)


def test_members_that_hold_more_than_the_file_or_are_unknown_are_not_read(ends):
    found, peak = ends
    for name in ("known-giant.rpil", "giant-header.rpil", "unknown-giant.rpil"):
        assert "more than the file" in found[name][1]
    assert "parts do not belong together" in found["unknown.rpil"][1]
    assert peak < MAX_BYTES
