"""Archives that are damaged, edited or no archives at all are refused, each in one sentence."""

from __future__ import annotations

import io
import pickle

import numpy as np
import pytest

from archives import LOST, members, mountain_car, npy, refused, rewrite
from rpil import RPIL, save
from rpil.data.archive import settings_record
from rpil.data.errors import DataError


def npz(**arrays):
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


@pytest.fixture(scope="module")
def data():
    return mountain_car()


@pytest.fixture(scope="module")
def fitted(data):
    return RPIL(adversary="uniform").fit(data)


@pytest.fixture
def saved(fitted, tmp_path):
    path = tmp_path / "policy.rpil"
    save(fitted, path)
    return path


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (None, "there is no such file"),
        (b"", "empty"),
        *((other, "no policy that rpil saved") for other in (b"hello", pickle.dumps({"a": 1}), npy(np.array([{}])))),
        (npz(observations=np.ones((2, 2))), "no policy that rpil saved; make one with rpil fit"),
    ],
)
def test_load_refuses_other_files(content, match, tmp_path):
    if content is not None:
        (tmp_path / "other").write_bytes(content)
    refused(tmp_path / "other", match)


def test_load_refuses_truncated_and_damaged_files(saved):
    content = saved.read_bytes()
    for n in (5, 100, len(content) // 2, len(content) - 1):
        saved.write_bytes(content[:n])
        refused(saved, "damaged or truncated")
    middle = content.index(b"policy/weights.npy") + 200
    saved.write_bytes(content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :])
    refused(saved, "damaged or truncated")


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("schema", "other", "no policy that rpil saved"),
        ("version", 1, r"version 1 of the format, but rpil .* reads version 19; use"),
        ("version", None, "version None"),
        ("version", [[["x"] * 9]] * 99, r"version \S\S\S'x'.{,15} of the format, but"),
        ("class", "GaussianPolicy", LOST),
        ("class", {"RPIL": "RPIL" * 10_000}, LOST),
    ],
)
def test_load_refuses_unknown_schemas_versions_and_classes(saved, field, value, match):
    rewrite(saved, header=lambda tree: tree.update({field: value}))
    refused(saved, match)


WEIGHTS = "policy/weights.npy"


@pytest.mark.parametrize(
    ("member", "array"),
    [
        (WEIGHTS, None), (WEIGHTS, np.ones((3, 3), dtype=np.float32)), (WEIGHTS, np.ones((4, 3))),
        (WEIGHTS, np.full((3, 3), np.nan)), (WEIGHTS, np.diag([0, 0, -np.inf])), ("more.npy", np.zeros(2)),
        *(("classes.npy", np.array(classes)) for classes in ([0, 1, 2, 3], [2, 1, 0], [0, 0, 1], [0, 1, 1], [0, 2, 1])),
    ],
)  # fmt: skip
def test_load_refuses_missing_extra_and_misshapen_arrays(saved, member, array):
    rewrite(saved, {member: None if array is None else npy(array)})
    refused(saved, LOST)


def set_in(tree, path, value):
    *parents, last = path
    for key in parents:
        tree = tree[key]
    if value is ...:
        del tree[last]
    else:
        tree[last] = value


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("fitted", "policy_"), ...), (("fitted", "more_"), 1), (("fitted", "policy_", "class"), "os.system"),
        (("fitted", "policy_", "fields", "ridge"), ...), (("fitted", "features_", "fields", "kind"), "nystroem"),
        (("classes",), {"array": ["classes"]}), (("names",), ["x", "y", "z"]), (("names",), "xy"), (("classes",), None),
        *((("fitted", "state_", "fields", "prior", "fields", "p"), p) for p in (0.0, 1.0, 1.5)),
    ],
)  # fmt: skip
def test_load_refuses_inconsistent_headers(saved, path, value):
    rewrite(saved, header=lambda tree: set_in(tree, path, value))
    refused(saved, LOST)


@pytest.mark.parametrize(
    ("before", "more", "match"),
    [
        ('"params": {', '"x": ' + "[" * 600 + "]" * 600 + ", ", LOST),
        ('"params": {', '"x": ' + "[" * 100_000 + "]" * 100_000 + ", ", "damaged or truncated"),
        ('"version": ', "5" * 5000, "damaged or truncated"),
    ],
    ids=["nested", "nested deeply", "digits"],
)
def test_load_refuses_headers_beyond_all_limits(saved, before, more, match):
    header = members(saved)["header.json"].decode()
    assert before in header
    rewrite(saved, {"header.json": header.replace(before, before + more)})
    refused(saved, match)


def test_nothing_is_unpickled(saved, monkeypatch):
    def never(*args, **kwargs):
        raise AssertionError("unpickled")

    rewrite(saved, {WEIGHTS: npy(np.array([{}, []], dtype=object))})
    monkeypatch.setattr(pickle, "load", never)
    monkeypatch.setattr(pickle, "loads", never)
    refused(saved, "never unpickled")


@settings_record(share="[0, 1)")
class Record:
    count: int = 3
    tol: float = 0.1
    share: float = 0.5
    ridges: tuple[float, ...] = (1.0, 0.1)
    name: str = "raw"
    prior: float | None = None

    def __post_init__(self) -> None:
        if self.name == self.prior:
            raise DataError("The name is the prior.")


def test_values_inside_their_intervals_are_taken():
    record = Record(count=1, tol=np.float64(2), share=0, ridges=(5,), name="", prior=-1.0)
    assert (record.count, record.tol, record.share, record.ridges) == (1, 2.0, 0, (5,))


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"count": 0}, "Record: count=0 must be a whole number in [1, inf)."),
        ({"count": 1.5}, "Record: count=1.5 must be a whole number in [1, inf)."),
        ({"tol": 0.0}, "Record: tol=0.0 must be a number in (0, inf)."),
        ({"tol": float("nan")}, "Record: tol=nan must be a number in (0, inf)."),
        ({"tol": "1"}, "Record: tol='1' must be a number in (0, inf)."),
        ({"share": 1.0}, "Record: share=1.0 must be a number in [0, 1)."),
        ({"name": None}, "The name is the prior."),
        ({"ridges": ()}, "Record: ridges=() must be a tuple of numbers, each in (0, inf)."),
        ({"ridges": (1.0, -1.0)}, "Record: ridges=(1.0, -1.0) must be a tuple of numbers, each in (0, inf)."),
        ({"ridges": 1.0}, "Record: ridges=1.0 must be a tuple of numbers, each in (0, inf)."),
    ],
)
def test_field_and_interval_of_a_wrong_value_are_named(wrong, sentence):
    with pytest.raises(DataError) as error:
        Record(**wrong)
    assert str(error.value) == sentence
