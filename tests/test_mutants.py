"""The mutants of `tools/mutants.py`."""

import runpy
import tomllib
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "mutants.py"))


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("x = a < b", {("a < b", "a <= b"), ("a < b", "a >= b")}),
        ("x = a <= b < c", {("a <= b < c", f"a {one} b {two} c") for one, two in ("<<", "><")} | {
            ("a <= b < c", "a <= b <= c"), ("a <= b < c", "a <= b >= c")}),
        ("x = a + b", {("a + b", "a - b")}),
        ("x *= y", {("x *= y", "x /= y")}),
        ("x = not a", {("not a", "a")}),
        ("x = a and b", {("a and b", "a or b")}),
        ("x = 5", {("5", "6"), ("5", "10")}),
        ("x = True", {("True", "False")}),
        ("x = zip(a, b, strict=True)", set()), ("if TYPE_CHECKING:\n    x = 1", set()),
        ("x = np.min(a)", {("np.min", "np.max")}),
        ("def f():\n    'text'\n    return a", {("return a", "return None")}),
        ("def f(x: A[2]) -> B[3]:\n    return x == y", {
            ("return x == y", "return None"), ("return x == y", "return not x == y"), ("x == y", "x != y")}),
    ],
)  # fmt: skip
def test_mutants_of(source, expected):
    assert {(old, new) for _, old, new, _ in TOOL["mutants"](source)} == expected


def test_explained_survivors_exist():
    for module, explained in tomllib.loads(TOOL["SURVIVORS"].read_text(encoding="utf-8")).items():
        source = TOOL["path_of"](module).read_text()
        code = source.splitlines()
        every = {f"{code[line - 1].strip()}: {old} -> {new}" for line, old, new, _ in TOOL["mutants"](source)}
        assert {*explained} <= every
        assert all(why.endswith(".") for why in explained.values())


def test_a_mutant_meets_the_tests_that_call_its_function_or_read_its_constant():
    module = "numerics/parallel"
    source = TOOL["path_of"](module).read_text().splitlines()
    constant = next(k for k, line in enumerate(source, 1) if line.startswith("THREADING_MIN_SIZE"))
    first, last, _ = next(own for own in TOOL["library"]()[module] if "THREADING_MIN_SIZE" in own[2])
    calls = {
        "tests/cli/test_main.py::test_calls": [0.1, [f"{module}:{first}"]],
        "tests/numerics/test_newton.py::test_calls": [0.1, [f"{module}:{first}"]],
        "tests/numerics/test_newton.py::test_calls_another": [0.1, [f"numerics/blocks:{first}"]],
        "tests/numerics/test_parallel.py::test_in_a_process": [0.1, []],
        "tests/cli/test_main.py::test_takes_long": [9.9, [f"{module}:{first}"]],
    }
    names = ["test_in_a_process", "test_calls", "test_calls"]
    for line in (constant, last):
        assert [test.partition("::")[2] for test in TOOL["callers"](module, line, calls, 10.0)] == names


def test_every_night_takes_every_room():
    text = (TOOL["ROOT"] / ".github" / "workflows" / "nightly.yml").read_text()
    assert sorted(text.partition("room: [")[2].partition("]")[0].split(", ")) == TOOL["ROOMS"]
    assert {"mixture/em", "mixture/adversaries/box"} <= {*TOOL["modules_of"]("mixture")}
    assert TOOL["drawn"]("numerics", 0, 3) == TOOL["drawn"]("numerics", 0, 3) != TOOL["drawn"]("numerics", 1, 3)
