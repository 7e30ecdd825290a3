"""CPU and memory of `info`, `check` and `audit` as data grow, with what it takes to read them as the line below.

    python benchmarks/growth.py --json growth.json --picture docs/growth.png
    python benchmarks/growth.py --episodes 20,200 --json growth.json
    python benchmarks/growth.py --quick

Folders of LeRobot with 500 steps an episode and 14 joints are made one after the other, and each command is a process
of its own. A size that the JSON has is not measured again.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

from options import output, write_json
from provenance import line, provenance
from speed_audits import command_seconds, lerobot_folder, unavoidable

COMMANDS = ("info", "check", "audit")
EPISODES, N_STEPS, N_JOINTS = (20, 200, 2_000, 10_000, 40_000), 500, 14


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", default=",".join(map(str, EPISODES)), metavar="NUMBERS", help="with commas")
    parser.add_argument("--json", type=output, metavar="OUT", help="where sizes are kept once they are measured")
    parser.add_argument("--picture", type=output, metavar="OUT", help="also draw both curves")
    parser.add_argument("--quick", action="store_true", help="one small folder: checks the script")
    options = parser.parse_args(arguments)
    found: dict[str, Any] = {"provenance": provenance(0), "sizes": {}}
    if options.json and options.json.exists():
        found = json.loads(options.json.read_text(encoding="utf-8"))
    for number in ["6"] if options.quick else options.episodes.split(","):
        if number not in found["sizes"]:
            found["sizes"][number] = measured(int(number))
            print(f"{number} episodes: {found['sizes'][number]}", file=sys.stderr, flush=True)
            if options.json:
                write_json(options.json, found)
    if options.picture:
        draw(found, options.picture)
    print(f"{markdown(found)}\n\n{line(found['provenance'])}")
    return 0


def measured(n_episodes: int) -> dict[str, list[float]]:
    """CPU seconds and GiB of each command; of reading the seconds alone."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = lerobot_folder(Path(temporary) / "made", n_episodes, N_STEPS, N_JOINTS)
        found = {name: list(command_seconds(name, folder)) for name in COMMANDS}
        return found | {"read": [unavoidable(folder)["read"]]}


def markdown(found: dict[str, Any]) -> str:
    """A row for each size: CPU seconds and GiB of each command, and CPU seconds to read."""
    rows = ["| steps | read | info | check | audit |", "|---|---|---|---|---|"]
    for number, sizes in sorted(found["sizes"].items(), key=lambda pair: int(pair[0])):
        cells = [f"{sizes[name][0]:.2g} s, {sizes[name][1]:.2f} GiB" for name in COMMANDS]
        rows.append(f"| {int(number) * N_STEPS:,} | {sizes['read'][0]:.2g} s | {' | '.join(cells)} |")
    return "\n".join(rows)


def draw(found: dict[str, Any], path: Path) -> None:
    """CPU and memory against steps, both axes logarithmic."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    sizes = sorted(map(int, found["sizes"]))
    steps = [number * N_STEPS for number in sizes]
    figure, axes = pyplot.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for k, (ax, unit) in enumerate(zip(axes, ("CPU, seconds", "memory, GiB"), strict=True)):
        for name in (*COMMANDS, "read")[: 4 - k]:
            ax.plot(steps, [found["sizes"][str(number)][name][k] for number in sizes], "o-", label=name)
        ax.set(xscale="log", yscale="log", xlabel="steps of 28 numbers", ylabel=unit)
        ax.grid(alpha=0.3)
    axes[0].legend()
    figure.suptitle(f"commit {found['provenance']['commit']}, one core", fontsize=8)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    raise SystemExit(main())
