"""Thirteen rooms, imports one way, no circle between files, short files, no pickle: docs/architecture.md says why."""

from __future__ import annotations

import ast
import inspect
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import rpil

ROOT = Path(__file__).parents[1] / "src" / "rpil"
ROOMS = {
    "numerics": set(),
    "data": {"numerics"},
    "formats": {"numerics", "data"},
    "faults": {"numerics", "data", "formats"},
    "policies": {"numerics", "data"},
    "mixture": {"numerics", "data", "policies"},
    "inference": {"numerics", "data", "policies", "mixture"},
    "segments": {"numerics", "data", "formats", "faults", "inference"},
    "results": {"numerics", "data", "formats", "faults", "policies", "mixture", "inference", "segments"},
    "scale": {"numerics", "data", "policies", "mixture", "inference", "results"},
    "estimators": {"numerics", "data", "formats", "policies", "mixture", "inference", "results", "scale"},
    "simulation": {"numerics", "data"},
}
ROOMS["cli"] = set(ROOMS)
"""Every room, and the rooms that it may import from."""


def imported(source: str, modules: set[str], module: str, is_package: bool = False) -> set[str]:
    """The modules of rpil among `modules` that a file imports anywhere: at the top, in a function, for type checkers.

    `from rpil.data import csv` means the file `rpil.data.csv` where there is one, and else the package.
    """
    found = set()
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = module.split(".")
            above = parts[: len(parts) - node.level + is_package] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            names = {f"{base}.{name.name}" for name in node.names}
            found |= {name if name in modules else base for name in names}
    return {name for name in found if name == "rpil" or name.startswith("rpil.")} - {module}


@cache
def graph(root: Path = ROOT) -> dict[str, set[str]]:
    """The imports of every file in a room: ``rpil/__init__.py`` names everything, ``__main__.py`` is the command."""
    names = {path: ".".join(("rpil", *path.relative_to(root).with_suffix("").parts)) for path in root.rglob("*.py")}
    files = {name.removesuffix(".__init__"): path for path, name in names.items()}
    return {
        name: imported(path.read_text(), set(files), name, path.name == "__init__.py")
        for name, path in files.items()
        if name not in ("rpil", "rpil.__main__")
    }


def breaches(imports: dict[str, set[str]]) -> list[str]:
    """Imports against the order of the rooms, one sentence each, sorted."""
    found = []
    for module, targets in imports.items():
        room = module.split(".")[1]
        for target in targets:
            parts = target.split(".")
            if len(parts) == 1:
                found.append(f"{module} imports rpil itself")
            elif parts[1] != room and parts[1] not in ROOMS[room]:
                found.append(f"{module} imports {target}, and {room} comes before {parts[1]}")
    return sorted(found)


def test_the_top_holds_thirteen_rooms():
    entries = {path.name for path in ROOT.iterdir()} - {"__pycache__"}
    assert entries == {*ROOMS, "__init__.py", "__main__.py", "py.typed"}
    assert len(ROOMS) <= 13
    for room in ROOMS:
        assert ast.get_docstring(ast.parse((ROOT / room / "__init__.py").read_text())), room


def test_imports_go_one_way_and_in_no_circle_between_files():
    imports = graph()
    assert breaches(imports) == []
    order = list(TopologicalSorter(imports).static_order())  # raises CycleError, which names the files
    assert set(imports) <= set(order)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("rpil.numerics.blocks", "def f():\n    from rpil.policies.folds import deal"),
        ("rpil.data.archive", "from rpil import __version__"),
        ("rpil.data.files", "from ..cli import main"),
        ("rpil.simulation.simulate", "if TYPE_CHECKING:\n    from rpil.estimators.rpil import RPIL"),
    ],
)
def test_a_breach_is_seen(module, source):
    assert breaches({module: imported(source, set(graph()), module)})


def test_every_public_name_is_what_it_says_and_no_module():
    """A room of the same name would stand in its place once it is imported."""
    assert not {*rpil.__all__} & {*ROOMS}
    assert not [name for name in rpil.__all__ if inspect.ismodule(getattr(rpil, name))]
    assert len(inspect.signature(rpil.RPIL).parameters) <= 12


MAX_BODY, MAX_PARAMETERS, MAX_ANY = 45, 7, 100


@cache
def parsed(source: str) -> ast.Module:
    """The tree of a source, which several tests look at."""
    return ast.parse(source)


def functions(path):
    """Every function of a file: its name, the lines of its body without the docstring, and its parameters."""
    for node in ast.walk(parsed(path.read_text())):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) else node.body
            lines = body[-1].end_lineno - body[0].lineno + 1 if body else 0
            given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            names = [argument.arg for argument in given if argument.arg not in ("self", "cls")]
            yield node.name, lines, len(names) + bool(node.args.vararg) + bool(node.args.kwarg)


def test_no_two_constants_share_a_name():
    homes: dict[str, list[str]] = {}
    for path in ROOT.rglob("*.py"):
        for node in parsed(path.read_text()).body:
            targets = [node.target] if isinstance(node, ast.AnnAssign) else getattr(node, "targets", [])
            names = {name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)}
            for name in names:
                if name.strip("_").isupper() and len(name) > 1 and name != "FORMAT":  # each format ends with its own
                    homes.setdefault(name, []).append(str(path.relative_to(ROOT)))
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}


WITHOUT_TESTS = {
    "faults/settings.py": "values alone",
    "faults/measured_columns.py": "tests/faults/test_checking.py",
    "faults/rule.py": "tests/faults/test_compared.py",
    "faults/motion.py": "tests/faults/test_every_rule.py",
    "faults/whole_rules.py": "tests/faults/test_every_rule.py",
    "inference/settings.py": "values alone",
    "policies/settings.py": "tests/estimators/test_settings.py",
    "mixture/settings.py": "values alone",
    "mixture/adversaries/protocol.py": "a protocol; every adversary is tested",
    "scale/protocol.py": "a protocol; every engine is tested",
    "policies/linear.py": "a table of two lines",
    "results/judged.py": "tests/results/test_tasks_columns.py",
    "estimators/task.py": "what RPIL, RMEnt and reweight read; each of them is tested",
    "data/arrays.py": "tests/data/test_demonstrations.py",
    "formats/parquet.py": "tests/formats/test_csv.py",
    "formats/step_arrays.py": "tests/formats/test_array_layout.py",
    "formats/columns.py": "tests/formats/test_csv.py",
    "formats/format.py": "tests/formats/test_registry.py",
}
"""Files of the library that no test file is named after, and why."""


def test_tests_mirror_the_rooms():
    tests = Path(__file__).parent
    files = {path.relative_to(ROOT) for path in ROOT.rglob("*.py") if not path.name.startswith("__")}
    without = {str(file) for file in files if not (tests / file.parent / f"test_{file.name}").exists()}
    assert without == set(WITHOUT_TESTS)


def test_files_are_short_and_types_precise():
    files = [path for root in (ROOT, Path(__file__).parent) for path in root.rglob("*.py")]
    assert [path for path in files if len(path.read_text().splitlines()) > 350] == []
    assert sum(len(re.findall(r"\bAny\b", path.read_text())) for path in ROOT.rglob("*.py")) <= MAX_ANY
    assert "strict = true" in (ROOT.parents[1] / "pyproject.toml").read_text()


def calls_through_any(source: str) -> list[str]:
    """Methods called on arguments and on attributes of `self` that are declared as ``Any``.

    Objects of libraries without types have a name of their own, such as ``Estimator = Any``, and are left out.
    """
    tree = parsed(source)
    declared = [node for node in ast.walk(tree) if isinstance(node, ast.AnnAssign) and is_any(node.annotation)]
    fields = {"self." + ast.unparse(node.target).removeprefix("self.") for node in declared}
    calls = []
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)):
        given = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
        names = fields | {argument.arg for argument in given if is_any(argument.annotation)}
        called = (node.func for node in ast.walk(function) if isinstance(node, ast.Call))
        methods = (method for method in called if isinstance(method, ast.Attribute))
        calls += [ast.unparse(method) for method in methods if ast.unparse(method.value) in names]
    return calls


def is_any(annotation):
    return annotation is not None and ast.unparse(annotation) in ("Any", "Any | None")


@pytest.mark.parametrize(
    "source",
    [
        "def f(policy: Any):\n    return policy.outputs(1)",
        "class A:\n    policy_: Any\n    def f(self):\n        return self.policy_.outputs(1)",
    ],
)
def test_a_method_called_through_any_is_seen(source):
    assert len(calls_through_any(source)) == 1


PUBLIC = set(rpil.__all__)
"""What users call."""


def default_settings(source: str) -> list[str]:
    """Functions and fields below the public ones that have default settings, which a caller could forget to give.

    A record of settings may have them, and so may a field that files do not hold: nothing reads it from them.
    """
    found = []
    nodes = list(parsed(source).body)
    for node in nodes:
        if getattr(node, "name", "") in PUBLIC:
            continue
        if isinstance(node, ast.ClassDef):
            is_record = node.name.endswith(("Settings", "Options"))
            nodes += [part for part in node.body if not (is_record and isinstance(part, ast.AnnAssign))]
        defaults: list[ast.expr | None] = []
        if isinstance(node, ast.FunctionDef):
            defaults, where = [*node.args.defaults, *node.args.kw_defaults], node.name
        elif isinstance(node, ast.AnnAssign):
            defaults, where = [node.value], ast.unparse(node.target)
        texts = [ast.unparse(default) for default in defaults if default is not None]
        found += [where for text in texts if re.search("settings", text, re.I) and "NOT_STORED" not in text]
    return found


@pytest.mark.parametrize(
    "source",
    [
        "def score(data, settings=JudgeSettings()): ...",
        "class Groups:\n    def told_apart(self, *, settings: GroupSettings = GROUP_SETTINGS): ...",
        "class Policy:\n    settings: CrossFitSettings = CrossFitSettings()",
        "class Choice:\n    ridge: float = FeatureSettings.ridge_per_step",
    ],
)
def test_default_settings_are_seen(source):
    assert len(default_settings(source)) == 1


def test_every_file():
    for path in ROOT.rglob("*.py"):
        source = path.read_text()
        assert not re.search(r"^\s*(import|from) (pickle|joblib|dill|cloudpickle)\b", source, re.MULTILINE), path
        found = [*functions(path)]
        assert [name for name, lines, _ in found if lines > MAX_BODY] == [], path
        assert [name for name, _, n in found if n > MAX_PARAMETERS and name != "__init__"] == [], path
        assert calls_through_any(source) == [], path
        assert default_settings(source) == [], path
