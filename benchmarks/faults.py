"""How many planted recording faults the rules of `rpil check` find, and how many clean demonstrations they accuse.

Each kind of fault is planted in three sizes into a tenth of the demonstrations of clean sets: the good demonstrations
of simulations, and of recordings in a folder (--data DIR). Thresholds were chosen on the sets called "chosen"; those
called "seen" were looked at while the rules were written, and those called "unseen" only afterwards.

    python benchmarks/faults.py --data DIR
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from fault_kinds import KINDS, Clean, Planted, copies, plant
from provenance import line, provenance
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.faults.check import find_faults
from rpil.faults.record import FaultReport
from rpil.formats.on_disk import open_dataset
from rpil.simulation.simulate import simulate
from worlds.recorded import npz_files, read

SIMULATIONS = {
    "chosen": ("Pendulum-v1", "MountainCarContinuous-v0"),
    "seen": ("LunarLanderContinuous-v3", "Acrobot-v1"),
    "unseen": ("CartPole-v1",),
}
RECORDINGS = {
    "chosen": ("metaworld_reach", "metaworld_push", "metaworld_drawer_open", "vild_walker2d", "human_mountaincar"),
    "seen": (
        *("metaworld_door_open", "metaworld_pick_place", "metaworld_window_open", "rilco_hopper_mix"),
        *("vild_halfcheetah", "vild_lunarlander", "pidail_lunarlander"),
    ),
    "unseen": ("rilco_ant_mix", "rilco_halfcheetah_mix"),
}
SHARE, SEED = 0.1, 0  # so many of the demonstrations have the fault


def clean_sets(
    folder: Path | None, files: list[Path], n_simulated: int, quick: bool
) -> Iterator[tuple[str, str, Clean]]:
    """Group, name and demonstrations of each clean set."""
    for group, names in SIMULATIONS.items():
        for name in names[:1] if quick else names:
            made = simulate(name, "random", n_good=n_simulated, n_bad=0, seed=SEED)
            yield group, name, Clean(Demonstrations.from_episodes(made.episodes, source=name))
    for group, stems in RECORDINGS.items() if folder is not None else ():
        for path in npz_files(folder, list(stems)):
            yield group, path.stem, Clean(read(path).good_half().demonstrations)
    for path in files:
        yield "seen", path.name, Clean(formats.read(path))


def score(report: FaultReport, planted: Planted, rule: str, alike: tuple[str, ...]) -> dict[str, int]:
    """Counts of faults and of those that were found; of demonstrations without, and of those that the rule accused."""
    named = {r: {f.id for f in report.findings if f.rule == r} for r in (rule, *alike)}
    ids, faulty = planted.demonstrations.ids, planted.has_fault
    own, any_alike = (np.isin(ids, list(found)) for found in (named[rule], set().union(*named.values())))
    n_faults = int(faulty.sum()) // (2 if rule == "duplicate" else 1)  # of each pair of copies one is named, either
    found = min(int((any_alike & faulty).sum()), n_faults)
    return {"faults": n_faults, "found": found, "clean": int((~faulty).sum()), "accused": int((own & ~faulty).sum())}


def run(
    folder: Path | None, files: list[Path], seeds: int, n_simulated: int, quick: bool = False, only: Any = ()
) -> list[dict[str, Any]]:
    """One row for each set, kind, size and seed."""
    rows = []
    for group, name, clean in clean_sets(folder, files, n_simulated, quick):
        start, found = time.perf_counter(), clean.report
        rows.append({"group": group, "set": name, "kind": "clean", "size": 0, "checked": False, "known": None})
        rows[-1] |= {"clean": len(clean.episodes), "accused": len(found.findings)}
        for seed in range(seeds):
            for kind, k in ((kind, k) for kind, k in KINDS.items() if kind in only or not only):
                for size in k.sizes:
                    planted = plant(clean, kind, size, SHARE, np.random.default_rng([seed, int(10 * size)]))
                    if planted is not None:
                        report = find_faults(planted.demonstrations, planted.times)
                        row = {"group": group, "set": name, "kind": kind, "size": size, "seed": seed}
                        row |= {"checked": k.rule not in report.not_checked, "known": clean.known(k.rule)}
                        rows.append(row | score(report, planted, k.rule, k.alike))
            for noise in () if only else (0.0, 0.001, 0.01):
                planted = copies(clean, noise, SHARE, np.random.default_rng([seed, 7]))
                report = find_faults(planted.demonstrations)
                row = {"group": group, "set": name, "kind": "duplicate", "size": noise, "seed": seed}
                rows.append(row | {"checked": True, "known": 1.0} | score(report, planted, "duplicate", ()))
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    return rows


def summarise(rows: list[dict[str, Any]]) -> dict[tuple[str, float, str], dict[str, int]]:
    """Sums over sets and seeds by kind, size and group, of the rows whose rule could be checked."""
    sums: dict[tuple[str, float, str], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for row in rows:
        if row["checked"]:
            for count in ("faults", "found", "clean", "accused"):
                sums[row["kind"], row["size"], row["group"]][count] += row[count]
    return sums


def coverage(rows: list[dict[str, Any]], kind: str) -> str:
    """Mean over the sets of the share that a rule knows about."""
    shares = {row["set"]: row["known"] for row in rows if row["kind"] == kind and row["known"] is not None}
    return f"{100 * np.mean(list(shares.values())):.0f} %" if shares else ""


def render(rows: list[dict[str, Any]]) -> str:
    """The table of docs/faults.md."""
    sums = summarise(rows)
    units = {name: kind.unit for name, kind in KINDS.items()} | {"duplicate": "standard deviations of noise"}
    lines = [
        f"| fault | size | {' | '.join(f'recall, {group} | false alarms' for group in SIMULATIONS)} | known |",
        f"|---|---|{'---|' * (2 * len(SIMULATIONS) + 1)}",
    ]
    for kind, size in dict.fromkeys((kind, size) for kind in units for k, size, _ in sums if k == kind):
        cells = []
        for group in SIMULATIONS:
            n = sums.get((kind, size, group))
            if n is None or not n["faults"]:
                cells += ["", ""]
            else:
                recall, alarms = n["found"] / n["faults"], n["accused"] / max(n["clean"], 1)
                cells += [f"{recall:.2f} of {n['faults']:,}", f"{100 * alarms:.1f} %"]
        lines.append(f"| {kind} | {size:g} {units[kind]} | {' | '.join(cells)} | {coverage(rows, kind)} |")
    clean = ", ".join(f"{r['set']} {100 * r['accused'] / r['clean']:.0f}" for r in rows if r["kind"] == "clean")
    return "\n".join([*lines, "", f"Findings in 100 clean demonstrations: {clean}.", "", line(provenance(SEED))])


def speed(n_steps: int = 1_000_000, length: int = 300, joints: int = 7) -> str:
    """A sentence on the processor time of `find_faults` for positions and commands, in memory and from disk."""
    rng = np.random.default_rng(SEED)
    observations = np.cumsum(rng.normal(size=(n_steps, joints)), axis=0).astype(np.float32)
    actions = (np.roll(observations, -2, axis=0) + 0.1 * rng.normal(size=(n_steps, joints))).astype(np.float32)
    offsets = np.append(np.arange(0, n_steps, length), n_steps)
    in_memory = Demonstrations.from_arrays(observations, actions, offsets)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.parquet"
        formats.write(path, in_memory)
        begun = time.process_time()
        find_faults(in_memory)
        between = time.process_time()
        find_faults(open_dataset(path))
        ended = time.process_time()
    rates = [60e-6 * n_steps / seconds for seconds in (between - begun, ended - between)]
    return (
        f"One core checks {rates[0]:.0f} million steps of {2 * joints} columns a minute in memory, and {rates[1]:.0f} "
        "million from Parquet."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of the NPZ files; by default simulations only")
    parser.add_argument("--files", type=Path, nargs="*", default=[], help="also these recordings, of any format")
    parser.add_argument("--kinds", nargs="*", default=[], help="only these faults")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="few simulated demonstrations, one seed")
    parser.add_argument("--json", type=Path, help="also write every row")
    options = parser.parse_args()
    seeds, size = (1, 10) if options.quick else (options.seeds, 40)
    rows = run(options.data, options.files, seeds, size, options.quick, options.kinds)
    text = f"{render(rows)}\n\n{speed(20_000 if options.quick else 1_000_000)}"
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1))
    print(text)


if __name__ == "__main__":
    main()
