"""Rankings of real demonstrations by all methods, and policies fitted to the trusted ones; truth is for scoring alone.

    python benchmarks/real.py --data DIR --json real.json --processes 2

DIR holds NPZ files: observations, actions and episode_ids for every step, and for every episode the truth:
`episode_quality` (higher is better) and `is_good` (1 good, 0 bad, -1 in between; without it no demonstration is known
to be bad). Every method of peers.py ranks the demonstrations without the truth. A higher score is more trusted in every
data set. AUROC is good against bad, Spearman's correlation is with the quality of all. Then three policies predict the
held-out good demonstrations of five folds: trained on all of the others, on what our default kept of them, and on the
good ones among them. Intervals are bootstrapped over demonstrations.

RM-ENT alone gets the number of good demonstrations, and the oracle which ones are good. A method that cannot handle
continuous actions raises a message, which is kept.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from npz_sets import add_data_options, check_data_options, npz_files, read_set, write_simulated
from options import at_least, output, write_json
from provenance import provenance
from real_goals import continuous_goals, goal
from real_report import OURS, markdown, text
from real_scores import ORACLE, TRAINED_ON, Array, Job, Reply, Row, described, held_out_rows, mean_aurocs, ranking
from rpil.data import formats
from rpil.data.errors import DataError
from rpil.numerics.parallel import in_processes
from rpil.policies.features import FEATURES
from scoring import plain_words, stream

__all__ = ["main", "markdown", "measure"]

COUNTED = "RM-ENT"
"""The method that is given the number of good demonstrations."""

N_FOLDS = 5
QUICK = (OURS, "length")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_data_options(parser, "in DIR")
    parser.add_argument("--methods", action="append", metavar="NAME", help="may be repeated; default all of peers.py")
    parser.add_argument("--features", default="auto", choices=FEATURES)
    parser.add_argument("--processes", type=at_least(1), default=1)
    parser.add_argument("--seed", type=at_least(0), default=0)
    parser.add_argument("--quick", action="store_true", help="two small simulated data sets, two methods; needs no DIR")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    from peers import METHODS  # lazily: scikit-learn, cleanlab and all the rest

    check_data_options(parser, options)
    for name in options.methods or ():
        if name not in METHODS:
            parser.error(f"there is no method {name!r}; choose from {', '.join(METHODS)}.")
    with tempfile.TemporaryDirectory() as made:
        if options.quick:
            for kind in ("corrupted", "noisy"):
                write_simulated(Path(made) / f"mountaincar_{kind}.npz", kind, 6, 6, options.seed)
        data = Path(made) if options.quick else options.data
        try:
            methods = options.methods or (QUICK if options.quick else list(METHODS))
            result = measure(npz_files(data, options.sets), methods, options.features, options.seed, options.processes)
        except DataError as error:
            parser.error(str(error))
    print(text(result))
    if options.json:
        write_json(options.json, result)
    return 0 if result["goal"]["reached"] and all(aim["reached"] for aim in result["continuous_goals"]) else 1


def measure(paths: Iterable[Path], methods: Iterable[str], features: str, seed: int, processes: int = 1) -> Row:
    """All figures, as plain numbers and text."""
    data = {path: read_set(path) for path in paths}
    jobs = [
        job for path, (_, truth) in data.items() for job in jobs_of(path, truth.good, list(methods), features, seed)
    ]
    replies: dict[Path, list[tuple[Job, Reply]]] = {path: [] for path in data}
    for job, reply in zip(jobs, in_processes(answer, [(job,) for job in jobs], processes), strict=True):
        replies[job.path].append((job, reply))
        print(f"{job.path.stem}, {job.method}: {reply.seconds:.1f} s", file=sys.stderr)

    unranked = {
        job.method
        for of in replies.values()
        for job, reply in of
        if job.held_out is None and reply.scores is None and not reply.said
    }
    sets, ranked, held_out, draws = {}, [], [], {}
    for path, (demonstrations, truth) in data.items():
        name = path.stem
        sets[name] = described(demonstrations, truth)
        for job, reply in replies[path]:
            if job.held_out is None and job.method not in unranked:
                row, draws[name, job.method] = ranking(reply, truth, stream(seed, name))
                ranked.append({"set": name, "method": job.method, **row})
        held_out += held_out_rows(name, replies[path], demonstrations, truth, seed)
    means = mean_aurocs(ranked, draws, sets)
    return {
        "provenance": provenance(seed),
        "features": features,
        "sets": sets,
        "ranking": ranked,
        "mean_auroc": means,
        "goal": goal(means),
        "continuous_goals": continuous_goals(sets, ranked, held_out),
        "held_out": held_out,
    }


def jobs_of(path: Path, good: Array, methods: list[str], features: str, seed: int) -> list[Job]:
    """Every method on all demonstrations, then those that train a policy on each fold."""
    from peers import Task

    def task(method: str, of: Array) -> Task:
        return Task(
            features=features,
            seed=seed,
            n_trusted=int(of.sum()) if method == COUNTED else None,
            good=of if method == ORACLE else None,
        )

    # Blind to truth, so that a fold may hold no good demonstration: it only counts for less.
    folds = np.array_split(stream(seed, path.stem).permutation(len(good)), N_FOLDS)
    return [Job(path, method, task(method, good)) for method in methods if method != ORACLE] + [
        Job(path, method, task(method, np.delete(good, fold)), np.sort(fold))
        for method in TRAINED_ON.values()
        if method in methods
        for fold in folds
    ]


def answer(job: Job) -> Reply:
    """The reply of a method that gets observations, actions, episode ids and its task."""
    from peers import METHODS

    demonstrations = formats.read(job.path)
    if job.held_out is not None:
        held_out = demonstrations.select(job.held_out)
        demonstrations = demonstrations.select(np.delete(np.arange(len(demonstrations)), job.held_out))
    begun = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ambiguity and convergence: the figures show the consequence
            found = METHODS[job.method](demonstrations, job.task)
    except DataError as error:
        return Reply(time.perf_counter() - begun, said=str(error).removeprefix(f"{demonstrations.source}: "))
    seconds = time.perf_counter() - begun
    if job.held_out is not None:
        return Reply(seconds, predicted=np.asarray(found.policy.predict(held_out.observations)))
    audit = getattr(found.policy, "audit_", None)
    return Reply(seconds, found.scores, None if audit is None else np.array(plain_words(audit.verdicts)))


if __name__ == "__main__":
    raise SystemExit(main())
