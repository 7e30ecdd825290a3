"""Changes the judge, what follows from its words, and the rules for faults in small ways, and counts the changes that
tests see.

Usage
-----
``python tools/mutants.py`` makes 40 random mutants of each module of `ROOMS`, runs its tests on each, and prints the
survivors, by line, and the share that was killed. ``--modules outliers,data/text`` names others, with their room where
they are not in `ROOMS`; ``--rooms numerics,scale`` takes all modules of a room that have tests of their name, as every
night does with each room; ``--tests cli/test_keep.py`` more tests of each; ``--sample N`` (0 for all),
``--seed S``, ``--jobs J``. The exit code is 1 where fewer than `GOAL` are killed.

Notes
-----
A mutant has one change: a comparison, an operator of arithmetic or logic, `min` for `max` or `any` for `all`, a number
one larger or twice as large, a negation left out, or a result that is replaced by None or turned round. Docstrings,
annotations, and defaults of settings are left as they are. Each mutant is a copy of the library in an empty folder, and
is killed where ``pytest -x`` fails on ``tests/ROOM/test_MODULE*.py`` and the file of `MORE_TESTS`, or takes longer than
`SECONDS`; slow tests are left out, but for the judge and where all are slow. They run in a fork of a process that has
imported the libraries of others, but nothing of rpil: most of the time would be spent on that. The tests must pass on
the library as it is.

Some mutants are no faults. `EQUIVALENT` holds them, and says why.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import copy
import os
import random
import shutil
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[1]
JUDGE = ("outliers", "answers", "answered", "two_parts", "trust", "groups")
ACTS = ("step_weights", "choice", "answering", "tasks", "reasons", "result")
FAULTS = ("motion", "whole_rules", "recorded", "rule", "measured_columns", "still", "tracking")
ROOMS = dict.fromkeys(JUDGE, "inference") | dict.fromkeys(ACTS, "results") | dict.fromkeys(FAULTS, "faults")
"""The modules that are changed where none is named, and their rooms."""
MORE_TESTS = (
    dict.fromkeys(JUDGE, "inference/test_trust.py")
    | dict.fromkeys(FAULTS, "faults/test_*.py")
    | {
        "step_weights": "scale/test_fit.py",
        "choice": "cli/test_keep.py",
        "tasks": "estimators/test_within_tasks.py",
    }
)
"""Tests of a module beside those of its name: patterns of files."""
GOAL = 0.9
SECONDS = 120

LIBRARIES = ("pytest", "numpy", "scipy.stats", "scipy.optimize", "sklearn.metrics", "sklearn.linear_model")
LIBRARIES += ("pyarrow.parquet", "beartype", "jaxtyping")

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

EQUIVALENT = {
    "answering: elif sign < 0:: sign < 0 -> sign <= 0": "It is 1 or -1.",
    "reasons: looks = vocabulary.upper if log_odds > 0 else vocabulary.lower: 0 -> 1": (
        "Nearer to 0 than the limit another reason is given."
    ),
    'reasons: found.append(words[above > 0.5] + steps * (name == "length")): above > 0.5 -> above >= 0.5': (
        "What hardly differs is not said."
    ),
    'reasons: sign = 1 if SIDES[verdict] == "upper" else -1: 1 -> 2': (
        "Both sides of a comparison are multiplied by it."
    ),
    "reasons: parts += [RANKS[name][2:][above > 0]] if abs(above) >= MIN_STYLE else []: above > 0 -> above >= 0": (
        "Nearer to 0 than the limit it has no style."
    ),
    'tasks: verdicts[m] = "good" if signs[m] > 0 else "bad": signs[m] > 0 -> signs[m] >= 0': "None of these is 0.",
    "reasons: looks = vocabulary.upper if log_odds > 0 else vocabulary.lower: log_odds > 0 -> log_odds >= 0": (
        "Nearer to 0 than the limit another reason is given."
    ),
    "groups: return log_likelihood, Groups(0.0, mean, spread, share, noise, np.zeros(1)): 1 -> 2": (
        "The quantiles are filled in later."
    ),
    "whole_rules: return lengths, np.where(lengths > high, high, low), severity: "
    "lengths > high -> lengths >= high": "What is as long as the limit is no fault.",
    'rule: return cause.rule != "length" or cause.value > cause.threshold: '
    "cause.value > cause.threshold -> cause.value >= cause.threshold": "What is as long as the limit is no fault.",
    "whole_rules: last = np.maximum.reduceat(np.where(moves, steps, -1), offsets[:-1]): 1 -> 2": (
        "Where nothing moves it is not read."
    ),
    "rule: spread = (high / np.maximum(low, 1e-300)) ** settings.FENCE: 1e-300 -> 2e-300": (
        "It keeps from division by 0."
    ),
    "groups: _MIN_VARIANCE = 1e-6: 1e-06 -> 2e-06": "Keeps logarithms finite; how small it is does not matter.",
    "numerics/blocks: residual = residual.astype(features.dtype, copy=False): False -> True": "It takes time alone.",
    "numerics/blocks: direction, proba, weight = (a.astype(features.dtype, copy=False) for a in "
    "(direction, proba, weight)): False -> True": "It takes time alone.",
    "numerics/blocks: weights, weight = (a.astype(features.dtype, copy=False) for a in (weights, weight)): "
    "False -> True": "It takes time alone.",
    "numerics/blocks: weights = weights.astype(features.dtype, copy=False): False -> True": "It takes time alone.",
    "numerics/parallel: THREADING_MIN_SIZE = 400_000: 400000 -> 400001": "Threads change no result.",
    "numerics/parallel: THREADING_MIN_SIZE = 400_000: 400000 -> 800000": "Threads change no result.",
    "numerics/regression: return np.where(within > ROUNDING * np.maximum(spread, np.abs(location)), within, spread): "
    "within > ROUNDING * np.maximum(spread, np.abs(location)) -> "
    "within >= ROUNDING * np.maximum(spread, np.abs(location))": "Both are hardly ever the same number.",
    "numerics/regression: penalised[np.diag_indices_from(penalised)] += "
    "np.append(np.full(len(gram) - 1, ridge * total), 1e-9 * total): 1e-09 -> 2e-09": "It keeps the inverse finite.",
}
"""Mutants that do what the library does, ``MODULE: LINE OF CODE: OLD -> NEW``, and why."""


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
            if isinstance(child, ast.keyword) and child.arg == "strict":
                continue  # of zip, which guards against a wrong use
            yield tree, name, index
            yield from places(child)


def mutants(source: str, with_source: bool = True) -> list[tuple[int, str, str, str]]:
    """Of a module, every mutant: the line, the code before and after, and the source, which takes most of the time."""
    tree, found = ast.parse(source), []
    for parent, name, index in list(places(tree)):
        before = getattr(parent, name) if index is None else getattr(parent, name)[index]
        for other in changed(before):
            put(parent, name, index, ast.copy_location(other, before))
            text = ast.unparse(ast.fix_missing_locations(tree)) if with_source else ""
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


def place_of(module: str) -> tuple[str, str]:
    """The room and the name of a module, ``ROOM/NAME`` or a name of `ROOMS`."""
    room, _, name = module.rpartition("/")
    return room or ROOMS.get(name, ""), name


def path_of(module: str, library: Path = ROOT / "src" / "rpil") -> Path:
    """The file of a module."""
    room, name = place_of(module)
    return library / room / f"{name}.py"


def tests_of(module: str, *more: str) -> list[str]:
    """What pytest is told to run for a module, and `more` files of tests."""
    tests, (room, name) = ROOT / "tests", place_of(module)
    known = room == ROOMS.get(name)  # another room may have a module of the same name
    patterns = [f"{room}/test_{name}*.py", *([MORE_TESTS[name]] if known and name in MORE_TESTS else [])]
    files = [file for pattern in patterns for file in sorted(tests.glob(pattern))]
    return [
        *map(str, dict.fromkeys([*files, *(tests / file for file in more)])),
        *["-m", "not slow"] * (not known or name not in JUDGE),
    ]


def modules_of(room: str) -> Iterator[str]:
    """The modules of a room that have tests of their name, each by the name that it has in `ROOMS`."""
    library = ROOT / "src" / "rpil"
    for path in sorted((library / room).rglob("*.py")):
        module = path.relative_to(library).with_suffix("").as_posix()
        short = path.stem if ROOMS.get(path.stem) == room else module
        if path.stem != "__init__" and any(name.endswith(".py") for name in tests_of(short)):
            yield short


def passes(module: str, source: str | None, more: Sequence[str] = ()) -> bool:
    """Whether the tests pass on the library, with another source of the module."""
    with TemporaryDirectory() as folder:
        shutil.copytree(ROOT / "src" / "rpil", Path(folder) / "rpil", ignore=shutil.ignore_patterns("__pycache__"))
        if source is not None:
            path_of(module, Path(folder) / "rpil").write_text(source)
        child = os.fork()
        if child == 0:
            run(folder, tests_of(module, *more))
        return waited(child) == 0


def run(folder: str, tests: list[str]) -> None:
    """Run the tests in this process, and end it."""
    import pytest

    code = 1
    try:
        os.setsid()
        nothing = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nothing, 1)
        os.dup2(nothing, 2)
        os.chdir(ROOT)
        sys.path.insert(0, folder)
        sys.dont_write_bytecode = True
        options = ["-x", "-q", "-p", "no:cacheprovider", "--tb=no", "--assert=plain"]
        code = int(pytest.main([*options, *tests]))
        if code == pytest.ExitCode.NO_TESTS_COLLECTED:
            code = int(pytest.main([*options, *(word for word in tests if word not in ("-m", "not slow"))]))
    finally:
        os._exit(code)


def waited(child: int) -> int:
    """The exit status of a process, which is ended where it takes too long."""
    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return status
        time.sleep(0.02)
    with contextlib.suppress(ProcessLookupError):
        os.kill(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1] or 1


def main() -> None:
    """Print the survivors of each module and the share that was killed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--modules", default=",".join(ROOMS))
    parser.add_argument("--rooms", default="")
    parser.add_argument("--tests", default="")
    parser.add_argument("--sample", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args()
    rooms = [module for room in chosen.rooms.split(",") if room for module in modules_of(room)]
    modules, more = rooms or chosen.modules.split(","), [name for name in chosen.tests.split(",") if name]
    for module in modules:
        if not path_of(module).is_file():
            sys.exit(f"{path_of(module)} is not there; write ROOM/NAME for a module.")
        if not any(name.endswith(".py") for name in tests_of(module, *more)):
            sys.exit(f"{module} has no tests of its name; name some with --tests.")
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # before numpy is imported: a fork has no other threads
    for name in LIBRARIES:
        __import__(name)
    killed = total = 0
    with ThreadPoolExecutor(chosen.jobs) as pool:
        for module in modules:
            source = path_of(module).read_text()
            if not passes(module, None, more):
                sys.exit(f"The tests of {module} fail on the library as it is.")
            every = mutants(source)
            random.Random(f"{chosen.seed} {module}").shuffle(every)
            sample = every[: chosen.sample or None]
            lives = pool.map(partial(passes, module, more=more), [text for *_, text in sample])
            code = [text.strip() for text in source.splitlines()]
            named = [(line, f"{code[line - 1]}: {old} -> {new}") for line, old, new, _ in sample]
            alive = [mutant for mutant, yes in zip(named, lives, strict=True) if yes]
            real = sorted((line, text) for line, text in alive if f"{module}: {text}" not in EQUIVALENT)
            n_equivalent = len(alive) - len(real)
            n = len(sample) - n_equivalent
            killed, total = killed + n - len(real), total + n
            print(
                f"{module}: {n - len(real)} of {n} killed; {n_equivalent} more are equivalent; {len(every)} in all",
                flush=True,
            )
            for line, text in real:
                print(f"  line {line}: {text}", flush=True)
    print(f"all: {killed} of {total} killed ({killed / max(total, 1):.0%})")
    sys.exit(killed < GOAL * total)


if __name__ == "__main__":
    main()
