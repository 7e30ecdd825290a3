"""What `rpil check` finds of faults that a growing share of a set has, up to all, and what it says of clean sets.

    python benchmarks/whole_set.py --quick
    python benchmarks/whole_set.py --cases ../shared/data/cases --data ../shared/data --docs docs/faults.md

Each kind of fault is planted into sets of several worlds, see `whole_worlds`; half of the worlds and kinds were looked
at while the thresholds were chosen, and the other half is held out.
"""

from __future__ import annotations

import argparse
import re
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.faults.checking import check
from rpil.faults.report import FaultReport
from tables import table
from whole_worlds import ANYWHERE, KINDS, WORLDS, Episodes, commands, half

SHARES = 0.05, 0.15, 0.3, 0.5, 0.75, 1.0
CASES = {
    "c01": r"file-002.*0-19",
    "c02": r"8.*9.*(missing|not there)|missing.*8.*9",
    "c03": r"constant|range is 0",
    "c04": r"(order|exchang).*15",
    "c05": r"wrap",
    "c07": r"state of the same step",
    "c09": r"7",
    "c12": r"(nothing moves|idle).*30|30 of 30",
    "c13": r"300.*339|empty",
    "c15": r"pour.*goes to 2",
    "c16": r"not recorded",
    "c26": r"18 on.*90",
    "c30": r"20 demonstrations",
}
"""What a right answer says, of each given input; the two controls are silent."""


def reported(episodes: Episodes) -> FaultReport:
    return check(Demonstrations.from_episodes(episodes))


def named(report: FaultReport) -> set[object]:
    """The demonstrations that a finding names, alone or in a line about the set."""
    return {name for found in report.findings for name in (found.id, *found.ids)} - {""}


def hit(report: FaultReport, at: Sequence[int], n: int) -> tuple[bool, int]:
    """Whether nine of ten of the demonstrations `at` are named, and how many others are; a line about two groups names
    the smaller one and says how many the larger has, and accuses nobody."""
    found = {m for one in report.findings for m in ((one.id,) if one.id != "" else one.ids)}
    accused = {one.id for one in report.findings if one.id != ""} - {*at}
    right = len(found & {*at}) >= 0.9 * len(at)
    for one in report.findings:  # two groups: which is right cannot be known
        others = {*range(n)} - {*one.ids}
        right |= one.id == "" and one.ids != () and len(others & {*at}) >= 0.9 * len(at) > 0.8 * len(others)
    return right, len(accused)


def shares(n: int, kinds: Sequence[str], worlds: Sequence[str], of_shares: Sequence[float]) -> list[list[str]]:
    lines = []
    for world in worlds:
        clean = WORLDS[world](np.random.default_rng(1), n)
        for kind in kinds:
            cells = []
            for share in of_shares:
                at = sorted(np.random.default_rng(7).permutation(n)[: round(share * n)].tolist())
                made = [(s.copy(), a.copy()) for s, a in clean]
                for m in at:
                    rng = np.random.default_rng([8, m])
                    changed = KINDS[kind](*made[m], rng) if kind in ANYWHERE or commands(*made[m]) else None
                    if changed is None:
                        break
                    made[m] = changed
                else:
                    right, accused = hit(reported(made), at, n)
                    cells.append(("found" if right else "MISSED") + f" + {accused}" * bool(accused))
            if cells:
                lines.append([world, half(world), kind, *cells])
                print(*lines[-1], sep=" | ", flush=True)
    return lines


def clean(worlds: Sequence[str], seeds: int, n: int) -> list[list[str]]:
    lines = []
    for world in worlds:
        counts, total, sentences = Counter[str](), 0, []
        for seed in range(seeds):
            made = WORLDS[world](np.random.default_rng([3, seed]), n)
            report = reported(made)
            total += len(made)
            counts.update(found.rule for found in report.findings)
            sentences += [f"{found.id}: {found.rule}: {found.sentence}" for found in report.findings]
        lines.append([world, half(world), str(total), ", ".join(f"{k} {r}" for r, k in counts.items()) or "0"])
        print(*lines[-1], *(f"\n      {one}"[:190] for one in sentences[:4]), sep=" | ", flush=True)
    return lines


def cases(folder: Path) -> Iterator[list[str]]:
    for path in sorted(folder.glob("c*")):
        name = path.name[:3]
        try:
            columns = {"action": ["steer", "throttle"]} if name == "c31" else {}
            report = check(path, **columns)
            said = [f"{one.id}: {one.rule}: {one.sentence}" for one in report.lines]
            text = "\n".join([report.headline, *said])
        except DataError as error:
            said, text = [str(error)], error.in_shell
        want = CASES.get(name)
        right = not said if want is None else bool(re.search(want, text, re.S))
        yield [path.name, "right" if right else "WRONG", *[s[:230] for s in said[:3]]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=Path, help="folder of the given inputs")
    parser.add_argument("--quick", action="store_true", help="three shares, of the worlds looked at")
    parser.add_argument("--worlds", nargs="*", default=list(WORLDS))
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--size", type=int, default=40)
    parser.add_argument("--seeds", type=int, default=4, help="clean sets of each world")
    parser.add_argument("--only", choices=("clean", "shares", "cases"))
    options = parser.parse_args()
    start = time.perf_counter()
    if options.cases and options.only in (None, "cases"):
        for line in cases(options.cases):
            print(*line, sep="\n    ")
    if options.only in (None, "clean"):
        clean(options.worlds, 1 if options.quick else options.seeds, options.size)
    if options.only in (None, "shares"):
        lines = shares(options.size, options.kinds, options.worlds, (0.1, 0.5, 1.0) if options.quick else SHARES)
        score: dict[tuple[str, str], list[bool]] = defaultdict(list)
        for _, own, kind, *cells in lines:
            score[own, kind] += [cell.startswith("found") for cell in cells]
            score[own, "clean demonstrations accused"] += ["+" in cell for cell in cells]
        print(table(["half", "kind", "found", "of"], [[*k, str(sum(v)), str(len(v))] for k, v in score.items()], 2))
    print(f"{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
