"""Changes the library in small ways, and counts the changes that tests see.

Usage
-----
``python tools/mutants.py`` makes 40 random mutants of each room, runs tests on each, and prints the survivors, by
line, and the share that was killed. ``--rooms numerics,scale`` names rooms, ``--modules results/choice,data/text``
modules, ``--sample N`` (0 for all) the number for each of them; ``--seed S``, ``--jobs J``. ``--calls FILE`` keeps
which test calls which function, for the next run. The exit code is 1 where fewer than `GOAL` are killed.

Notes
-----
A mutant has one change: a comparison, an operator of arithmetic or logic, `min` for `max` or `any` for `all`, a number
one larger or twice as large, a negation left out, or a result that is replaced by None or turned round. Docstrings,
annotations, and defaults of settings are left as they are. Each mutant is a copy of the library in an empty folder.

First all tests run once, and each function that a test or its fixtures call is noted. A mutant meets the tests that
call its function, or one that reads the constant that it changes, and those of its room that start processes: the
quick ones and those of its room first, 60 seconds of tests (``--seconds``). It is killed where one fails, or where they
take several times as long as before. At the end the tests that killed must pass on the library as it is. They run in a
fork of a process that has imported the libraries of others, but nothing of rpil: most of the time would be spent on
that.

`survivors.toml` beside this file lists survivors that are no holes, and says why: they are not counted.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import json
import os
import random
import resource
import shutil
import signal
import sys
import threading
import time
import tomllib
from collections import defaultdict
from collections.abc import Container, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
LIBRARY = ROOT / "src" / "rpil"
ROOMS = sorted(path.parent.name for path in LIBRARY.glob("*/__init__.py"))
SURVIVORS = Path(__file__).with_name("survivors.toml")
"""Of each module, survivors that are no holes, ``"LINE OF CODE: OLD -> NEW" = "why"``."""

GOAL = 0.9
UNCALLED = ("benchmarks", "docs", "test_architecture.py", "test_budget.py", "test_mutants.py", "test_other_systems.py")
UNCALLED += ("test_packaging.py", "test_release.py", "test_surface.py", "test_words.py", "test_action.py")
"""Tests of something else than what the library does."""

PROCESS = "a process"
"""What tests call that start one, which is not traced."""

LIBRARIES = ("pytest", "numpy", "scipy.stats", "scipy.optimize", "sklearn.metrics", "sklearn.linear_model")
LIBRARIES += ("pyarrow.parquet", "beartype", "jaxtyping", "hypothesis", "jinja2", "click", "rich.console", "h5py")

COMPARISONS = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.MatMult: ast.Add,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
NAMES = {"min": "max", "minimum": "maximum", "all": "any", "argmin": "argmax", "logaddexp": "maximum"}
NAMES |= {other: name for name, other in NAMES.items() if name != "logaddexp"}


def changed(node: ast.AST) -> Iterator[ast.AST]:
    """Other nodes in the place of a node."""
    match node:
        case ast.Compare(left, [operator], right):
            for other in COMPARISONS[type(operator)]:
                yield ast.Compare(left, [other()], right)
        case ast.Compare(left, [first, *rest], right):  # a < x < b
            for other in COMPARISONS[type(first)]:
                yield ast.Compare(left, [other(), *rest], right)
            for other in COMPARISONS[type(rest[0])]:
                yield ast.Compare(left, [first, other(), *rest[1:]], right)
        case ast.BinOp(left, operator, right) if type(operator) in OPERATORS:
            yield ast.BinOp(left, OPERATORS[type(operator)](), right)
        case ast.AugAssign(target, operator, value) if type(operator) in OPERATORS:
            yield ast.AugAssign(target, OPERATORS[type(operator)](), value)
        case ast.BoolOp(operator, values):
            yield ast.BoolOp(OPERATORS[type(operator)](), values)
        case ast.UnaryOp(ast.Not() | ast.Invert() | ast.USub(), operand):
            yield operand
        case ast.Constant(bool() as value):
            yield ast.Constant(not value)
        case ast.Constant(int() | float() as value):
            yield ast.Constant(value + 1)
            if value not in (0, 1):
                yield ast.Constant(2 * value)
        case ast.Name(name) if name in NAMES:
            yield ast.Name(NAMES[name], node.ctx)
        case ast.Attribute(value, name) if name in NAMES:
            yield ast.Attribute(value, NAMES[name], node.ctx)
        case ast.IfExp(test, body, orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Return(value) if value is not None and not isinstance(value, ast.Constant):
            if isinstance(value, ast.Compare | ast.BoolOp):
                yield ast.Return(ast.UnaryOp(ast.Not(), value))
            yield ast.Return(ast.Constant(None))
        case ast.If(test, body, orelse):
            yield ast.If(ast.UnaryOp(ast.Not(), test), body, orelse)
        case ast.Break():
            yield ast.Pass()
        case ast.Continue():
            yield ast.Pass()


def places(tree: ast.AST) -> Iterator[tuple[ast.AST, str, int | None]]:
    """Each node of code that may be changed, by its parent, the field and the index there."""
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns", "decorator_list", "slice") and not isinstance(tree, ast.Subscript):
            continue
        for index, child in enumerate(value) if isinstance(value, list) else [(None, value)]:
            if not isinstance(child, ast.AST) or isinstance(child, ast.Assert):
                continue
            if isinstance(child, ast.AnnAssign) and isinstance(tree, ast.ClassDef):
                continue  # a field
            if isinstance(child, ast.Expr) and isinstance(child.value, ast.Constant):
                continue  # a docstring
            if isinstance(child, ast.If) and getattr(child.test, "id", "") == "TYPE_CHECKING":
                continue
            if isinstance(child, ast.keyword) and child.arg in ("strict", "copy", "stacklevel"):
                continue  # guards against a wrong use, saves time, or points a warning to a line
            yield tree, name, index
            yield from places(child)


def mutants(source: str, wanted: Container[int] = ()) -> list[tuple[int, str, str, str]]:
    """Every mutant of a module: the line, the code before and after, and the source of those `wanted`, which takes
    most of the time.
    """
    tree, found = ast.parse(source), []
    for parent, name, index in list(places(tree)):
        before = getattr(parent, name) if index is None else getattr(parent, name)[index]
        for other in changed(before):
            put(parent, name, index, ast.copy_location(other, before))
            text = ast.unparse(ast.fix_missing_locations(tree)) if len(found) in wanted else ""
            put(parent, name, index, before)
            found.append((before.lineno, short(before), short(other), text))
    return found


def put(parent: ast.AST, name: str, index: int | None, node: ast.AST) -> None:
    """Put a node in its place."""
    if index is None:
        setattr(parent, name, node)
    else:
        getattr(parent, name)[index] = node


def short(node: ast.AST) -> str:
    """The first line of code."""
    return ast.unparse(ast.fix_missing_locations(copy.deepcopy(node))).splitlines()[0]


def path_of(module: str, library: Path = LIBRARY) -> Path:
    """The file of a module, ``ROOM/NAME``."""
    return library / f"{module}.py"


def modules_of(room: str) -> list[str]:
    """The modules of a room."""
    return [path.relative_to(LIBRARY).with_suffix("").as_posix() for path in sorted((LIBRARY / room).rglob("*.py"))]


def drawn(name: str, seed: int, sample: int) -> list[tuple[str, int, str, str]]:
    """Random mutants of a room or a module: the module, the line, the line's code with the change, and the source."""
    modules = modules_of(name) if name in ROOMS else [name]
    sources = {module: path_of(module).read_text() for module in modules}
    every = [(module, k) for module, source in sources.items() for k in range(len(mutants(source)))]
    random.Random(f"{seed} {name}").shuffle(every)
    wanted = defaultdict(set)
    for module, k in every[: sample or None]:
        wanted[module].add(k)
    found = []
    for module, numbers in sorted(wanted.items()):
        code, made = [text.strip() for text in sources[module].splitlines()], mutants(sources[module], numbers)
        for k in sorted(numbers):
            line, old, new, text = made[k]
            found.append((module, line, f"{code[line - 1]}: {old} -> {new}", text))
    return found


def functions(source: str) -> list[tuple[int, int, set[str]]]:
    """The functions of a module, inner ones after those around them: first line, last line, and names in them."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            names = {getattr(part, "id", getattr(part, "attr", "")) for part in ast.walk(node)}
            found.append((min([node.lineno, *(part.lineno for part in node.decorator_list)]), node.end_lineno, names))
    return sorted(found, key=lambda function: (function[0], -function[1]))


@cache
def library() -> dict[str, list[tuple[int, int, set[str]]]]:
    """The functions of each module."""
    paths = sorted(LIBRARY.rglob("*.py"))
    return {path.relative_to(LIBRARY).with_suffix("").as_posix(): functions(path.read_text()) for path in paths}


def around(module: str, line: int) -> int:
    """The first line of the innermost function around a line; 0 where there is none."""
    return max((first for first, last, _ in library().get(module, ()) if first <= line <= last), default=0)


def callers(module: str, line: int, calls: dict[str, Any], most: float) -> list[str]:
    """The tests that may see a change of a line, those first that are quick or of its room, `most` seconds in all."""
    first = around(module, line)
    places = {f"{module}:{first}"}
    if not first:  # a constant: the functions that read it
        statements = ast.parse(path_of(module).read_text()).body
        names = {
            part.id
            for node in statements
            if node.lineno <= line <= node.end_lineno
            for part in ast.walk(node)
            if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
        }
        places = {f"{m}:{start}" for m, own in library().items() for start, _, read in own if names & read}
    room, name = module.split("/")[0], module.split("/")[-1]
    costs = {}
    for test, (seconds, called) in calls.items():
        is_named, is_near = (
            test.startswith(f"tests/{at}") for at in (f"{Path(module).parent}/test_{name}", f"{room}/")
        )
        if is_named or not places.isdisjoint(called) or (is_near and PROCESS in called):
            costs[test] = (seconds + 0.01) * (1 if is_named else 2 if is_near else 5)
    tests, total = [], 0.0
    for test in sorted(costs, key=costs.get):
        total += calls[test][0]
        if tests and total > most:
            break
        tests.append(test)
    return tests


class Chosen:
    """A plugin of pytest: only these tests run, in this order, and the first that fails is written to a file."""

    def __init__(self, tests: Sequence[str], failed: Path):
        self.order, self.failed = {test: k for k, test in enumerate(tests)}, failed

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items[:] = sorted((item for item in items if item.nodeid in self.order), key=lambda i: self.order[i.nodeid])

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            with self.failed.open("a") as file:
                file.write(f"{report.nodeid}\n")


class Calls:
    """A plugin of pytest that notes the functions of the library that each test, or a fixture of it, calls."""

    def __init__(self, folder: str, file: Path):
        self.folder, self.file, self.tests, self.failed = f"{folder}/rpil/", file, {}, set()
        self.current, self.of_fixtures, self.places = {}, defaultdict(dict), {}
        sys.addaudithook(self.start)

    def note(self, frame: FrameType, *_: Any) -> None:
        self.current[id(frame.f_code)] = frame.f_code

    def start(self, event: str, _: Any) -> None:
        if event == "subprocess.Popen":
            self.current[0] = PROCESS

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[None]:
        before, self.current = self.current, self.of_fixtures[id(fixturedef)]
        try:
            return (yield)
        finally:
            self.current = before | self.current

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Iterator[None]:
        self.current, start = {}, sum(os.times()[:4])
        threading.settrace(self.note)
        sys.settrace(self.note)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            for name in item.fixturenames:
                for fixture in item._fixtureinfo.name2fixturedefs.get(name, ()):
                    self.current |= self.of_fixtures[id(fixture)]
            called = sorted({self.place(code) for code in list(self.current.values())} - {""})
            self.tests[item.nodeid] = (round(sum(os.times()[:4]) - start, 3), called)

    def place(self, code: Any) -> str:
        """The module and the line of a function of the library."""
        if code is PROCESS:
            return PROCESS
        if id(code) not in self.places:
            module = code.co_filename.removeprefix(self.folder).removesuffix(".py")
            is_own = code.co_filename.startswith(self.folder)
            self.places[id(code)] = f"{module}:{around(module, code.co_firstlineno)}" if is_own else ""
        return self.places[id(code)]

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed or report.skipped:
            self.failed.add(report.nodeid)

    def pytest_sessionfinish(self) -> None:
        found = {test: at for test, at in self.tests.items() if test not in self.failed}
        self.file.write_text(json.dumps({"calls": found, "failed": sorted(self.failed)}))


def code_of(folder: str, words: list[str], plugin: Any, seconds: float) -> int:
    """The exit status of pytest on a copy of the library, in a fork that is ended where it takes too long."""
    child = os.fork()
    if child:
        return waited(child, 10 * seconds + 60)
    code = 1
    try:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (int(3 * seconds + 20),) * 2)
        nothing = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(nothing, stream)
        os.chdir(ROOT)
        sys.path[:0] = [folder, str(ROOT)]
        os.environ["PYTHONPATH"] = folder  # of the processes that tests start
        sys.dont_write_bytecode = True
        code = int(pytest.main(["-q", "-p", "no:cacheprovider", "--tb=no", "--assert=plain", *words], [plugin]))
    finally:
        os._exit(code)


def waited(child: int, seconds: float) -> int:
    """The exit status of a process, which is ended where it takes too long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1] or 1


@contextlib.contextmanager
def copied(module: str = "", source: str = "") -> Iterator[str]:
    """A folder with a copy of the library, where a module has another source."""
    with TemporaryDirectory() as folder:
        shutil.copytree(LIBRARY, Path(folder) / "rpil", ignore=shutil.ignore_patterns("__pycache__"))
        if module:
            path_of(module, Path(folder) / "rpil").write_text(source)
        yield folder


def traced() -> dict[str, Any]:
    """Of each test that passes, its seconds and the functions that it calls."""
    with copied() as folder:
        file = Path(folder) / "calls.json"
        code_of(folder, [f"--ignore=tests/{name}" for name in UNCALLED], Calls(folder, file), 3600)
        found = json.loads(file.read_text())
    for test in found["failed"]:
        print(f"left out, as it fails or needs what is not here: {test}")
    return found["calls"]


def killer(mutant: tuple[str, int, str, str], calls: dict[str, Any], most: float) -> str:
    """The first test that fails on a mutant, "time" where they take too long; nothing where all pass."""
    module, line, _, source = mutant
    tests = callers(module, line, calls, most)
    if not tests:
        return ""
    with copied(module, source) as folder:
        failed = Path(folder) / "failed"
        files = sorted({test.partition("::")[0] for test in tests})
        code = code_of(folder, ["-x", *files], Chosen(tests, failed), sum(calls[test][0] for test in tests))
        if code == 0:
            return ""
        return failed.read_text().splitlines()[0] if failed.exists() else "time" if code < 256 else "import"


def passing(tests: list[str]) -> bool:
    """Whether tests pass on the library as it is; those that do not are printed."""
    with copied() as folder:
        failed = Path(folder) / "failed"
        files = sorted({test.partition("::")[0] for test in tests})
        code_of(folder, files, Chosen(tests, failed), 3600)
        if failed.exists():
            print(f"These tests killed, but fail on the library as it is:\n{failed.read_text()}")
        return not failed.exists()


def main() -> None:
    """Print the survivors of each room and the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rooms", default=",".join(ROOMS))
    parser.add_argument("--modules", default="")
    parser.add_argument("--sample", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--calls", type=Path)
    chosen = parser.parse_args()
    names = (chosen.modules or chosen.rooms).split(",")
    for name in names:
        if name not in ROOMS and not path_of(name).is_file():
            sys.exit(f"{path_of(name)} is not there; write ROOM/NAME for a module.")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported: a fork has no other threads
    for name in LIBRARIES:
        with contextlib.suppress(ImportError):
            __import__(name)
    if chosen.calls and chosen.calls.exists():
        calls = json.loads(chosen.calls.read_text())
    else:
        calls = traced()
        if chosen.calls:
            chosen.calls.write_text(json.dumps(calls))
    explained = tomllib.loads(SURVIVORS.read_text(encoding="utf-8"))
    killed = total = 0
    killers = set()
    with ThreadPoolExecutor(chosen.jobs) as pool:
        for name in names:
            every = drawn(name, chosen.seed, chosen.sample)
            sample = [mutant for mutant in every if mutant[2] not in explained.get(mutant[0], {})]
            n = 0
            for (module, line, text, _), test in zip(
                sample, pool.map(lambda one: killer(one, calls, chosen.seconds), sample), strict=True
            ):
                n += bool(test)
                killers.add(test)
                print(f"  {module}:{line}: {text} [{test or 'survives'}]", flush=True)
            print(f"{name}: {n} of {len(sample)} killed; {len(every) - len(sample)} more are explained", flush=True)
            killed, total = killed + n, total + len(sample)
    print(f"all: {killed} of {total} killed ({killed / max(total, 1):.0%})")
    sys.exit(not passing(sorted(killers - {"", "time", "import"})) or killed < GOAL * total)


if __name__ == "__main__":
    main()
