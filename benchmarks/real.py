"""Who ranks real demonstrations best, and is a policy better for it? Truth is for scoring alone.

    python benchmarks/real.py --data DIR --json real.json --processes 2

DIR holds NPZ files: observations, actions and episode_ids for every step, and for every episode the truth:
`episode_quality` (higher is better) and `is_good` (1 good, 0 bad, -1 in between; without it nobody is known to be bad).
Every method of peers.py is given the demonstrations, no truth, and ranks them. Scores are taken as they are, higher
being more trusted; nothing is turned round for a data set. AUROC is good against bad, Spearman's correlation is with
the quality of all. Then three policies predict the held-out good demonstrations of five folds: trained on all of the
others, on what our default kept of them, and on the good ones among them. Intervals are bootstrapped over
demonstrations.

RM-ENT alone is told how many are good, and the oracle which. A method that is not made for continuous actions says so.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from options import at_least, output, write_json
from provenance import provenance
from real_goals import continuous_goals, goal
from real_report import OURS, VERDICTS, markdown, text
from rpil.data import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.numerics.parallel import in_processes
from rpil.policies.features import FEATURES
from rpil.simulation.simulate import simulate

__all__ = ["main", "markdown", "measure"]

ORACLE, COUNTED = "oracle", "RM-ENT"
TRAINED_ON = {"all": "trust all", "kept": OURS, "good": ORACLE}
N_FOLDS, N_RESAMPLES = 5, 2000
QUICK = (OURS, "length")
Array = NDArray[Any]
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known about M demonstrations: `good` and `bad` are masks, and some are neither; `quality` is a number."""

    good: Array
    bad: Array
    quality: Array


@dataclass(frozen=True, eq=False)
class Job:
    """One method on one data set: to rank all of it, or to predict the actions of those `held_out`."""

    path: Path
    method: str
    task: Any
    held_out: Array | None = None


@dataclass(frozen=True, eq=False)
class Reply:
    """What a method answered, or what it `said` where it could not: scores (M,), verdicts (M,), or actions (n,)."""

    seconds: float
    scores: Array | None = None
    verdicts: Array | None = None
    predicted: Array | None = None
    said: str | None = None


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, metavar="DIR", help="where the NPZ files are")
    parser.add_argument("--sets", action="append", metavar="NAME", help="may be repeated; default all in DIR")
    parser.add_argument("--methods", action="append", metavar="NAME", help="may be repeated; default all of peers.py")
    parser.add_argument("--features", default="auto" if "auto" in FEATURES else "raw", choices=FEATURES)
    parser.add_argument("--processes", type=at_least(1), default=1)
    parser.add_argument("--seed", type=at_least(0), default=0)
    parser.add_argument("--quick", action="store_true", help="two small simulated data sets, two methods; needs no DIR")
    parser.add_argument("--json", type=output, help="where to write all figures")
    options = parser.parse_args(arguments)
    from peers import METHODS  # lazily: scikit-learn, cleanlab and all the rest

    if not (options.data or options.quick):
        parser.error("say where the NPZ files are: --data DIR.")
    for name in options.methods or ():
        if name not in METHODS:
            parser.error(f"there is no method {name!r}; choose from {', '.join(METHODS)}.")
    with tempfile.TemporaryDirectory() as made:
        if options.quick:
            quick_data(Path(made), options.seed)
        data = Path(made) if options.quick else options.data
        try:
            methods = options.methods or (QUICK if options.quick else list(METHODS))
            result = measure(files(data, options.sets), methods, options.features, options.seed, options.processes)
        except DataError as error:
            parser.error(str(error))
    print(text(result))
    if options.json:
        write_json(options.json, result)
    return 0 if result["goal"]["reached"] and all(aim["reached"] for aim in result["continuous_goals"]) else 1


def files(data: Path, names: list[str] | None = None) -> list[Path]:
    """The NPZ files in a directory, those of some names only where there are any."""
    found = {path.stem: path for path in sorted(data.glob("*.npz"))}
    missing = [name for name in names or () if name not in found]
    if missing or not found:
        raise DataError(f"{data.name}: no file {(*missing, '*')[0]}.npz; found {', '.join(found) or 'none at all'}.")
    return [found[name] for name in names or found]


def truth(path: Path, demonstrations: Demonstrations) -> Truth:
    """Nothing else reads it, and what it returns goes to the scores, the oracle and RM-ENT (the number) alone."""
    with np.load(path, allow_pickle=False) as stored:
        if "episode_quality" not in stored.files:
            raise DataError(f"{path.name}: no array is called 'episode_quality'; save one number an episode under it.")
        quality = stored["episode_quality"].astype(float)
        is_good = stored["is_good"] if "is_good" in stored.files else np.ones(len(quality), dtype=int)
    size = len(demonstrations)
    if sorted(demonstrations.ids) != list(range(size)) or not quality.shape == is_good.shape == (size,):
        raise DataError(
            f"{path.name}: truth is by episode, 0 to {size - 1}; number the episodes so and give a value for each."
        )
    order = list(demonstrations.ids)
    return Truth(is_good[order] == 1, is_good[order] == 0, quality[order])


def measure(paths: Iterable[Path], methods: Iterable[str], features: str, seed: int, processes: int = 1) -> Row:
    """All figures, as plain numbers and text."""
    data = {path.stem: (path, formats.read(path)) for path in paths}
    known = {name: truth(path, demonstrations) for name, (path, demonstrations) in data.items()}
    jobs = [
        job
        for name, (path, _) in data.items()
        for job in jobs_of(path, known[name].good, list(methods), features, seed)
    ]
    replies: dict[str, list[tuple[Job, Reply]]] = {name: [] for name in data}
    for job, reply in zip(jobs, in_processes(answer, [(job,) for job in jobs], processes), strict=True):
        replies[job.path.stem].append((job, reply))
        print(f"{job.path.stem}, {job.method}: {reply.seconds:.1f} s", file=sys.stderr)

    unranked = {
        job.method
        for of in replies.values()
        for job, reply in of
        if job.held_out is None and reply.scores is None and not reply.said
    }
    sets, ranked, held_out, draws = {}, [], [], {}
    for name, (_, demonstrations) in data.items():
        sets[name] = described(demonstrations, known[name])
        for job, reply in replies[name]:
            if job.held_out is None and job.method not in unranked:
                row, draws[name, job.method] = ranking(reply, known[name], stream(seed, name))
                ranked.append({"set": name, "method": job.method, **row})
        held_out += held_out_rows(name, replies[name], demonstrations, known[name], seed)
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
    """Let a method have observations, actions and episode ids, and nothing else but its task."""
    from peers import METHODS

    demonstrations = formats.read(job.path)
    if job.held_out is not None:
        held_out = demonstrations.select(job.held_out)
        demonstrations = demonstrations.select(np.delete(np.arange(len(demonstrations)), job.held_out))
    begun = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ambiguity and convergence: the figures tell what came of it
            found = METHODS[job.method](demonstrations, job.task)
    except DataError as error:
        return Reply(time.perf_counter() - begun, said=str(error).removeprefix(f"{demonstrations.source}: "))
    seconds = time.perf_counter() - begun
    if job.held_out is not None:
        return Reply(seconds, predicted=np.asarray(found.policy.predict(held_out.observations)))
    audit = getattr(found.policy, "audit_", None)
    return Reply(seconds, found.scores, None if audit is None else np.array(audit.verdicts))


def stream(seed: int, name: str) -> np.random.Generator:
    """One for each data set: which others are measured changes nothing, and all methods meet the same resamples."""
    return np.random.default_rng([seed, zlib.crc32(name.encode())])


def described(demonstrations: Demonstrations, known: Truth) -> Row:
    discrete = demonstrations.is_discrete
    return {
        "demonstrations": len(demonstrations),
        "steps": demonstrations.n_steps,
        "observations": demonstrations.n_observations,
        "actions": len(np.unique(demonstrations.actions)) if discrete else demonstrations.actions.shape[1],
        "discrete": discrete,
        "good": int(known.good.sum()),
        "bad": int(known.bad.sum()),
    }


def ranking(reply: Reply, known: Truth, rng: np.random.Generator) -> tuple[Row, Array | None]:
    """How scores agree with truth, and the bootstrap draws of the AUROC."""
    row: Row = {"seconds": reply.seconds, "said": reply.said}
    row |= dict.fromkeys(("auroc", "auroc_ci95", "auroc_se", "spearman", "verdicts", "scores"))
    if reply.scores is None:
        return row, None
    scores = np.asarray(reply.scores, dtype=float)
    if scores.shape != known.good.shape or np.isnan(scores).any():
        return row | {"said": "a score is missing"}, None
    row["scores"] = [float(score) for score in np.nan_to_num(scores)]  # JSON knows no infinity
    if len(set(known.quality)) > 1 and len(set(scores)) > 1:
        row["spearman"] = float(spearmanr(scores, known.quality).statistic)
    if reply.verdicts is not None:
        row["verdicts"] = {
            name: {verdict: int((reply.verdicts[mask] == verdict).sum()) for verdict in VERDICTS}
            for name, mask in (("good", known.good), ("bad", known.bad))
        }
    if not (known.good.any() and known.bad.any()):
        return row, None
    won = wins(scores[known.good], scores[known.bad])
    draws = resampled_auroc(won, rng)
    row |= {"auroc": float(won.mean()), "auroc_ci95": interval(draws), "auroc_se": float(draws.std())}
    return row, draws


def wins(good: Array, bad: Array) -> Array:
    """1 where a good demonstration (G,) is scored above a bad one (B,), 1/2 where alike, (G, B); its mean is AUROC."""
    return (good[:, None] > bad) + 0.5 * (good[:, None] == bad)


def resampled_auroc(won: Array, rng: np.random.Generator) -> Array:
    """The AUROC of as many good and bad demonstrations, drawn again with replacement, (N_RESAMPLES,)."""
    good, bad = (rng.multinomial(size, np.full(size, 1 / size), N_RESAMPLES) / size for size in won.shape)
    return ((good @ won) * bad).sum(axis=1)


def interval(draws: Array) -> list[float]:
    return [float(end) for end in np.quantile(draws, [0.025, 0.975])]


def held_out_rows(
    name: str, replies: list[tuple[Job, Reply]], demonstrations: Demonstrations, known: Truth, seed: int
) -> list[Row]:
    """How well the held-out good demonstrations are predicted: accuracy, or R^2 where actions are continuous."""
    rows, draws = [], {}
    for trained_on, method in TRAINED_ON.items():
        folds = [(job.held_out, reply) for job, reply in replies if job.method == method and job.held_out is not None]
        if not folds:
            continue
        row: Row = {
            "set": name,
            "trained_on": trained_on,
            "measure": "accuracy" if demonstrations.is_discrete else "R²",
        }
        said = next((reply.said for _, reply in folds if reply.said), None)
        row |= {"said": said, "mean": None, "ci95": None, "gain": None, "gain_ci95": None}
        if said is None:
            loss, scale = losses(folds, demonstrations, known.good)
            counts = stream(seed, name).multinomial(len(loss), np.full(len(loss), 1 / len(loss)), N_RESAMPLES)
            draws[trained_on] = 1 - (counts @ loss) / (counts @ scale)
            row |= {"mean": float(1 - loss.sum() / scale.sum()), "ci95": interval(draws[trained_on])}
            if trained_on != "all" and "all" in draws:  # the same resamples, so the difference is of pairs
                row["gain"] = row["mean"] - rows[0]["mean"]
                row["gain_ci95"] = interval(draws[trained_on] - draws["all"])
        rows.append(row)
    return rows


def losses(folds: list[tuple[Array, Reply]], demonstrations: Demonstrations, good: Array) -> tuple[Array, Array]:
    """What predictions miss of each good demonstration, (G,), and what there is to miss, (G,): steps, or squares about
    the mean action."""
    loss, scale = np.zeros((2, len(demonstrations)))
    center = None if demonstrations.is_discrete else demonstrations.select(good).actions.mean(axis=0)
    for held_out, reply in folds:
        taken = demonstrations.select(held_out)
        for m, steps in zip(held_out, np.split(np.arange(taken.n_steps), taken.offsets[1:-1]), strict=True):
            actions, predicted = taken.actions[steps], reply.predicted[steps]
            if center is None:
                loss[m], scale[m] = (actions != predicted).sum(), len(actions)
            else:
                loss[m], scale[m] = ((actions - predicted) ** 2).sum(), ((actions - center) ** 2).sum()
    return loss[good], scale[good]


def counted(sets: Row) -> list[str]:
    """The data sets that the mean AUROC is over: discrete, with bad ones."""
    return [name for name, of in sets.items() if of["discrete"] and of["good"] and of["bad"]]


def mean_aurocs(ranked: list[Row], draws: dict[tuple[str, str], Array | None], sets: Row) -> Row:
    """For each method its mean AUROC over data sets, None where one is missing, and how far ours is ahead."""
    names = counted(sets)
    means: Row = {}
    resampled = {}
    for method in dict.fromkeys(row["method"] for row in ranked):
        found = [row["auroc"] for row in ranked if row["method"] == method and row["set"] in names]
        means[method] = {"mean": None, "se": None, "ours_ahead": None, "ours_ahead_ci95": None}
        if names and len(found) == len(names) and None not in found:
            resampled[method] = np.mean([draws[name, method] for name in names], axis=0)
            means[method] |= {"mean": float(np.mean(found)), "se": float(resampled[method].std())}
    for method in set(resampled) - {OURS} if OURS in resampled else ():
        means[method]["ours_ahead"] = means[OURS]["mean"] - means[method]["mean"]
        means[method]["ours_ahead_ci95"] = interval(resampled[OURS] - resampled[method])
    return means


def quick_data(directory: Path, seed: int) -> None:
    """Two small data sets of Mountain Car in the layout of the real ones."""
    for kind in ("corrupted", "noisy"):
        made = simulate("MountainCar-v0", kind, n_good=6, n_bad=6, seed=seed)
        known = {"is_good": made.is_good, "episode_quality": made.is_good.astype(float)}
        formats.write(directory / f"mountaincar_{kind}.npz", Demonstrations.from_episodes(made.episodes), known)


if __name__ == "__main__":
    raise SystemExit(main())
