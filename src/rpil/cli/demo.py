"""``rpil demo``: audits of two bundled data sets, compared with the truth, which the audits did not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import as_file, files

import numpy as np
from scipy.stats import bootstrap, spearmanr

from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import StrPath
from rpil.estimators.auditing import audit
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from rpil.numerics.types import Array, Float, Shaped
from rpil.results.html.page import write_page
from rpil.results.record import Audit
from rpil.results.view import About, make_view
from rpil.results.vocabulary import SIDES
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import Player, Returns, rollout

OVERCOOKED, LUNARLANDER = "overcooked_cramped_room.npz", "lunarlander_corrupted.npz"
"""Files of the bundled data."""

LANDER_ENV = "LunarLander-v3"
LANDER_FEATURES = "folded"
"""Features of every policy of the lander, so that the policies differ in their demonstrations only. "auto" gives the
same verdicts and policies as good, and takes five times as long."""

POLICY_NAMES = {"trust_all": "Trust all", "rpil": "R-PIL", "oracle": "Oracle", "expert": "Expert"}


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Both audits, beside the truth."""

    people: Audit
    """Of real people."""
    auroc: float
    """Of the log-odds, between the best and the worst third by a score."""
    auroc_ci95: tuple[float, float]
    """Its bootstrap interval."""
    spearman: float
    """Rank correlation of the log-odds with the score of all people."""
    lander: Audit
    wrong_verdicts: int
    """Corrupted demonstrations of the lander that are no outliers, and others that are."""
    returns: dict[str, Returns] = field(default_factory=dict)
    """Of the policies `POLICY_NAMES`, or empty."""
    not_played: str = ""
    """Why there are no returns, and what to install."""

    def sentences(self) -> list[str]:
        """The results for the terminal: of the people, of the lander, and of its policies."""
        low, high = self.auroc_ci95
        flown = f"No policy has flown. {self.not_played}"
        if self.returns:
            means = (
                f"{POLICY_NAMES[name]} {played.mean:.0f} ({played.ci95[0]:.0f} to {played.ci95[1]:.0f})"
                for name, played in self.returns.items()
            )
            n_episodes = len(self.returns["rpil"].returns)
            flown = f"Mean return over {n_episodes} landings (95 % interval): {', '.join(means)}."
        return [
            f"Overcooked, {len(self.people.ids)} real people: {self.people.finding}. Agreement of the ranking with a "
            f"score that it did not see: AUROC {self.auroc:.2f} (95 % interval {low:.2f} to {high:.2f}, the best "
            f"third against the worst), Spearman {self.spearman:.2f}.",
            f"LunarLander, 10 expert and 10 corrupted demonstrations: {self.lander.finding}. "
            f"{self.wrong_verdicts} of {len(self.lander.ids)} verdicts wrong.",
            flown,
        ]

    def write_report(self, path: StrPath) -> None:
        """Write the audit of the people, and both comparisons with the truth, to `path` as one HTML file."""
        people, lander, flown = self.sentences()
        sections = ("Compared with the truth", people), ("A second set", lander), ("Returns of the policies", flown)
        write_page(path, make_view(self.people, About("Overcooked: real people", "cramped_room")), sections)


def run(*, episodes: int = 100, seed: int = 0, progress: Callable[[str], None] = lambda _: None) -> DemoResult:
    """Audit both bundled data sets, and play `episodes` landings with each policy.

    Where Gymnasium or its Box2D environments are not installed no landing is played. A `DataError` if there are fewer
    than two episodes, which give no interval.
    """
    if episodes < 2:
        raise DataError(f"The demo needs two landings or more for an interval, not {episodes}: raise episodes.")

    def shown(name: str) -> Callable[[str], None]:
        return lambda stage: progress(f"{name}: {stage}")

    people = audit(load_demonstrations(OVERCOOKED), random_state=seed, progress=shown("Overcooked"))
    is_better = load_truth(OVERCOOKED, "is_good")
    sides = people.log_odds[is_better == 1], people.log_odds[is_better == 0]
    rng = np.random.default_rng(seed)
    interval = bootstrap(sides, auroc, method="percentile", random_state=rng)
    data = load_demonstrations(LUNARLANDER)
    model = RPIL(LANDER_FEATURES, random_state=seed, progress=shown("LunarLander")).fit(data)
    is_good = load_truth(LUNARLANDER, "is_good") == 1
    policies: dict[str, Player] = {
        "trust_all": BehavioralCloning(LANDER_FEATURES).fit(data),
        "rpil": model,
        "oracle": BehavioralCloning(LANDER_FEATURES).fit(data.select(is_good)),
        "expert": expert(LANDER_ENV),
    }
    returns: dict[str, Returns] = {}
    not_played = ""
    try:
        for name, policy in policies.items():
            lands = f"LunarLander: {POLICY_NAMES[name]} lands"

            def count(done: int, total: int, lands: str = lands) -> None:
                progress(f"{lands}, {done} of {total}")

            returns[name] = rollout(policy, LANDER_ENV, n_episodes=episodes, seed=seed, progress=count)
    except MissingExtraError as error:
        not_played = str(error)
    verdicts = np.array([SIDES[verdict] for verdict in model.audit_.verdicts])
    return DemoResult(
        people=people,
        auroc=float(auroc(*sides)),
        auroc_ci95=(float(interval.confidence_interval.low), float(interval.confidence_interval.high)),
        spearman=float(spearmanr(people.log_odds, load_truth(OVERCOOKED, "episode_quality")).statistic),
        lander=model.audit_,
        wrong_verdicts=int(((verdicts == "lower") == (is_good > 0)).sum()),
        returns=returns,
        not_played=not_played,
    )


def load_demonstrations(name: str) -> Demonstrations:
    """Bundled demonstrations, `OVERCOOKED` or `LUNARLANDER`: observations and actions, without the truth."""
    with as_file(files("rpil.cli") / "bundled" / name) as path:
        return formats.read(path)


def load_truth(name: str, column: str) -> Shaped[Array, " M"]:
    """A column of the truth about bundled demonstrations, for the comparison only."""
    with as_file(files("rpil.cli") / "bundled" / name) as path, np.load(path, allow_pickle=False) as arrays:
        return np.asarray(arrays[column])


def auroc(good: Array, bad: Array, axis: int = -1) -> Float[Array, " *samples"]:
    """The share of pairs in which the good demonstration has the higher score, equal scores half; the last axis of
    `good` and `bad` is that of the demonstrations."""
    return np.asarray((0.5 + 0.5 * np.sign(good[..., :, None] - bad[..., None, :])).mean(axis=(-2, -1)))
