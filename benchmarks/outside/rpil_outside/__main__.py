"""The command: run worlds, make the table, score what others submit.

python -m rpil_outside worlds
python -m rpil_outside run WORLD --seeds 5 --json out/
python -m rpil_outside night --seeds 3 --json out/
python -m rpil_outside table out/
python -m rpil_outside write WORLD CELL SEED FILE.npz
python -m rpil_outside score FILE.csv WORLD CELL SEED
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import rpil

from . import submitted
from .columns import COLUMNS, auroc
from .ours import Case
from .peers import ALL
from .running import drive, measured, run
from .table import in_points, line, page, read, summarised, table

if TYPE_CHECKING:
    from .world import World

BEGIN, END = "<!-- by rpil_outside table -->", "<!-- end of what rpil_outside wrote -->"
TELLING = {
    "intersection": ("drift 40", "gaussian 40", "overshoot 40"),
    "early_release": ("one length 75", "shorter 50", "shorter 75"),
    "push2d": ("accidental 50", "accidental 90", "occlusion 90", "strategy 75"),
    "metaworld": ("push operators",),
    "babyai": ("goto 75",),
    "overcooked": ("cramped_room",),
    "ocbench": ("block 0.5",),
}
"""Of each world the cells in which most was lost before, and some in which the truth gains."""


def main(arguments: list[str] | None = None, worlds: Mapping[str, World] | None = None) -> int:
    """Run the command; `worlds` takes the place of those of the package."""
    if worlds is None:
        from .worlds import WORLDS as worlds
    options = parser(worlds).parse_args(arguments)
    return options.command(options, worlds)


def parser(worlds: Mapping[str, World]) -> argparse.ArgumentParser:
    top = argparse.ArgumentParser(
        prog="python -m rpil_outside", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = top.add_subparsers(required=True, metavar="COMMAND")
    listing = commands.add_parser("worlds", help="list worlds and cells")
    listing.set_defaults(command=list_worlds)
    running = commands.add_parser("run", help="run a world; what a folder has is not run again")
    running.add_argument("world", choices=worlds)
    running.add_argument("--seeds", type=int, default=5, metavar="N", help="seeds 0 to N - 1 (default 5)")
    running.add_argument("--json", type=Path, required=True, metavar="DIR", help="one file for each cell and seed")
    running.add_argument("--cells", nargs="+", metavar="CELL", help="some cells only")
    running.add_argument("--columns", nargs="+", choices=COLUMNS, default=list(COLUMNS), metavar="COLUMN")
    running.set_defaults(command=run_world)
    night = commands.add_parser("night", help="run the telling cells of all worlds, a seed after the other")
    night.add_argument("--seeds", type=int, default=3, metavar="N", help="seeds 0 to N - 1 (default 3)")
    night.add_argument("--json", type=Path, required=True, metavar="DIR", help="one file for each cell and seed")
    night.set_defaults(command=run_night)
    making = commands.add_parser("table", help="print the table of a folder")
    making.add_argument("folder", type=Path)
    making.add_argument("--brief", action="store_true", help="without the table of each world")
    making.add_argument("--page", type=Path, help="write it into a page, between its two marks")
    making.set_defaults(command=print_table)
    writing = commands.add_parser("write", help="write the demonstrations of a draw, without the truth")
    scoring = commands.add_parser("score", help="score a file with id,score or id,step,score")
    scoring.add_argument("file", type=Path)
    for each in (writing, scoring):
        each.add_argument("world", choices=worlds)
        each.add_argument("cell")
        each.add_argument("seed", type=int)
    writing.add_argument("file", type=Path, help=".npz, .parquet or .csv")
    writing.set_defaults(command=write_draw)
    scoring.set_defaults(command=score_file)
    for each in (running, night, writing, scoring):
        each.add_argument("--quick", action="store_true", help="small draws and learners: checks the script")
    return top


def list_worlds(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    for name, world in worlds.items():
        packages = f"; lacks {', '.join(lacking(world))}" if lacking(world) else ""
        print(f"{name}: {world.source} ({world.licence}){packages}\n  {', '.join(world.cells)}")
    return 0


def lacking(world: World) -> list[str]:
    """Modules that the world needs and that are not installed, and its files that are not there."""
    missing = [name for name in getattr(world, "needs", ()) if importlib.util.find_spec(name) is None]
    return [*missing, *(str(path) for path in getattr(world, "files", ()) if not path.exists())]


def chosen(options: argparse.Namespace, worlds: Mapping[str, World]) -> World:
    world = worlds[options.world]
    if lacking(world):
        raise SystemExit(f"{world.name} needs {', '.join(lacking(world))}; the README of rpil_outside says whence.")
    return world


def run_world(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    world = chosen(options, worlds)
    cells = [checked(world, cell) for cell in options.cells or world.cells]
    run(world, cells, range(options.seeds), options.json, options.columns, options.quick)
    return 0


def run_night(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    """Run the telling cells of each world whose packages and files are here: all of a seed before the next seed."""
    here = [world for world in worlds.values() if not lacking(world)]
    for world in worlds.values():
        if lacking(world):
            print(f"{world.name} is left out: it needs {', '.join(lacking(world))}.", file=sys.stderr)
    for seed in range(options.seeds):
        for world in here:
            cells = [checked(world, cell) for cell in TELLING.get(world.name, world.cells)]
            run(world, cells, [seed], options.json, COLUMNS, options.quick)
    return 0


def print_table(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    text = page(read(options.folder), options.brief)
    if options.page is None:
        print(text, end="")
        return 0
    before, _, rest = options.page.read_text(encoding="utf-8").partition(BEGIN)
    _, end, after = rest.partition(END)
    if not end:
        raise SystemExit(f"{options.page}: it has no lines {BEGIN} and {END}; write them where the tables belong.")
    options.page.write_text(f"{before}{BEGIN}\n\n{text}\n{END}{after}", encoding="utf-8")
    return 0


def write_draw(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    world = chosen(options, worlds)
    rpil.write(options.file, world.make(checked(world, options.cell), options.seed, options.quick).demonstrations)
    return 0


def score_file(options: argparse.Namespace, worlds: Mapping[str, World]) -> int:
    """Print the row of a submitted file, below that of all."""
    world, quick = chosen(options, worlds), options.quick
    cell = checked(world, options.cell)
    case, driven = Case(world.make(cell, options.seed, quick), options.seed), dict[str, float]()
    deed = submitted.read(options.file, case.data)
    columns = {ALL: measured(ALL, case, world, cell, quick, driven)}
    policy = drive(deed, case, world, cell, quick, driven)
    columns[options.file.name] = {"auroc": auroc(deed, case), "policy": policy, "seconds": None}
    draws = [in_points({"cell": cell, "columns": columns, "whole": getattr(world, "whole", 100.0)})]
    print(table(line(name, summarised(draws, name)) for name in columns))
    return 0


def checked(world: World, cell: str) -> str:
    if cell not in world.cells:
        raise SystemExit(f"{world.name} has no cell {cell!r}; choose from {', '.join(world.cells)}.")
    return cell


if __name__ == "__main__":
    sys.exit(main())
