"""Seven kinds of bad demonstrations at three shares, with one configuration for all cells.

    python benchmarks/robustness.py --output robustness                      # what is finished is kept, and not redone
    python benchmarks/robustness.py --output robustness --peers --peer-draws 3

Ten good demonstrations, and as many bad ones of one kind as make up a share of 50, 75 or 90 %; ten draws of the data.
Three scores: the normalised return (R - R_random) / (R_oracle - R_random), where the oracle is cloned from the good
demonstrations alone with the same features; the AUROC of the log-odds; the share of wrong verdicts, "open" being
wrong. From a share of one half, "flip" and "shift" make bad demonstrations that agree as well as the good ones do. The
data cannot tell which group is good there, so the finding must be "two groups"; with one label of each sort the
cell is scored like the others, on the demonstrations without a label.

Every finished piece of work is one JSON line in `draws.jsonl`, so that a run can be broken off and taken up again. A
line belongs to one configuration, the code of the library included; lines of others are left alone. Then come
`summary.json`, `robustness.png` and a table.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy; worker processes inherit it

import numpy as np
from sklearn.metrics import roc_auc_score

import rpil
from grid import ENVIRONMENTS, N_GOOD, SHARES, n_bad, one_label_each, unknowable
from options import at_least, write_json
from provenance import provenance
from robustness_report import LABELLED, OURS, REFERENCE, Row, heat_map, summary, table
from rpil.data.demonstrations import Demonstrations
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from rpil.numerics.parallel import cores, in_processes
from rpil.simulation.corruptions import KINDS
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import RandomPolicy, rollout
from rpil.simulation.simulate import simulate
from scoring import count_words
from study.experiments import EXPERIMENTS

CHOSEN = "auto"
"""The features of everything here: the one setting that is not the library's default."""

MORE = ("CartPole-v1", "rpil/DiscretePendulum-v1")
NOT_MEASURED = ("cli", "html", "formats")
"""Packages of the library that no figure here depends on."""

Key = tuple[str, str, int, int, str]


@dataclass(frozen=True)
class Job:
    """What one process does at a time: some methods on one draw of one cell, or the reference of one draw."""

    env: str
    kind: str
    share: int
    seed: int
    methods: tuple[str, ...]

    @property
    def keys(self) -> list[Key]:
        return [(self.env, self.kind, self.share, self.seed, method) for method in self.methods]


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--environments", nargs="+", metavar="ID")
    parser.add_argument("--kinds", nargs="+", choices=KINDS)
    parser.add_argument("--shares", nargs="+", type=at_least(1, 99), metavar="PERCENT", help="of bad demonstrations")
    parser.add_argument("--draws", type=at_least(1))
    parser.add_argument("--first-seed", type=at_least(0), default=1000)
    parser.add_argument("--rollouts", type=at_least(1), help="episodes each policy plays")
    parser.add_argument("--peers", action="store_true", help="every method of peers.py as well")
    parser.add_argument("--peer-draws", type=at_least(1), help="draws for the peers; default all")
    parser.add_argument("--processes", type=at_least(1), default=cores())
    parser.add_argument("--quick", action="store_true", help="MountainCar, corrupted and shift, half bad, one draw")
    options = parser.parse_args(arguments)
    default = (
        (ENVIRONMENTS[:1], ("corrupted", "shift"), SHARES[:1], 1, 10)
        if options.quick
        else (ENVIRONMENTS + MORE, KINDS, SHARES, 10, 100)
    )
    for name, value in zip(("environments", "kinds", "shares", "draws", "rollouts"), default, strict=True):
        if getattr(options, name) is None:
            setattr(options, name, value)

    options.output.mkdir(parents=True, exist_ok=True)
    configurations = configurations_of(options.rollouts, options.peers)
    every = jobs(options, tuple(name for name in configurations if name not in (REFERENCE, *OWN)))
    wanted = [key for job in every for key in job.keys]
    with Results(options.output / "draws.jsonl", configurations) as results:
        work(every, results, options)
        rows = [results.rows[key] for key in wanted if key in results.rows]
    asked = {"configuration": configurations[OURS], "draws": options.draws, "first_seed": options.first_seed}
    asked["provenance"] = provenance(f"{options.first_seed} to {options.first_seed + options.draws - 1}")
    found = asked | summary(rows, len(wanted))
    write_json(options.output / "summary.json", found)
    heat_map(found["cells"], options.output / "robustness.png")
    print(table(found))
    return 0 if found["reached"] else 1


def configurations_of(rollouts: int, with_peers: bool) -> dict[str, Row]:
    """For every method all that its figures depend on beside their key: settings and code."""
    root = Path(rpil.__file__).parent
    library = [path for path in sorted(root.rglob("*.py")) if path.parent.name not in NOT_MEASURED]
    ours = {"features": CHOSEN, "n_good": N_GOOD, "rollouts": rollouts, "code": digest(library)}
    found = dict.fromkeys((REFERENCE, *OWN), ours)
    if with_peers:
        import peers

        theirs = ours | {"peers": digest(sorted(Path(peers.__file__).parent.glob("peers*.py")))}
        found |= {name: theirs for name in peers.METHODS if name not in found}
    return found


def digest(paths: list[Path]) -> str:
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest()[:12]


def jobs(options: argparse.Namespace, peers: tuple[str, ...]) -> list[Job]:
    """Draw by draw over all cells, so that what a broken run leaves is a fair picture; the peers come last."""
    cells = [(env, kind, share) for env in options.environments for kind in options.kinds for share in options.shares]
    found = []
    for seed in range(options.first_seed, options.first_seed + options.draws):
        found += [Job(env, "", 0, seed, (REFERENCE,)) for env in options.environments]
        found += [Job(*cell, seed, (OURS, LABELLED) if unknowable(*cell[1:]) else (OURS,)) for cell in cells]
    n_draws = min(options.draws, options.peer_draws or options.draws) if peers else 0
    for seed in range(options.first_seed, options.first_seed + n_draws):
        found += [Job(*cell, seed, peers) for cell in cells]
    return found


# ---- one job ---------------------------------------------------------------------------------------------------------


def run(job: Job, rollouts: int) -> list[Row]:
    """The rows of one job, or a row with the error of a method that fails: the others still count."""
    warnings.simplefilter("ignore")
    if job.methods == (REFERENCE,):
        methods: dict[str, Callable[[], Row]] = {REFERENCE: partial(reference, job.env, job.seed, rollouts)}
    else:
        made = simulate(job.env, job.kind, n_good=N_GOOD, n_bad=n_bad(job.share), seed=job.seed)
        given = (job, Demonstrations.from_episodes(made.episodes), made.is_good == 1, rollouts)
        methods = {name: partial(OWN.get(name, partial(peer, name)), *given) for name in job.methods}
    rows = []
    for key, method in zip(job.keys, methods.values(), strict=True):
        begun = time.perf_counter()
        try:
            found = method()
        except Exception as error:  # whatever it is, it is written down and the grid goes on
            found = {"error": f"{type(error).__name__}: {error}"}
        names = ("env", "kind", "share", "seed", "method")
        rows.append(dict(zip(names, key, strict=True)) | {"job_seconds": time.perf_counter() - begun} | found)
    return rows


def reference(env: str, seed: int, rollouts: int) -> Row:
    """What a return is measured against; the good demonstrations depend on neither kind nor number of the bad."""
    good = Demonstrations.from_episodes(simulate(env, "corrupted", n_good=N_GOOD, n_bad=0, seed=seed).episodes)
    oracle = BehavioralCloning(features=CHOSEN).fit(good)
    policies = {"oracle": oracle, "expert": expert(env), "random": RandomPolicy(expert(env).actions, seed)}
    returns = {name: play(policy, env, rollouts, seed) for name, policy in policies.items()}
    return returns | {"features": oracle.features_.kind}


def unlabelled(job: Job, demonstrations: Demonstrations, good: np.ndarray, rollouts: int) -> Row:
    model, found = fitted(demonstrations, good, {})
    if not unknowable(job.kind, job.share):
        found["return"] = play(model, job.env, rollouts, job.seed)
    return found


def labelled(job: Job, demonstrations: Demonstrations, good: np.ndarray, rollouts: int) -> Row:
    model, found = fitted(demonstrations, good, one_label_each(good))
    return found | {"return": play(model, job.env, rollouts, job.seed)}


PRIORS = {experiment.env_id: experiment.prior for experiment in EXPERIMENTS}
"""What the paper's recipe is given; one half elsewhere."""

OWN: dict[str, Callable[..., Row]] = {OURS: unlabelled, LABELLED: labelled}


def peer(name: str, job: Job, demonstrations: Demonstrations, good: np.ndarray, rollouts: int) -> Row:
    from peers import METHODS, Task

    begun = time.perf_counter()
    truth: dict[str, dict[str, Any]] = {
        "oracle": {"good": good},
        "RM-ENT": {"n_trusted": int(good.sum())},
        "paper's recipe": {"prior": PRIORS.get(job.env, 0.5)},
    }
    task = Task(features=CHOSEN, seed=job.seed, **truth.get(name, {}))
    answer = METHODS[name](demonstrations, task)
    found: Row = {"seconds": time.perf_counter() - begun}
    if answer.scores is not None:
        found["auroc"] = float(roc_auc_score(good, answer.scores))
    if answer.policy is not None:
        found["return"] = play(answer.policy, job.env, rollouts, job.seed)
    return found


def fitted(demonstrations: Demonstrations, good: np.ndarray, labels: dict[int, str]) -> tuple[RPIL, Row]:
    """A model, and what its verdicts are worth on the demonstrations without a label."""
    begun = time.perf_counter()
    model = RPIL(features=CHOSEN).fit(demonstrations, labels=labels)
    seconds = time.perf_counter() - begun
    audit = model.audit_
    asked = np.setdiff1d(np.arange(len(good)), list(labels))
    given, wrong = count_words(np.array(audit.verdicts)[asked], good[asked])
    return model, {
        "seconds": seconds,
        "identifiable": audit.identifiable,
        "auroc": float(roc_auc_score(good[asked], audit.log_odds[asked])),
        "wrong": wrong / len(asked),
        "given": given / len(asked),
        "prior": audit.prior.mean,
        "adversary": audit.adversary,
        "features": model.features_.kind,
        "expert_proba": [round(float(p), 6) for p in audit.expert_proba[asked]],
        "good": good[asked].astype(int).tolist(),
    }


def play(policy: Any, env: str, rollouts: int, seed: int) -> float:
    return rollout(policy, env, n_episodes=rollouts, seed=seed).mean


# ---- many jobs, and what is already there ----------------------------------------------------------------------------


class Results:
    """Rows of one configuration by their key, kept in a file of JSON lines that only grows."""

    def __init__(self, path: Path, configurations: dict[str, Row]) -> None:
        self.path, self.configurations = path, configurations
        self.rows: dict[Key, Row] = {}
        text = path.read_bytes() if path.exists() else b""
        whole = text[: text.rfind(b"\n") + 1]
        if whole != text:  # a run was broken off within a line
            with path.open("r+b") as file:
                file.truncate(len(whole))
        for number, line in enumerate(whole.decode().splitlines(), 1):
            try:
                self._keep(json.loads(line))
            except (json.JSONDecodeError, KeyError):
                raise SystemExit(f"{path}, line {number}: no row of results; delete the line, or the file.") from None

    def _keep(self, row: Row) -> None:
        same = row["configuration"] == self.configurations.get(row["method"])
        if same and "error" not in row:  # what failed is tried again
            self.rows[row["env"], row["kind"], row["share"], row["seed"], row["method"]] = row

    def add(self, row: Row) -> None:
        row = {"configuration": self.configurations[row["method"]]} | row
        self._file.write(json.dumps(row) + "\n")
        self._file.flush()
        self._keep(row)

    def __enter__(self) -> Results:
        self._file = self.path.open("a")
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()


def work(every: list[Job], results: Results, options: argparse.Namespace) -> None:
    """Do the missing jobs, with progress on stderr."""
    todo = [
        Job(job.env, job.kind, job.share, job.seed, missing)
        for job in every
        if (missing := tuple(key[-1] for key in job.keys if key not in results.rows))
    ]
    begun = printed = time.perf_counter()
    jobs = [(job, options.rollouts) for job in todo]
    for done, rows in enumerate(in_processes(run, jobs, options.processes), 1):
        for row in rows:
            results.add(row)
            if "error" in row:
                print(
                    "failed:",
                    *(row[name] for name in ("env", "kind", "share", "seed", "method", "error")),
                    file=sys.stderr,
                )
        if time.perf_counter() - printed > 30 or done == len(todo):
            printed = time.perf_counter()
            print(f"{done} of {len(todo)} jobs in {printed - begun:.0f} s", file=sys.stderr, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
