"""The mutants of `tools/mutants.py`."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

TOOL = runpy.run_path(str(Path(__file__).parents[1] / "tools" / "mutants.py"))


def changes(source):
    return {(old, new) for _, old, new, _ in TOOL["mutants"](source, False)}


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
        ("x = zip(a, b, strict=True)", set()),
        ("x = np.min(a)", {("np.min", "np.max")}),
        ("def f():\n    'text'\n    return a", {("return a", "return None")}),
        ("def f(x: A[2]) -> B[3]:\n    return x == y", {
            ("return x == y", "return None"), ("return x == y", "return not x == y"), ("x == y", "x != y")}),
    ],
)  # fmt: skip
def test_mutants_of(source, expected):
    assert changes(source) == expected


def test_equivalent_mutants_exist_and_are_explained():
    every = set()
    for module in {name.partition(": ")[0] for name in TOOL["EQUIVALENT"]}:
        source = TOOL["path_of"](module).read_text()
        code = source.splitlines()
        every |= {f"{module}: {code[line - 1].strip()}: {a} -> {b}" for line, a, b, _ in TOOL["mutants"](source, False)}
    assert {*TOOL["EQUIVALENT"]} <= every
    assert all(why.endswith(".") for why in TOOL["EQUIVALENT"].values())


def test_each_module_has_its_own_tests_and_those_beside():
    tests, named = TOOL["ROOT"] / "tests", {}
    for module in TOOL["ROOMS"]:
        assert TOOL["path_of"](module).is_file()
        files = [name for name in TOOL["tests_of"](module) if name.endswith(".py")]
        named[module] = [Path(name).relative_to(tests).as_posix() for name in files]
        assert all(map(Path.is_file, map(Path, files)))
    assert named["choice"] == ["results/test_choice.py", "cli/test_keep.py"]
    assert named["trust"] == ["inference/test_trust.py"]
    assert {"inference/test_outliers.py", "inference/test_trust.py"} <= {*named["outliers"]}
    assert TOOL["tests_of"]("answering")[-2:] == ["-m", "not slow"]


def test_every_night_takes_every_room_and_a_room_takes_its_modules():
    root = TOOL["ROOT"]
    text = (root / ".github" / "workflows" / "nightly.yml").read_text()
    listed = text.partition("room: [")[2].partition("]")[0].split(", ")
    assert sorted(listed) == sorted(path.parent.name for path in (root / "src" / "rpil").glob("*/__init__.py"))
    assert {"numerics/blocks", "numerics/newton"} <= {*TOOL["modules_of"]("numerics")}
    assert {*TOOL["JUDGE"], "inference/findings"} <= {*TOOL["modules_of"]("inference")}


@pytest.mark.parametrize(
    ("module", "remedy"), [("results/nothing", "write ROOM/NAME"), ("results/judged", "name some with --tests")]
)
def test_a_module_without_a_file_or_tests_is_refused(module, remedy, monkeypatch):
    """Without files pytest would run every test of the library on each mutant."""
    monkeypatch.setattr(sys, "argv", ["mutants.py", "--modules", module])
    with pytest.raises(SystemExit, match=remedy):
        TOOL["main"]()
