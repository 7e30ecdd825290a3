"""How many planted recording faults the rules of `rpil check` find, and how many clean demonstrations they accuse.

Each is planted into a tenth of the demonstrations of clean sets: good ones of simulations, of recordings in a folder,
and of other files. The name of a set tells its half: thresholds were chosen on one, and the other is held out.

    python benchmarks/faults.py --data DIR --files ... --docs docs/faults.md
"""

from __future__ import annotations

import argparse
import hashlib
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import more_experts  # noqa: F401 (makes these known)
from fault_kinds import KINDS, Clean, Planted, copies, plant
from fault_worlds import WORLDS
from provenance import line, provenance
from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.faults.checking import check
from rpil.faults.report import FaultReport
from rpil.simulation.simulate import simulate
from tables import table
from worlds.recorded import npz_files, read

SIMULATIONS = ("Pendulum-v1", "MountainCarContinuous-v0", "LunarLanderContinuous-v3", "Acrobot-v1", "CartPole-v1")
HALVES = ("chosen", "held out")
MARK, END = "<!-- measured, by benchmarks/faults.py -->", "<!-- end -->"
OUTSIDE = "<!-- outside robots, by benchmarks/faults.py -->"
SHARE, SEED, NOISES = 0.1, 0, (0.0,)  # so many of the demonstrations have the fault; noise of copies
ABLATED = ["sign", "offset", "lag", "never moves"]


def half(name: str) -> str:
    """Which half a set belongs to, by its name alone."""
    return HALVES[hashlib.sha256(name.encode()).digest()[-1] % 2]


def clean_sets(folder: Path | None, files: list[Path], size: int, quick: bool) -> Iterator[tuple[str, Demonstrations]]:
    """Name and demonstrations of each clean set."""
    for name in SIMULATIONS[:2] if quick else SIMULATIONS:
        made = simulate(name, "random", n_good=size, n_bad=0, seed=SEED)
        yield name, Demonstrations.from_episodes(made.episodes, source=name)
    for path in npz_files(folder) if folder is not None else ():
        yield path.stem, read(path).good_half().demonstrations
    for path in files:
        yield path.parent.name if path.is_file() else path.name, formats.read(path)


def score(report: FaultReport, planted: Planted, rule: str, alike: tuple[str, ...]) -> dict[str, int]:
    """Counts of faults, and of those that the rule named, or another rule; of clean demonstrations, and of those that
    the rule accused."""
    ids, faulty = planted.demonstrations.ids, planted.has_fault
    own, named, other = (
        np.isin(ids, [f.id for f in report.findings if test(f.rule)])
        for test in (rule.__eq__, (rule, *alike).__contains__, rule.__ne__)
    )
    n = int(faulty.sum()) // (2 if rule == "duplicate" else 1)  # of each pair of copies one is named, either
    counts = {"found": named, "any": named | other, "other": other}
    counted = {name: min(int((mask & faulty).sum()), n) for name, mask in counts.items()}
    return {"faults": n, **counted, "clean": int((~faulty).sum()), "accused": int((own & ~faulty).sum())}


def run(sets: Iterator[tuple[str, Demonstrations]], seeds: int) -> list[dict[str, Any]]:
    """One row for each set, kind, size and seed."""
    rows: list[dict[str, Any]] = []
    for name, demonstrations in sets:
        start, clean, group = time.perf_counter(), Clean(demonstrations), half(name)
        rows.append({"group": group, "set": name, "kind": "clean", "checked": False, "clean": len(clean.episodes)})
        rows[-1]["accused"] = dict(clean.report.counts)
        wanted = [(kind, k.rule, k.alike, size) for kind, k in KINDS.items() for size in k.sizes]
        wanted += [("duplicate", "duplicate", (), noise) for noise in NOISES]
        for seed in range(seeds):
            for kind, rule, alike, size in wanted:
                rng = np.random.default_rng([seed, int(10 * size)])
                planted = (copies if rule == "duplicate" else plant)(clean, kind, size, SHARE, rng)
                if planted is not None:
                    report = check(planted.demonstrations, times=planted.times)
                    row = {"group": group, "set": name, "kind": kind, "size": size, "seed": seed}
                    row |= {"checked": rule not in report.not_checked, "known": clean.known(rule)}
                    rows.append(row | score(report, planted, rule, alike))
        print(f"{name}: {time.perf_counter() - start:.0f} s", flush=True)
    return rows


def outside() -> str:
    """Findings in clean recordings that are not of robots."""
    lines = []
    for name, make in WORLDS.items():
        demonstrations, times = make(np.random.default_rng(SEED))
        counts = check(demonstrations, times=times).counts
        lines.append([name, str(len(demonstrations)), ", ".join(f"{n} {rule}" for rule, n in counts.items()) or "0"])
    return table(["clean recording", "demonstrations", "findings"], lines, 1)


def summarise(rows: list[dict[str, Any]], *keys: str) -> dict[tuple[Any, ...], dict[str, int]]:
    """Sums by the keys, of the rows whose rule could be checked."""
    sums: dict[tuple[Any, ...], dict[str, int]] = defaultdict(lambda: defaultdict(int))
    for row in rows:
        if row["checked"]:
            for count in ("faults", "found", "any", "other", "clean", "accused"):
                sums[tuple(row[key] for key in keys)][count] += row[count]
    return sums


def render(rows: list[dict[str, Any]]) -> str:
    """The table of docs/faults.md: by kind and size."""
    sums, units = summarise(rows, "kind", "size", "group"), {name: kind.unit for name, kind in KINDS.items()}
    lines, planted = [], [row for row in rows if row["kind"] != "clean"]
    for kind, size in dict.fromkeys((row["kind"], row["size"]) for row in planted):
        cells = [f"{size:g} {units.get(kind, 'standard deviations of noise')}"]
        for n in (sums.get((kind, size, group)) for group in HALVES):
            cells += [f"{n['found'] / n['faults']:.2f} ({n['faults']:,})"] if n else [""]
            cells += [f"{100 * n['accused'] / max(n['clean'], 1):.1f} %"] if n else [""]
        shares = {row["set"]: row["known"] for row in planted if row["kind"] == kind and row["known"] is not None}
        lines.append([kind, *cells, f"{100 * np.mean(list(shares.values())):.0f} %" if shares else ""])
    header = [cell for group in HALVES for cell in (f"recall, {group}", "false alarms")]
    first = table(["fault", "size", *header, "known"], lines, 2)
    return f"{first}\n\n{line(provenance(SEED))}"


def render_sets(rows: list[dict[str, Any]]) -> str:
    """Faults of whole demonstrations that are found in each set, and findings where it is clean."""
    kinds, sets = [k for k in KINDS if k in ABLATED or k == "action early"], summarise(rows, "set", "kind")
    by_set = []
    for row in (row for row in rows if row["kind"] == "clean"):
        found = [sets.get((row["set"], kind)) for kind in kinds]
        cells = [f"{n['found']} of {n['faults']}" if n else "" for n in found]
        alarms = ", ".join(f"{count} {rule}" for rule, count in row["accused"].items())
        by_set.append([row["set"], row["group"], *cells, alarms or "0", str(row["clean"])])
    return table(["set", "half", *kinds, "findings where clean", "demonstrations"], by_set, 2)


def ablation(rows: list[dict[str, Any]]) -> str:
    """What each rule of whole demonstrations is worth on the sets held out: faults of which something is found, and
    findings in clean demonstrations, with it and without; and what it finds at least with one family of sets, those
    whose names have the first word in common, left out."""
    held = [row for row in rows if row["group"] == HALVES[1]]
    clean = [row for row in held if row["kind"] == "clean"]
    alarms, n = sum((Counter(row["accused"]) for row in clean), Counter()), sum(row["clean"] for row in clean)
    lines = []
    for kind, k in ((kind, k) for kind, k in KINDS.items() if k.rule in ABLATED):
        own = summarise([row for row in held if row["kind"] == kind], "kind").get((kind,))
        if own and own["faults"]:
            shares = [f"{own[count] / own['faults']:.2f}" for count in ("found", "any", "other")]
            rates = [f"{100 * (alarms.total() - less) / n:.1f}" for less in (0, alarms[k.rule])]
            lines.append([k.rule, *shares, *rates, f"{worth_at_least(held, kind):+.2f}"])
    header = ["rule", "named", "found", "found without it", "findings in 100 clean", "without it"]
    return table([*header, "a family left out"], lines)


def worth_at_least(rows: list[dict[str, Any]], kind: str) -> float:
    """What a rule adds to the share of the faults of its kind that are found, with the family left out that it helps
    most."""
    own = [row | {"family": row["set"].partition("_")[0]} for row in rows if row["kind"] == kind]
    sums = summarise(own, "kind", "family")
    rest = [[n for (_, other), n in sums.items() if other != family] for _, family in sums]
    return min(
        (sum(n["any"] - n["other"] for n in each) / sum(n["faults"] for n in each) for each in rest if each),
        default=0.0,
    )


def speed(n_steps: int = 1_000_000, length: int = 300, joints: int = 7) -> str:
    """A sentence on the processor time of `rpil.check` for positions and commands."""
    rng = np.random.default_rng(SEED)
    observations = np.cumsum(rng.normal(size=(n_steps, joints)), axis=0).astype(np.float32)
    actions = (np.roll(observations, -2, axis=0) + 0.1 * rng.normal(size=(n_steps, joints))).astype(np.float32)
    made = Demonstrations(observations, actions, np.append(np.arange(0, n_steps, length), n_steps))
    begun, _ = time.process_time(), check(made)
    rate = 60e-6 * n_steps / (time.process_time() - begun)
    return f"One core checks {rate:.0f} million steps of {2 * joints} columns a minute."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="folder of the NPZ files; by default simulations only")
    parser.add_argument("--files", type=Path, nargs="*", default=[], help="also these recordings, of any format")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="few simulated demonstrations")
    parser.add_argument("--ablation", action="store_true", help="also what each rule of whole demonstrations is worth")
    parser.add_argument("--docs", type=Path, help="write the tables between the marks of this page")
    parser.add_argument("--outside", action="store_true", help="only clean recordings that are not of robots")
    options = parser.parse_args()
    if options.outside:
        write(options.docs, OUTSIDE, outside())
        return
    sets = clean_sets(options.data, options.files, 10 if options.quick else 40, options.quick)
    rows = run(sets, options.seeds)
    write(options.docs, MARK, f"{render(rows)}\n\n{speed(20_000 if options.quick else 1_000_000)}")
    print(f"\n{render_sets(rows)}\n\n{ablation(rows) if options.ablation else ''}")


def write(docs: Path | None, mark: str, text: str) -> None:
    """Print a text, and write it between a mark of a page and the next `END`."""
    if docs:
        before, rest = docs.read_text().split(mark)
        docs.write_text(f"{before}{mark}\n{text}\n\n{END}{rest.split(END, 1)[1]}")
    print(text)


if __name__ == "__main__":
    main()
