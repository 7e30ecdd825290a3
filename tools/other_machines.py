"""The tests, and six audits, as on other computers: with other kernels of BLAS and NumPy, and where SIGINT is ignored.

Usage
-----
``python tools/other_machines.py`` runs the fast tests on each machine that this one can stand for, judges the sets of
``--data`` and compares findings, words and pairs with those of the plain machine. ``--tests`` runs the tests alone,
``--tests FILE,FILE`` all tests of these files, and ``--sets`` judges alone; ``--only prescott,sigint`` takes two
machines. The exit code is 1 where an answer differs, a test fails, or a machine is not what it should be.

Notes
-----
OpenBLAS chooses its kernels by the processor, or by OPENBLAS_CORETYPE; NumPy leaves out what NPY_DISABLE_CPU_FEATURES
names. NumPy and SciPy bring an OpenBLAS each, and each is asked for the kernels that it took. Kernels differ in the
order of sums, so that log-odds may differ; findings, words and pairs may not.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
SETS = ("f1sim_corner", "jigsaws_knot_tying", "metaworld_reach", "pidail_lunarlander", "tictactoe_players")
SETS += ("vild_lunarlander_discrete",)
"""Both kinds of actions, and four findings. Those of discrete actions have log-odds that differ most, by up to .1."""
FAST_TESTS = ("-m", "not slow", "--numprocesses", "2", "--dist", "loadfile")
CHOICES = ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES")


@dataclass(frozen=True)
class Machine:
    """What another computer has in the place of this one's."""

    name: str
    variables: dict[str, str]
    needs: frozenset[str] = frozenset()
    """Flags in /proc/cpuinfo of a processor that can run it."""
    kernels: frozenset[str] = frozenset()
    """What OpenBLAS may call its kernels there; empty where any do."""
    ignores_sigint: bool = False

    def start(self, command: Sequence[str]) -> tuple[int, str, str]:
        """The code, stdout and stderr of a command there."""
        kept = {name: value for name, value in os.environ.items() if name not in CHOICES}
        variables = {"OPENBLAS_NUM_THREADS": "1"} | kept | self.variables
        before = signal.signal(signal.SIGINT, signal.SIG_IGN if self.ignores_sigint else signal.default_int_handler)
        process = subprocess.Popen(command, cwd=ROOT, env=variables, stdout=PIPE, stderr=PIPE, text=True)
        signal.signal(signal.SIGINT, before)
        with process:
            out, err = process.communicate()
        return process.returncode, out, err


def machines(simd: Sequence[str]) -> list[Machine]:
    """All there are, the plain one first; `simd` are the families of instructions that NumPy found here."""
    wide = [name for name in simd if name.startswith("AVX512") or name == "X86_V4"]
    vectors = [name for name in simd if name in ("FMA3", "AVX2", "X86_V3", *wide)]
    cores = [
        ("Prescott", "pni", {"Prescott", "Katmai"}),  # one kernel has both names where a wheel has no older ones
        ("Nehalem", "sse4_2", {"Nehalem"}),
        ("Haswell", "avx2 fma", {"Haswell"}),
        ("Zen", "avx2 fma", {"Zen", "Haswell"}),
        ("SkylakeX", "avx512f", {"SkylakeX"}),
    ]
    found = [Machine("plain", {})]
    found += [
        Machine(core.lower(), {CHOICES[0]: core}, frozenset(needs.split()), frozenset(kernels))
        for core, needs, kernels in cores
    ]
    for name, left_out in (("no-avx512", wide), ("no-avx2", vectors)):
        needs = frozenset() if left_out else frozenset({f"{name[3:].upper()} that NumPy uses"})
        found.append(Machine(name, {CHOICES[1]: " ".join(left_out)}, needs))
    return [*found, Machine("sigint", {}, ignores_sigint=True)]


def simd_families() -> list[str]:
    """The families of instructions for which NumPy has code of its own, and which this processor has."""
    return list(np.show_config(mode="dicts")["SIMD Extensions"].get("found", []))


def processor_flags() -> frozenset[str]:
    """The flags in /proc/cpuinfo; none where it has none."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    return frozenset(next((line.partition(":")[2] for line in lines if line.startswith("flags")), "").split())


def judge(paths: Sequence[str]) -> None:
    """Print as JSON what this process is made of, and the answers for each file."""
    import scipy.linalg  # noqa: F401  its OpenBLAS too
    from threadpoolctl import threadpool_info

    import rpil

    warnings.simplefilter("ignore")
    answers = {}
    for path in paths:
        audit = rpil.RPIL().fit(rpil.read(path)).audit_
        words = {str(name): word for name, word in zip(audit.ids, audit.verdicts, strict=True)}
        answers[Path(path).stem] = {
            "finding": audit.finding,
            "words": words,
            "pair": [str(name) for name in audit.pair],
        }
    blas = [library for library in threadpool_info() if library["internal_api"] == "openblas"]
    kernels = {Path(library["filepath"]).name: library["architecture"] for library in blas}
    interruptible = signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
    print(json.dumps({"kernels": kernels, "simd": simd_families(), "interruptible": interruptible, "answers": answers}))


def ask(machine: Machine, paths: Sequence[str]) -> dict[str, Any]:
    """What `judge` prints on a machine."""
    code, out, err = machine.start([sys.executable, str(Path(__file__).resolve()), "--judge", *paths])
    if code:
        sys.exit(f"{machine.name}: {err}")
    return dict(json.loads(out))


def not_as_asked(machine: Machine, made: dict[str, Any]) -> list[str]:
    """Where what a process is made of is not what the machine should have."""
    wrong = [
        f"OPENBLAS_CORETYPE has no effect in {library}: {kernel}"
        for library, kernel in made["kernels"].items()
        if machine.kernels and kernel not in machine.kernels
    ]
    left_out = machine.variables.get(CHOICES[1], "").split()
    wrong += [f"NPY_DISABLE_CPU_FEATURES has no effect on {name}" for name in left_out if name in made["simd"]]
    if made["interruptible"] == machine.ignores_sigint:
        wrong.append("SIGINT is not as it should be")
    return wrong


def differences(plain: dict[str, Any], other: dict[str, Any]) -> list[str]:
    """Where the answers for sets differ, one line each."""
    found = []
    for name, answer in plain.items():
        for part in ("finding", "pair"):
            if answer[part] != other[name][part]:
                found.append(f"{name}: the {part} is {other[name][part]}, plain {answer[part]}")
        words = other[name]["words"]
        found += [
            f"{name}: {who} is {words.get(who)}, plain {word}"
            for who, word in answer["words"].items()
            if words.get(who) != word
        ]
    return found


def test(machine: Machine, arguments: Sequence[str]) -> list[str]:
    """Run tests there; the lines that name what failed, after what pytest says at last."""
    code, out, err = machine.start([sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--quiet", *arguments])
    lines = (out + err).splitlines()
    print(f"  {lines[-1]}", flush=True)
    return [line for line in lines if line.startswith(("FAILED", "ERROR"))] or [lines[-1]] * bool(code)


def chosen(only: str | None) -> list[Machine]:
    """The machines asked for that this one can stand for; others are named."""
    everything, flags = machines(simd_families()), processor_flags()
    names = [machine.name for machine in everything]
    wanted = only.split(",") if only else names
    if not set(wanted) <= set(names):
        sys.exit(f"--only: choose among {', '.join(names)}")
    found = []
    for machine in (machine for machine in everything if machine.name in wanted):
        if machine.needs <= flags:
            found.append(machine)
        else:
            print(f"{machine.name}: skipped, this processor has no {' '.join(sorted(machine.needs - flags))}")
    return found


def compare(
    machine: Machine, plain: dict[str, Any], paths: Sequence[str], tests: Sequence[str], seen: dict[str, str]
) -> list[str]:
    """What is wrong on a machine, and print it; nothing is done anew where one that was `seen` is made of the same."""
    begun = time.perf_counter()
    made = ask(machine, [])
    kernels, simd = sorted(set(made["kernels"].values())), made["simd"] or ["none"]
    print(f"{machine.name}: kernels {' '.join(kernels)}; NumPy {' '.join(simd)}", flush=True)
    found = not_as_asked(machine, made)
    same = seen.setdefault(f"{kernels} {simd} {machine.ignores_sigint}", machine.name)
    if same != machine.name:
        print(f"  the same as {same}", flush=True)
        return found
    if paths:
        found += differences(plain["answers"], ask(machine, paths)["answers"])
        print(f"  {len(paths)} sets: {len(found)} differences", flush=True)
    if tests:
        found += test(machine, tests)
    for line in found:
        print(f"  {line}")
    print(f"  {time.perf_counter() - begun:.0f} s", flush=True)
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="NAME,NAME", help="these machines: plain, prescott and others")
    parser.add_argument("--tests", nargs="?", const="", metavar="FILE,FILE", help="tests alone; by default fast ones")
    parser.add_argument("--sets", action="store_true", help="sets alone")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of the sets")
    parser.add_argument("--judge", nargs="*", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.judge is not None:
        judge(asked.judge)
        return 0
    paths = [] if asked.tests is not None else [str((asked.data / f"{name}.npz").resolve()) for name in SETS]
    missing = [path for path in paths if not Path(path).exists()]
    if missing:
        parser.error(f"{missing[0]} is not there; give --data, or --tests")
    plain = ask(Machine("plain", {}), paths)
    for name, answer in plain["answers"].items():
        counts = ", ".join(f"{count} {word}" for word, count in Counter(answer["words"].values()).items())
        print(f"{name}: {answer['finding']}; {counts}; pair {' and '.join(answer['pair'])}", flush=True)
    tests = [] if asked.sets else asked.tests.split(",") if asked.tests else FAST_TESTS
    seen: dict[str, str] = {}
    wrong = [line for machine in chosen(asked.only) for line in compare(machine, plain, paths, tests, seen)]
    print(f"{len(wrong)} differences and failures")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
