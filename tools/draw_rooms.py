"""docs/rooms.svg: the rooms of src/rpil and which room imports from which, read from the source.

    python tools/draw_rooms.py

Rooms stand in the order of imports, the first at the bottom. A line on the right leads from a room down to a room that
it imports from; it is dark where no room between them makes the same connection. Each line carries the names of its two
rooms in the SVG, by which tests/docs/test_architecture_page.py compares the picture with the imports.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("agg")
import matplotlib.pyplot as plt
from matplotlib.patches import FancyBboxPatch, PathPatch
from matplotlib.path import Path as Curve

ROOT = Path(__file__).parents[1]
ROOMS = {
    "numerics": "sums over blocks of steps, Newton's method",
    "data": "demonstrations, action spaces, safe files",
    "formats": "files of each format, read and written",
    "faults": "recording faults",
    "policies": "pi(a|s), feature maps, their choice",
    "mixture": "the paper's model: adversaries, EM",
    "inference": "the judge: held-out scores, groups, verdicts",
    "segments": "where in a demonstration: idle rows, ranges",
    "results": "the result, figures, HTML report",
    "scale": "passes in memory, from disk, on a cluster",
    "estimators": "RPIL, BehavioralCloning, RMEnt, reweight",
    "simulation": "data with a known truth",
    "cli": "the command rpil",
}
"""Room -> what it holds, in the order of imports; `simulation` stands beside the others."""

DARK, PALE = "#1f6f8b", "#c8d3d9"


def imports(source: Path) -> dict[str, set[str]]:
    """The rooms that each room imports from, anywhere in its files."""
    found: dict[str, set[str]] = {room: set() for room in ROOMS}
    for room in ROOMS:
        for path in (source / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [name.name for name in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom) and node.module:
                    names = [f"{node.module}.{name.name}" for name in node.names]
                found[room] |= {name.split(".")[1] for name in names if name.startswith("rpil.")}
        found[room].discard(room)
    return found


def needed(edges: dict[str, set[str]], room: str, other: str) -> bool:
    """Whether no chain of other imports leads from `room` to `other`."""

    def reaches(start: str) -> bool:
        return start == other or any(reaches(step) for step in edges[start])

    return not any(reaches(step) for step in edges[room] - {other})


def draw(edges: dict[str, set[str]]) -> Any:
    """Boxes from bottom to top, and a curve for each import."""
    place = {room: k for k, room in enumerate(ROOMS)}
    figure, ax = plt.subplots(figsize=(7.2, 6.4), layout="constrained")
    for room, what in ROOMS.items():
        box = FancyBboxPatch((0, place[room] - 0.32), 5.6, 0.64, boxstyle="round,pad=0.04", fc="#f4f7f8", ec=DARK)
        box.set_gid(room)
        ax.add_patch(box)
        ax.text(0.15, place[room], room, weight="bold", va="center", fontsize=10)
        ax.text(1.65, place[room], what, va="center", fontsize=8.5)
    pairs = [(room, other) for room, others in edges.items() for other in sorted(others)]
    for room, other in sorted(pairs, key=lambda pair: needed(edges, *pair)):  # the dark lines on top
        direct = needed(edges, room, other)
        # Lines leave a box in its upper half and reach one in its lower half.
        start, end = place[room] - 0.12, place[other] + 0.12
        reach = 5.7 + 0.42 * abs(start - end) ** 0.9
        curve = Curve([(5.66, start), (reach, start), (reach, end), (5.72, end)], [1, 4, 4, 4])
        line = PathPatch(curve, fc="none", ec=DARK if direct else PALE, lw=1.6 if direct else 0.9)
        line.set_gid(f"{room}-imports-{other}")
        ax.add_patch(line)
        ax.plot(5.72, end, "<", color=DARK if direct else PALE, markersize=5 if direct else 4)
    ax.set(xlim=(-0.1, 9.4), ylim=(-0.6, len(ROOMS) - 0.4))
    ax.axis("off")
    return figure


def main() -> None:
    plt.rcParams |= {"svg.hashsalt": "rooms", "svg.fonttype": "none", "font.family": "sans-serif"}
    figure = draw(imports(ROOT / "src" / "rpil"))
    path = ROOT / "docs" / "rooms.svg"
    figure.savefig(path, metadata={"Date": None, "Creator": None})
    print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
