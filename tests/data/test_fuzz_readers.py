"""Files with some other bytes end in one sentence, whatever the format: ``tools/fuzz_readers.py`` reads many more."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

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
def test_some_mutants(server, name):
    counts, wrong, growth = fuzz.fuzz(server, name, seed=1, n_mutants=6)
    of_structure, wrong_structure, more = fuzz.fuzz(server, name, seed=1, n_mutants=6, structure=True)
    assert wrong + wrong_structure == []
    assert (sum(counts.values()), sum(of_structure.values())) == (6, 6)
    assert counts["refused"] + of_structure["refused"] >= 2
    assert max(growth, more) < 100e6
