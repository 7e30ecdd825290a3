"""The paper's Tables 1-6 and Figures 1-7, ours beside.

    python benchmarks/paper.py --json paper.json --output paper
    python benchmarks/paper.py --quick

Every policy learns from the same 10 good and 10 bad demonstrations and plays the same starts.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from options import asked, at_least, make_folder, output, write_json
from provenance import line, provenance
from rpil.cli.terminal import show_stages
from rpil.numerics.parallel import cores
from study.experiments import ENVIRONMENTS, METHODS
from study.figures import draw
from study.tables import compared, markdown, run

QUICK = "3 draws, 20 rollouts: two minutes of one core that has nothing else to do"


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=at_least(2), default=20, help="of the data")
    parser.add_argument("--rollouts", type=at_least(2), default=100, help="episodes each policy plays")
    parser.add_argument("--seed", type=at_least(0), default=0, help="of the first draw")
    parser.add_argument("--env", choices=ENVIRONMENTS, action="append", help="may be repeated; default all")
    parser.add_argument("--quick", action="store_true", help=QUICK)
    parser.add_argument("--processes", type=at_least(1), default=cores())
    parser.add_argument("--json", type=output, help="where to write all figures")
    parser.add_argument("--output", type=Path, help="folder for tables.md and the figures")
    options = parser.parse_args(arguments)
    if options.output:
        make_folder(options.output)

    if options.quick:
        print(QUICK, file=sys.stderr)
    with show_stages(False) as show:
        found = run(
            draws=3 if options.quick else options.draws,
            rollouts=20 if options.quick else options.rollouts,
            seed=options.seed,
            environments=options.env or ENVIRONMENTS,
            methods=METHODS,
            processes=options.processes,
            progress=lambda done, total: show(f"draws of the data, {done} of {total}"),
        )
    seeds = f"{options.seed} to {max(row['seed'] for row in found['draws'])}"
    found["provenance"] = provenance(seeds, asked(parser, options))
    text = f"{markdown(found)}\n\n{compared(found)}\n\n{line(found['provenance'])}\n"
    print(text)
    if options.json:
        write_json(options.json, found)
    if options.output:
        (options.output / "tables.md").write_text(text, encoding="utf-8")
        draw(options.output, seed=options.seed)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
