"""Tables 1-6: mean returns of policies from 10 good and 10 bad demonstrations, over draws of the data."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from threadpoolctl import threadpool_limits

from options import make_folder
from provenance import provenance
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.data.files import replacing
from rpil.numerics.parallel import in_processes
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import Returns, rollout
from rpil.simulation.simulate import simulate
from study.experiments import (
    ENVIRONMENTS,
    EXPERIMENTS,
    EXPERT,
    METHODS,
    N_BAD,
    N_GOOD,
    NAMES,
    ORACLE,
    OUR_FEATURES,
    RAW_ORACLE,
    Experiment,
    Method,
    raw_trust_all,
    trust_all,
)

PAPER_ROLLOUTS = 20
Row = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Reproduction:
    """What `run` found: for each table and draw of the data, in that order, returns of each policy, wrong verdicts and
    log-odds; what the draws of each table amount to; how many episodes each policy played."""

    draws: list[Row]
    tables: list[Row]
    rollouts: int

    def to_dict(self) -> dict[str, Any]:
        """Everything, as plain numbers and text."""
        seeds = [row["seed"] for row in self.draws]
        origin = provenance(f"{min(seeds)} to {max(seeds)}")
        how = {"rollouts": self.rollouts, "features": OUR_FEATURES, "provenance": origin}
        return how | {"tables": self.tables, "draws": self.draws}

    def text(self) -> str:
        """The tables for a terminal."""
        form = "{:30}{:>9}{:>17}{:>17}{:>9}{:>9}"
        blocks = [
            [_title(table, self.rollouts), *(form.format(*line) for line in _lines(table))] for table in self.tables
        ]
        return "\n\n".join(map("\n".join, blocks))

    def markdown(self) -> str:
        """The tables as Markdown, with what their columns mean."""
        parts = [f"# The paper's tables\n\n{LEGEND}\n"]
        for table in self.tables:
            rule = "|---|" + "---:|" * (len(HEAD) - 1)
            head, *body = ["| " + " | ".join(line) + " |" for line in _lines(table)]
            parts.append(f"## {_title(table, self.rollouts)}\n\n" + "\n".join([head, rule, *body]) + "\n")
        return "\n".join(parts)

    def write(self, folder: str | os.PathLike[str]) -> None:
        """Write ``tables.md`` to a folder, which is made where it is missing.

        Raises
        ------
        DataError
            Where that cannot be done.
        """
        with replacing(make_folder(folder) / "tables.md") as path:
            path.write_text(self.markdown(), encoding="utf-8")


def run(
    *,
    draws: int = 20,
    rollouts: int = 100,
    seed: int = 0,
    environments: Sequence[str] = ENVIRONMENTS,
    methods: Mapping[str, Method] = METHODS,
    processes: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Reproduction:
    """Make the paper's tables.

    Parameters
    ----------
    draws : int
        Of the data, 2 or more; draw k has the seed ``seed + k``, for the data and for the rollouts.
    rollouts : int
        Episodes for every policy of every draw, 2 or more; all policies of a draw start alike.
    seed : int
        Fixes everything.
    environments : sequence of str
        Those of `EXPERIMENTS`, or some of them.
    methods : mapping of name to `Method`
        What learns from the demonstrations; functions of a module, so that other processes find them.
    processes : int
        Other Python processes to share the work; 1 is none. The numbers do not depend on it.
    progress : callable, optional
        Called as ``progress(n_done, n)``, n being the draws of all environments.

    Raises
    ------
    DataError
        If there are too few draws or rollouts for an interval, or the paper has no such environment.
    MissingExtraError
        If Gymnasium or its Box2D environments are not installed.
    """
    for what, n in (("draws of the data", draws), ("rollouts", rollouts)):
        if n < 2:
            raise DataError(f"An interval needs two {what} or more, not {n}: raise their number.")
    for env_id in environments:
        if env_id not in ENVIRONMENTS:
            raise DataError(f"The paper has no environment {env_id!r}: choose from {', '.join(ENVIRONMENTS)}.")
    jobs = [(env_id, seed + draw, rollouts, dict(methods)) for draw in range(draws) for env_id in environments]
    done: list[list[Row]] = []
    if progress is not None:
        progress(0, len(jobs))
    for rows in in_processes(one_draw, jobs, processes):
        done.append(rows)
        if progress is not None:
            progress(len(done), len(jobs))
    found = sorted((row for rows in done for row in rows), key=lambda row: (row["table"], row["seed"]))
    asked = (experiment for experiment in EXPERIMENTS if experiment.env_id in environments)
    tables = [summary(one, [row for row in found if row["table"] == one.table]) for one in asked]
    return Reproduction(found, tables, rollouts)


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
                    "log_odds": {name: policy.log_odds_.tolist() for name, policy in judges.items()},
                    "is_good": good.tolist(),
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
            "worst": min(means),
            "best": max(means),
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


HEAD = ("policy", "paper", "the paper's way", "over draws", "worst", "wrong")
LEGEND = (
    "10 good and 10 bad demonstrations. *paper*: what the paper prints. *the paper's way*: 20 rollouts of one policy "
    "from one draw of the data, ± the 95 % interval over these rollouts. *over draws*: mean return over draws of the "
    "data, ± the 95 % interval over draws; *worst*: the worst draw. *wrong*: wrong verdicts on demonstrations, in all "
    "draws. The clean oracles learned from the good demonstrations alone; in brackets are a policy's features."
)


def _title(table: Row, rollouts: int) -> str:
    return (
        f"Table {table['table']}. {table['env']}, {table['kind']}: {table['draws']} draws, {rollouts} rollouts a policy"
    )


def _lines(table: Row) -> list[tuple[str, ...]]:
    """The cells of a table, as text, its head first."""

    def pair(value: Row) -> str:
        return f"{value['mean']:.1f} ± {value['half_width']:.1f}"

    body = (
        (
            NAMES.get(name, name),
            f"{found['printed']:.2f}" if "printed" in found else "",
            pair(found["paper_way"]),
            pair(found),
            f"{found['worst']:.1f}",
            f"{found['wrong']}/{table['verdicts']}" if "wrong" in found else "",
        )
        for name, found in table["policies"].items()
    )
    return [HEAD, *body]
