"""Files with some other bytes end in one sentence, whatever the format: ``tools/fuzz_readers.py`` reads many more."""

from __future__ import annotations

import sys
import time
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from rpil.data.errors import DataError

TOOLS = Path(__file__).parents[2] / "tools"
sys.path.append(str(TOOLS))  # with the module of structural mutants
spec = spec_from_file_location("fuzz_readers", TOOLS / "fuzz_readers.py")
fuzz = module_from_spec(spec)
spec.loader.exec_module(fuzz)


@pytest.fixture(scope="module")
def server():
    with fuzz.server() as process:
        yield process


@pytest.mark.slow
@pytest.mark.parametrize("name", fuzz.READERS)
def test_sixty_mutants(server, name):
    counts, wrong, growth = fuzz.fuzz(server, name, seed=1, n_mutants=60)
    of_structure, wrong_structure, more = fuzz.fuzz(server, name, seed=1, n_mutants=20, structure=True)
    assert wrong + wrong_structure == []
    assert (sum(counts.values()), sum(of_structure.values())) == (60, 20)
    assert counts["refused"] >= 6
    assert max(growth, more) < 100e6


def test_mutants_depend_on_the_seed_alone(tmp_path):
    contents = []
    for seed, k in ((0, 3), (0, 3), (1, 3), (0, 4)):
        (tmp_path / "a").write_bytes(bytes(100))
        fuzz.mutate(tmp_path / "a", "CSV", seed, k)
        contents.append((tmp_path / "a").read_bytes())
        assert 1 <= sum(map(bool, contents[-1])) <= 8
    assert contents[0] == contents[1]
    assert len({*contents}) == 3


def ending_with(error):
    def read(path, output):
        raise error

    return read


@pytest.mark.parametrize(
    ("read", "end"),
    [
        (lambda path, output: None, "read"),
        (ending_with(DataError("a: it is bad; repair it.")), "refused"),
        (ending_with(DataError("a is bad. Repair it.")), "no sentence"),
        (ending_with(KeyError("a")), "traceback"),
        (lambda path, output: time.sleep(20), "too slow"),
    ],
)
def test_ends_are_told_apart(tmp_path, monkeypatch, read, end):
    monkeypatch.setattr(fuzz, "SECONDS", 0.2)
    assert fuzz.attempt(read, tmp_path, tmp_path)[0] == end


BROKEN = """def describe(*_, **__):
    n = globals()["n"] = globals().get("n", -1) + 1
    if n == 2:
        b"1" * 600_000_000
    if n == 3:
        import os
        os._exit(7)


def unused(path: Path"""


@pytest.mark.slow
def test_ended_processes_and_growth_are_seen(tmp_path, monkeypatch):
    script = Path(fuzz.__file__).read_text().replace("def describe(path: Path", BROKEN)
    (tmp_path / "tools").mkdir()
    (tmp_path / "tools" / "fuzz_readers.py").write_text(script)
    (tmp_path / "tools" / "structural.py").symlink_to(Path(fuzz.__file__).with_name("structural.py"))
    (tmp_path / "tests").symlink_to(Path(__file__).parents[1])
    monkeypatch.setattr(fuzz, "__file__", str(tmp_path / "tools" / "fuzz_readers.py"))
    with fuzz.server() as process:
        counts, wrong, growth = fuzz.fuzz(process, "CSV", seed=0, n_mutants=4)
    assert counts == {"read": 2, "grew": 1, "process ended": 1}
    assert any("mutant 1: grew" in one for one in wrong)
    assert any("mutant 2: the process ended with 7" in one for one in wrong)
    assert 500e6 < growth < 1e9
