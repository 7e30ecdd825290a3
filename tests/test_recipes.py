"""The recipes of docs/architecture.md: what has a line in a table of the library is a module of a temporary package."""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from functools import reduce
from itertools import chain
from typing import Any

import numpy as np
import pyarrow
import pytest
from sklearn.base import BaseEstimator, ClassifierMixin

import rpil
from audits import make_audit
from command_line import ok
from problems import make
from rpil import RPIL, Demonstrations, formats, load, save
from rpil.data.archive import CLASSES
from rpil.data.errors import DataError
from rpil.formats import registry
from rpil.inference.answers import Answers
from rpil.mixture.adversaries.named import ADVERSARIES
from rpil.numerics.blocks import add
from rpil.numerics.types import Array, Float
from rpil.results.html.page import About, make_view, render_page
from rpil.results.judged import of_each
from rpil.results.record import Audit
from rpil.results.tasks import first_of, join_audits
from rpil.scale.protocol import Engine, Shards
from small import small_rpil


class BySigns(ClassifierMixin, BaseEstimator):
    """pi(a|s) depends on the signs of the first two observations."""

    def fit(self, X, y, sample_weight):
        self.classes_ = np.unique(y)
        counts = np.ones((4, len(self.classes_)))
        np.add.at(counts, (self._cell(X), np.searchsorted(self.classes_, y)), sample_weight)
        self.proba_ = counts / counts.sum(axis=1, keepdims=True)
        return self

    def predict_proba(self, X):
        return self.proba_[self._cell(X)]

    def _cell(self, X):
        return 2 * (X[:, 0] > 0) + (X[:, 1] > 0)


def demonstrations_by_signs() -> tuple[Demonstrations, np.ndarray]:
    """Twelve experts whose action is the cell of `BySigns`, and eight demonstrations of random actions."""
    rng, is_good, episodes = np.random.default_rng(0), np.arange(20) < 12, []
    for good in is_good:
        x = rng.normal(size=(40, 2))
        episodes.append((x, BySigns()._cell(x) if good else rng.integers(4, size=40)))
    return Demonstrations.from_episodes(episodes), is_good


def test_policy_recipe():
    demonstrations, is_good = demonstrations_by_signs()
    model = RPIL(policy=BySigns()).fit(demonstrations)
    assert model.audit_.verdicts == tuple("open" if good else "outlier" for good in is_good)
    steps = np.repeat(is_good, demonstrations.lengths)
    assert (model.predict(demonstrations.observations) == demonstrations.actions)[steps].mean() > 0.99


MOSTLY_ZERO = """
from dataclasses import dataclass

import numpy as np

from rpil.data.archive import stored
from rpil.mixture.adversaries.protocol import Adversary


@stored()
@dataclass(frozen=True)
class MostlyZero(Adversary):
    name: str = "mostly zero"

    def log_prob(self, features, outputs, actions):
        return np.log(np.where(actions == 0, 0.9, 0.1 / (outputs.shape[1] - 1)))
"""

JSON_LINES = """
import json

import numpy as np

from rpil import Demonstrations
from rpil.data.files import replacing
from rpil.formats.format import Format
from rpil.formats.recording import from_demonstrations


def read(path, options):
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    columns = ([row[name] for row in rows] for name in ("observation", "action", "episode"))
    return from_demonstrations(Demonstrations.from_groups(*columns, source=path.name), "JSON lines")


def keep(path, output, ids, options):
    lines = path.read_text().splitlines()
    owners = [str(json.loads(line)["episode"]) for line in lines]
    output.write_text("".join(f"{line}\\n" for line, owner in zip(lines, owners) if owner in ids))


def write(path, demonstrations, truth):
    with replacing(path) as temporary:
        rows = (
            {"observation": x.tolist(), "action": int(a), "episode": demonstrations.ids[m]}
            | {name: values[m].item() for name, values in truth.items()}
            for x, a, m in zip(demonstrations.observations, demonstrations.actions, demonstrations.groups)
        )
        temporary.write_text("".join(json.dumps(row) + "\\n" for row in rows))


FORMAT = Format(
    name="JSON lines",
    claims=lambda path: path.is_file() and path.suffix == ".jsonl",
    read=read,
    keep=keep,
    suffixes=(".jsonl",),
    write=write,
)
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A module of a temporary package by its name; tables of the library are as they were once the test is over."""
    (tmp_path / "extension").mkdir()
    for name, source in (("__init__", ""), ("mostly_zero", MOSTLY_ZERO), ("json_lines", JSON_LINES)):
        (tmp_path / "extension" / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr("rpil.data.archive.CLASSES", CLASSES.copy())
    yield lambda name: importlib.import_module(f"extension.{name}")
    for name in [name for name in sys.modules if name.partition(".")[0] == "extension"]:
        del sys.modules[name]


def test_adversary_recipe(package, monkeypatch, tmp_path):
    mostly_zero = package("mostly_zero").MostlyZero
    monkeypatch.setitem(ADVERSARIES["discrete"], "mostly zero", lambda space, policy: mostly_zero())
    toy = make("random", 0, n_good=8, n_bad=4, steps=(40, 60))
    rng = np.random.default_rng(0)
    bad = ~toy.is_good[toy.groups].astype(bool)
    toy.actions[bad] = np.where(rng.random(bad.sum()) < 0.9, 0, rng.integers(3, size=bad.sum()))
    model = RPIL(adversary="mostly zero").fit(toy.demonstrations)
    assert model.audit_.adversary == "mostly zero"
    assert ((model.audit_.log_odds > 0) == toy.is_good).all()
    save(model, tmp_path / "model.rpil")
    assert load(tmp_path / "model.rpil").state_.adversary == mostly_zero()


def test_format_recipe(package, monkeypatch, tmp_path):
    known = *registry.known_formats(), package("json_lines").FORMAT
    monkeypatch.setattr(registry, "known_formats", lambda: known)
    toy = make("random", 0, n_good=2, n_bad=2, steps=(4, 6)).demonstrations
    path, kept = tmp_path / "toy.jsonl", tmp_path / "kept.jsonl"
    formats.write(path, toy, {"is_good": [1, 1, 0, 0]})
    again = formats.read(path)
    np.testing.assert_array_equal(again.observations, toy.observations)
    np.testing.assert_array_equal(again.actions, toy.actions)
    assert again.ids == toy.ids
    assert json.loads(path.read_text().splitlines()[-1])["is_good"] == 0
    registry.find(path).keep(kept, ["d3", "d1"])
    assert formats.read(kept).ids == ("d1", "d3")
    assert {*kept.read_text().splitlines()} < {*path.read_text().splitlines()}
    rpil.write(tmp_path / "toy.csv", toy)
    ok("convert", tmp_path / "toy.csv", "-o", path)
    assert "JSON lines" in ok("info", path).stdout
    with pytest.raises(DataError, match=r"give it the extension \.jsonl"):
        registry.find(path).keep(tmp_path / "kept.csv", ["d1"])
    with pytest.raises(DataError, match="no demonstration is called '9'"):
        registry.find(path).keep(tmp_path / "none.jsonl", [9])


@dataclass(frozen=True)
class Listed:
    """Blocks in a list, and a record of what is done with them."""

    blocks: list[Any]
    calls: list[str]

    def map(self, function: Callable[[Any], Any]) -> Iterator[Any]:
        self.calls.append("map")
        return map(function, self.blocks)

    def then(self, function: Callable[[Any], Any]) -> Listed:
        self.calls.append("then")
        return Listed([function(block) for block in self.blocks], self.calls)

    def kept(self, n_steps: int) -> Listed:
        return self

    def total(self, function: Callable[[Any], Any]) -> Any:
        self.calls.append("total")
        return reduce(add, map(function, self.blocks))


@dataclass(frozen=True)
class OneByOne:
    """An engine that reads all blocks, and works on them one by one."""

    n_shards: int = 2
    calls: list[str] = field(default_factory=list)

    def place(self, shards: Any) -> Listed:
        return Listed(list(chain.from_iterable(shards)), self.calls)


@pytest.mark.slow
def test_engine_recipe():
    engine = OneByOne()
    assert isinstance(engine, Engine)
    assert isinstance(engine.place([[1]]), Shards)
    toy = make("noisy", 0, n_good=60, n_bad=30, steps=(20, 60)).demonstrations
    here, there = small_rpil().fit(toy), small_rpil(engine=engine).fit(toy)
    assert set(engine.calls) == {"map", "then", "total"}
    np.testing.assert_allclose(there.audit_.log_odds, here.audit_.log_odds, rtol=1e-9)
    np.testing.assert_allclose(there.policy_.weights, here.policy_.weights, rtol=1e-6, atol=1e-9)


@dataclass(frozen=True, eq=False, repr=False)
class Surprised(Audit):
    surprise: Float[Array, " M"] = field(kw_only=True, metadata=of_each("M", shown="surprise"))


def test_audit_column_recipe():
    plain = make_audit()
    surprise = np.arange(10) / 4
    audit = Surprised(**{one.name: getattr(plain, one.name) for one in fields(plain)}, surprise=surprise)
    some, lengths = first_of(audit, "ab"), audit.lengths[:2]
    assert some.surprise.tolist() == [0, 0.25]
    places, offsets = {"a": [2, 1]}, np.cumsum([0, 5, *lengths[::-1]])
    joined = join_audits({"a": some}, places, "xba", offsets, Answers.none(3))
    assert joined.surprise.tolist() == [0, 0.25, 0]
    table = pyarrow.table(audit.to_frame())
    assert dict(zip(*(table[name].to_pylist() for name in ("id", "fact_surprise")), strict=True))[7] == 1.75
    assert {one["id"]: one["facts"]["surprise"] for one in audit.to_dict()["demonstrations"]}[7] == 1.75
    assert make_view(audit, About("Audit", "toy.csv"))["demonstrations"]["facts"]["surprise"][7] == 1.75


def test_report_section_recipe():
    page = render_page(make_audit(), About("Audit", "toy.csv"), [("Who recorded this", "Five people & a robot.")])
    assert "Who recorded this" in page
    assert "Five people &amp; a robot." in page
