"""Tables 1-6: mean returns of policies from 10 good and 10 bad demonstrations, over draws of the data."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import starmap
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_limits

from rpil.data.demonstrations import Demonstrations
from rpil.simulation.rollouts import Returns, rollout
from rpil.simulation.simulate import expert, simulate
from study.experiments import (
    ENVIRONMENTS,
    EXPERIMENTS,
    EXPERT,
    METHODS,
    N_BAD,
    N_GOOD,
    ORACLE,
    OUR_FEATURES,
    OURS,
    RAW_ORACLE,
    RAW_TRUST_ALL,
    RECIPE,
    RM_ENT,
    Experiment,
    Method,
    raw_trust_all,
    trust_all,
)
from tables import and_list, bullets, by_column, table

PAPER_ROLLOUTS = 20
Row = dict[str, Any]


def run(
    *,
    draws: int = 20,
    rollouts: int = 100,
    seed: int = 0,
    environments: Sequence[str] = ENVIRONMENTS,
    methods: Mapping[str, Method] = METHODS,
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Row:
    """The paper's tables: of each draw of the data (draw k has the seed `seed` + k, also for the rollouts), and over
    draws. `progress` is called with the draws that are done and their number; no figure depends on `processes`."""
    jobs = [(env_id, seed + draw, rollouts, dict(methods)) for draw in range(draws) for env_id in environments]
    done: list[list[Row]] = []
    if progress is not None:
        progress(0, len(jobs))
    for rows in _results(one_draw, jobs, processes):
        done.append(rows)
        if progress is not None:
            progress(len(done), len(jobs))
    found = sorted((row for rows in done for row in rows), key=lambda row: (row["table"], row["seed"]))
    asked = (experiment for experiment in EXPERIMENTS if experiment.env_id in environments)
    tables = [summary(one, [row for row in found if row["table"] == one.table]) for one in asked]
    return {"rollouts": rollouts, "features": OUR_FEATURES, "tables": tables, "draws": found}


def _results(function: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], processes: int) -> Iterator[Any]:
    """``function(*job)`` of every job, in order."""
    if processes < 2:
        yield from starmap(function, jobs)
        return
    # Spawned, because a fork of a process with threads may hang.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(function, *zip(*jobs, strict=True))


def one_draw(env_id: str, seed: int, rollouts: int, methods: Mapping[str, Method]) -> list[Row]:
    """One draw of the data in one environment, for all kinds of bad demonstrations: the good ones are the same."""

    def play(policy: Any) -> Row:
        returns = rollout(policy, env_id, n_episodes=rollouts, seed=seed).returns
        return {"mean": float(returns.mean()), "paper_way": _interval(returns[:PAPER_ROLLOUTS])}

    rows: list[Row] = []
    common: dict[str, Row] = {}
    with warnings.catch_warnings(), threadpool_limits(1, "blas"):
        warnings.simplefilter("ignore", ConvergenceWarning)
        for experiment in (experiment for experiment in EXPERIMENTS if experiment.env_id == env_id):
            made = simulate(env_id, experiment.kind, n_good=N_GOOD, n_bad=N_BAD, seed=seed)
            demonstrations, good = Demonstrations.from_episodes(made.episodes), made.is_good == 1
            if not common:
                clean = demonstrations.select(good)
                common = {
                    EXPERT: play(expert(env_id)),
                    RAW_ORACLE: play(raw_trust_all(clean, experiment, seed)),
                    ORACLE: play(trust_all(clean, experiment, seed)),
                }
            learned = {name: method(demonstrations, experiment, seed) for name, method in methods.items()}
            learned = {name: policy for name, policy in learned.items() if policy is not None}
            judges = {name: policy for name, policy in learned.items() if hasattr(policy, "expert_proba_")}
            rows.append(
                {
                    "table": experiment.table,
                    "env": env_id,
                    "kind": experiment.kind,
                    "seed": seed,
                    "returns": common | {name: play(policy) for name, policy in learned.items()},
                    "wrong": {name: wrong(policy.expert_proba_, good) for name, policy in judges.items()},
                }
            )
    return rows


def wrong(expert_proba: Any, good: Any) -> int:
    """Demonstrations (M,) whose P(expert) is .5 or more from the truth; of a coin toss that is wrong too."""
    return int((np.abs(np.asarray(expert_proba) - good) >= 0.5).sum())


def _interval(values: Any) -> Row:
    """Mean and half-width of its 95 % t interval."""
    found = Returns.of(np.asarray(values, dtype=float))
    return {"mean": found.mean, "half_width": found.ci95[1] - found.mean}


def summary(experiment: Experiment, rows: Sequence[Row]) -> Row:
    """One table from its draws."""
    policies = {}
    oracles = (RAW_ORACLE, ORACLE)
    for name in (*(name for name in rows[0]["returns"] if name not in oracles), *oracles):
        played = [row["returns"][name] for row in rows]
        means = [one["mean"] for one in played]
        policies[name] = _interval(means) | {
            "paper_way": played[0]["paper_way"],
        }
        if name in experiment.printed:
            policies[name]["printed"] = experiment.printed[name]
        if name in rows[0]["wrong"]:
            policies[name]["wrong"] = sum(row["wrong"][name] for row in rows)
    return {
        "table": experiment.table,
        "env": experiment.env_id,
        "kind": experiment.kind,
        "draws": len(rows),
        "seeds": [row["seed"] for row in rows],
        "verdicts": len(rows) * (N_GOOD + N_BAD),
        "policies": policies,
    }


# ---- the section of the page ----------------------------------------------------------------------------------------

NOT_LEARNED = ("expert", "raw oracle", "oracle")
"""Policies that know the truth, or that are not fitted: they are not compared with the others."""


def markdown(result: Row) -> str:
    """The section of docs/results.md: policies over draws, then the paper's way of measuring beside what it prints."""
    tables = result["tables"]
    names = [f"{of['table']}. {of['env'].split('-')[0]} {of['kind']}" for of in tables]
    policies = list(dict.fromkeys(name for of in tables for name in of["policies"]))

    def cells(name: str, value: str | None) -> list[tuple[str, float | None]]:
        found = [of["policies"].get(name) for of in tables]
        found = [row if row is None or value is None else row[value] for row in found]
        plays = name not in NOT_LEARNED
        return [("–", None) if row is None else (plus_minus(row), row["mean"] if plays else None) for row in found]

    printed = {
        f"{name}, printed": [
            (f"{of['policies'].get(name, {}).get('printed', float('nan')):.2f}", None) for of in tables
        ]
        for name in policies
        if any("printed" in of["policies"].get(name, {}) for of in tables)
    }
    draws = and_list(sorted({str(of["draws"]) for of in tables}))
    verdicts = [
        f"Wrong verdicts of {name}: "
        + and_list(
            [f"{of['policies'][name]['wrong']} of {of['verdicts']} in table {of['table']}" for of in with_verdicts]
        )
        + "."
        for name in policies
        if (with_verdicts := [of for of in tables if "wrong" in of["policies"].get(name, {})])
    ]
    return "\n\n".join(
        [
            "## The paper's tables",
            f"`benchmarks/paper.py`: 10 good and 10 bad demonstrations, {draws} draws of the data, "
            f"{result['rollouts']} rollouts a policy, features `{result['features']}` where no others are named. Mean "
            "return ± half the 95 % interval over draws; the best of each column is bold, experts and oracles aside.",
            by_column(names, {name: cells(name, None) for name in policies}, digits=1),
            bullets([*behind_in_paper(tables), *verdicts]),
            "The same the paper's way: 20 rollouts of one policy from one draw, ± half the 95 % interval over "
            "rollouts. *Printed* is what the paper has.",
            by_column(names, printed | {name: cells(name, "paper_way") for name in policies}, digits=1),
        ]
    )


def compared(result: Row) -> str:
    """The table of docs/tutorials/baseline.md: what the paper prints beside ours, with half the 95 % interval."""
    columns = {
        "paper: R-PIL": (RECIPE, "printed"),
        "R-PIL": (OURS, ""),
        "RM-ENT": (RM_ENT, ""),
        "paper: LogReg": (RAW_TRUST_ALL, "printed"),
        "LogReg": (RAW_TRUST_ALL, ""),
        "oracle": (ORACLE, ""),
    }
    rows = []
    for of in result["tables"]:
        found = [(of["policies"].get(name), what) for name, what in columns.values()]
        cells = [("–" if one is None else f"{one[what]:.2f}" if what else plus_minus(one)) for one, what in found]
        rows.append([f"{of['table']}. {of['env'].split('-')[0]} {of['kind']}", *cells])
    return table(["table", *columns], rows)


def plus_minus(of: Row, digits: int = 1) -> str:
    return f"{of['mean']:.{digits}f} ± {of['half_width']:.{digits}f}"


def behind_in_paper(tables: Iterable[Row]) -> list[str]:
    """Methods above ours over draws, and tables in which the paper prints more."""
    lines = []
    for of in tables:
        policies = of["policies"]
        ours = policies[OURS]
        above = {name: row for name, row in policies.items() if name != "expert" and row["mean"] > ours["mean"]}
        better = [f"{name} {plus_minus(row)}" for name, row in sorted(above.items(), key=lambda of: -of[1]["mean"])]
        better += [
            f"the paper's print of {name} {row['printed']:.2f}"
            for name, row in policies.items()
            if row.get("printed", ours["mean"]) > ours["mean"]
        ]
        if better:
            where = f"Table {of['table']}, {of['env']} {of['kind']}"
            lines.append(f"{where}: above ours ({plus_minus(ours)}): {and_list(better)}.")
    return lines or ["No method is above ours in any table, the oracles included."]
