"""CPU and memory of a fit as episodes become many: in memory, from disk, and on a cluster of two local processes.

    python benchmarks/episodes.py --json episodes.json
    python benchmarks/episodes.py --quick

A folder of LeRobot with 100 steps an episode and 4 joints is made for each number, and each fit is a process of its
own. CPU and memory are those of the process and of its workers together. The last row goes on along the line through
the last two. A fit that the JSON has is not measured again. The exit code is 1 where the three do not say the same
words.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import warnings
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rpil
from options import output, write_json
from provenance import line, provenance
from speed_audits import environment, lerobot_folder

EPISODES, N_STEPS, N_JOINTS = (1_000, 10_000, 100_000), 100, 4
GOAL = 10_000_000
PLACES = ("in memory", "from disk", "on a cluster")
N_WORKERS = 2


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", default=",".join(map(str, EPISODES)), metavar="NUMBERS", help="with commas")
    parser.add_argument("--json", type=output, metavar="OUT", help="where fits are kept once they are measured")
    parser.add_argument("--quick", action="store_true", help="two small folders: checks the script")
    options = parser.parse_args(arguments)
    found: dict[str, Any] = {"provenance": provenance(0), "fits": {}}
    if options.json and options.json.exists():
        found = json.loads(options.json.read_text(encoding="utf-8"))
    for number in ["20", "40"] if options.quick else options.episodes.split(","):
        fits = found["fits"].setdefault(number, {})
        if fits.keys() >= {*PLACES}:
            continue
        with tempfile.TemporaryDirectory() as temporary:
            folder = lerobot_folder(Path(temporary) / "made", int(number), N_STEPS, N_JOINTS)
            for place in PLACES:
                fits[place] = fits.get(place) or in_a_process(folder, place)
                print(f"{number} episodes {place}: {fits[place]}", file=sys.stderr, flush=True)
                if options.json:
                    write_json(options.json, found)
    print(f"{markdown(found['fits'])}\n\n{line(found['provenance'])}")
    return int(any(len({fit["words"] for fit in fits.values()}) > 1 for fits in found["fits"].values()))


def in_a_process(folder: Path, place: str) -> dict[str, Any]:
    """What `fitted` finds, in a process of its own."""
    words = [sys.executable, "-c", f"import episodes; episodes.fitted({str(folder)!r}, {place!r})"]
    run = subprocess.run(words, cwd=Path(__file__).parent, env=environment(), stdout=subprocess.PIPE, check=True)
    found: dict[str, Any] = json.loads(run.stdout.splitlines()[-1])
    return found


def fitted(folder: str, place: str) -> None:
    """Print CPU seconds and GB of a fit, and a digest of its words."""
    warnings.simplefilter("ignore")
    workers = []
    with ExitStack() as stack:
        model = rpil.RPIL()
        if place == "on a cluster":
            from distributed import Client, LocalCluster

            cluster = LocalCluster(n_workers=N_WORKERS, threads_per_worker=1, dashboard_address=":0")
            client = stack.enter_context(Client(stack.enter_context(cluster)))
            model = rpil.RPIL(engine=rpil.DaskEngine(client))
        audit = model.fit(rpil.open(folder, on_disk=place != "in memory")).audit_
        if place == "on a cluster":
            workers = list(client.run(used).values())
    seconds, gigabytes = map(sum, zip(used(), *workers, strict=True))
    words = hashlib.sha256(repr((audit.finding, audit.verdicts)).encode()).hexdigest()[:16]
    print(json.dumps({"seconds": seconds, "GB": gigabytes, "words": words}))


def used() -> tuple[float, float]:
    """CPU seconds, and gigabytes at most, of this process."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024 / 1e9


def markdown(fits: dict[str, dict[str, Any]]) -> str:
    """A row for each number, and one for `GOAL` on the line through the last two."""
    rows = [f"| episodes | {' | '.join(PLACES)} |", f"|---|{'---|' * len(PLACES)}"]
    numbers = sorted(fits, key=int)
    for number in numbers:
        cells = (f"{fits[number][place]['seconds']:,.0f} s, {fits[number][place]['GB']:.2f} GB" for place in PLACES)
        rows.append(f"| {int(number):,} | {' | '.join(cells)} |")
    if len(numbers) > 1:
        before, last = numbers[-2:]
        more = (GOAL - int(last)) / (int(last) - int(before))

        def far(place: str, what: str) -> float:
            return fits[last][place][what] + more * (fits[last][place][what] - fits[before][place][what])

        cells = (f"{far(place, 'seconds') / 3600:,.1f} h, {far(place, 'GB'):,.0f} GB" for place in PLACES)
        rows.append(f"| {GOAL:,}, by the line through the last two | {' | '.join(cells)} |")
    return "\n".join(rows)


if __name__ == "__main__":
    raise SystemExit(main())
