"""``rpil demo``: audits of two bundled data sets, compared with the truth, which the audits did not see."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
from rpil.results.html.page import About, write_page
from rpil.results.record import Audit
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
TITLES = "Compared with the truth", "A second set", "Returns of the policies"
"""Titles of the report's sections, one for each sentence."""


@dataclass(frozen=True, eq=False)
class DemoResult:
    """The audits of real people and of the lander, what compares them with the truth, and the returns of the policies
    `POLICY_NAMES`, if any has flown."""

    people: Audit
    lander: Audit
    sentences: tuple[str, ...]
    returns: dict[str, Returns]

    def write_report(self, path: StrPath) -> None:
        """Write the audit of the people, and all comparisons with the truth, to `path` as one HTML file."""
        about = About("Overcooked: real people", "cramped_room")
        write_page(path, self.people, about, tuple(zip(TITLES, self.sentences, strict=True)))


def run(*, episodes: int = 100, seed: int = 0, progress: Callable[[str], None] = lambda _: None) -> DemoResult:
    """Audit both bundled data sets, and play `episodes` landings with each policy.

    Where Gymnasium or its Box2D environments are not installed no landing is played. A `DataError` if there are fewer
    than two episodes, which give no interval.
    """
    if episodes < 2:
        raise DataError(f"The demo needs two landings or more for an interval, not {episodes}: raise episodes.")
    people = audit(load_demonstrations(OVERCOOKED), random_state=seed, progress=lambda s: progress(f"Overcooked: {s}"))
    is_better = load_truth(OVERCOOKED, "is_good")
    sides = people.log_odds[is_better == 1], people.log_odds[is_better == 0]
    interval = bootstrap(sides, auroc, method="percentile", random_state=np.random.default_rng(seed))
    low, high = interval.confidence_interval
    spearman = spearmanr(people.log_odds, load_truth(OVERCOOKED, "episode_quality")).statistic
    data, is_good = load_demonstrations(LUNARLANDER), load_truth(LUNARLANDER, "is_good") == 1
    model = RPIL(LANDER_FEATURES, random_state=seed, progress=lambda s: progress(f"LunarLander: {s}")).fit(data)
    n_wrong = sum((SIDES[word] == "lower") == good for word, good in zip(model.audit_.verdicts, is_good, strict=True))
    policies: dict[str, Player] = {
        "trust_all": BehavioralCloning(LANDER_FEATURES).fit(data),
        "rpil": model,
        "oracle": BehavioralCloning(LANDER_FEATURES).fit(data.select(is_good)),
        "expert": expert(LANDER_ENV),
    }
    returns, flown = fly(policies, episodes, seed, progress)
    sentences = (
        f"Overcooked, {len(people.ids)} real people: {people.finding}. Agreement of the ranking with a score that it "
        f"did not see: AUROC {auroc(*sides):.2f} (95 % interval {low:.2f} to {high:.2f}, the best third against the "
        f"worst), Spearman {spearman:.2f}.",
        f"LunarLander, 10 expert and 10 corrupted demonstrations: {model.audit_.finding}. "
        f"{n_wrong} of {len(is_good)} verdicts wrong.",
        flown,
    )
    return DemoResult(people, model.audit_, sentences, returns)


def fly(
    policies: dict[str, Player], episodes: int, seed: int, progress: Callable[[str], None]
) -> tuple[dict[str, Returns], str]:
    """The returns of each policy, and a sentence on their means; or nothing, and why."""

    def landings(name: str) -> Returns:
        def told(done: int, total: int) -> None:
            progress(f"LunarLander: {POLICY_NAMES[name]} lands, {done} of {total}")

        return rollout(policies[name], LANDER_ENV, n_episodes=episodes, seed=seed, progress=told)

    try:
        returns = {name: landings(name) for name in policies}
    except MissingExtraError as error:
        return {}, f"No policy has flown. {error}"
    intervals = ((POLICY_NAMES[name], one.mean, *one.ci95) for name, one in returns.items())
    means = ", ".join(f"{name} {mean:.0f} ({low:.0f} to {high:.0f})" for name, mean, low, high in intervals)
    return returns, f"Mean return over {episodes} landings (95 % interval): {means}."


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
