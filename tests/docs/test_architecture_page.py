"""The picture of the rooms shows the imports, and every name in docs/architecture.md exists."""

import importlib
import re
from pathlib import Path

from test_architecture import ROOMS, graph

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_picture_shows_the_imports():
    drawn = set(re.findall(r'id="([a-z]+)-imports-([a-z]+)"', (ROOT / "docs" / "rooms.svg").read_text()))
    modules = {
        (module.split(".")[1], target.split(".")[1]) for module, targets in graph().items() for target in targets
    }
    assert drawn == {(room, other) for room, other in modules if room != other}, "run: python tools/draw_rooms.py"


def test_table_lists_the_rooms_in_their_order():
    assert re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE) == list(ROOMS)


def test_names_on_the_page_exist():
    for name in re.findall(r"`(rpil(?:\.\w+)+)`", PAGE):
        module, _, attribute = name.rpartition(".")
        try:
            importlib.import_module(name)
        except ImportError:
            assert hasattr(importlib.import_module(module), attribute), name
    for path in re.findall(r"`((?:src|tests|tools)/[\w./]+)`", PAGE):
        assert (ROOT / path).exists(), path
    recipes = (ROOT / "tests" / "test_recipes.py").read_text()
    assert set(re.findall(r"`(test_\w+_recipe)`", PAGE)) == set(re.findall(r"^def (test_\w+)\(", recipes, re.MULTILINE))
