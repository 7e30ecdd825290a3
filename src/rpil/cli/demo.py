"""``rpil demo``: audits of two bundled data sets, compared with the truth, which the audits did not see."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from markupsafe import Markup
from scipy.stats import spearmanr

from rpil import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError, MissingExtraError
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from rpil.numerics.types import Array, Bool, Float, Shaped
from rpil.results.html.number_format import format_number
from rpil.results.html.page import Article, html_environment, write_page
from rpil.results.record import Audit
from rpil.results.view import About, make_view
from rpil.results.words import SIDES
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import Policy, Returns, rollout

OVERCOOKED, LUNARLANDER = "overcooked_cramped_room.npz", "lunarlander_corrupted.npz"
"""Files of the bundled data."""

LANDER_ENV = "LunarLander-v3"
LANDER_FEATURES = "folded"
"""Features of every policy of the lander, so that the policies differ in their demonstrations only. "auto" gives the
same verdicts and policies as good, and takes five times as long."""
N_RESAMPLES = 2000
"""Bootstrap samples for the interval of the AUROC."""

POLICY_NAMES = {"trust_all": "Trust all", "rpil": "R-PIL", "oracle": "Oracle", "expert": "Expert"}

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class OvercookedResult:
    """How the audit of real people agrees with a score that it did not see."""

    audit: Audit
    seconds: float  # duration of the audit
    quality: Float[Array, " M"]  # the score of each recording
    n_scored: int  # recordings in the best and in the worst third, from which the AUROCs are computed
    auroc: float  # by log-odds
    auroc_ci95: tuple[float, float]  # its bootstrap interval
    spearman: float  # rank correlation of the log-odds with the score of all recordings
    auroc_of_length: float  # by the number of steps


@dataclass(frozen=True, eq=False)
class LunarLanderResult:
    """The audit of corrupted demonstrations, and the returns of policies."""

    audit: Audit
    seconds: float  # duration of the audit
    returns: dict[str, Returns]  # of "trust_all", "rpil", "oracle" and "expert", from the same starts; or empty
    wrong_verdicts: int  # verdicts that are not the truth; "open" counts as wrong
    not_played: str = ""  # why there are no returns, and what to install

    def returns_sentence(self) -> str:
        """The mean return of each policy, or why there is none."""
        if self.not_played:
            return f"No policy has flown. {self.not_played}"
        returns = (
            f"{POLICY_NAMES[name]} {played.mean:.0f} ({played.ci95[0]:.0f} to {played.ci95[1]:.0f})"
            for name, played in self.returns.items()
        )
        episodes = len(self.returns["rpil"].returns)
        return f"Mean return over {episodes} landings (95 % interval): {', '.join(returns)}."


@dataclass(frozen=True, eq=False)
class DemoResult:
    """The results of both data sets."""

    overcooked: OvercookedResult
    lunarlander: LunarLanderResult

    def to_dict(self) -> dict[str, object]:
        """The numbers, as ``rpil demo --json`` prints them."""
        people, lander = self.overcooked, self.lunarlander
        returns = {name: {"mean": played.mean, "ci95": list(played.ci95)} for name, played in lander.returns.items()}
        return {
            "overcooked": {"finding": people.audit.finding, "auroc": people.auroc, "spearman": people.spearman},
            "lunarlander": {"finding": lander.audit.finding, **returns, "wrong_verdicts": lander.wrong_verdicts},
        }

    def sentences(self) -> list[str]:
        """The results as sentences for the terminal."""
        people, lander = self.overcooked, self.lunarlander
        low, high = people.auroc_ci95
        return [
            f"Overcooked, {len(people.quality)} real people: {people.audit.finding}. Agreement of the ranking with a "
            f"score that it did not see: AUROC {people.auroc:.2f} (95 % interval {low:.2f} to {high:.2f}, the best "
            f"third against the worst), Spearman {people.spearman:.2f}.",
            f"LunarLander, 10 expert and 10 corrupted demonstrations: {lander.audit.finding}. "
            f"{lander.wrong_verdicts} of {len(lander.audit.ids)} verdicts wrong.",
            lander.returns_sentence(),
        ]

    def write_report(self, path: str | os.PathLike[str]) -> None:
        """Write both audits and their comparison with the truth to `path` as one self-contained HTML file."""
        write_page(
            path,
            [_overcooked_article(self.overcooked), _lunarlander_article(self.lunarlander)],
            title="rpil demo",
            headline="Which demonstrations can be trusted?",
            introduction="Two sets of demonstrations of unknown quality. R-PIL sees only observations and actions: no "
            "rewards, no scores and no labels. Then its rankings and verdicts are compared with the truth.",
        )


def run(*, episodes: int = 100, seed: int = 0, progress: Progress | None = None) -> DemoResult:
    """Audit both bundled data sets, and play `episodes` landings with each policy.

    Where Gymnasium or its Box2D environments are not installed no landing is played. A `DataError` if there are fewer
    than two episodes, which give no interval.
    """
    if episodes < 2:
        raise DataError(f"The demo needs two landings or more for an interval, not {episodes}: raise episodes.")
    show = progress or (lambda _: None)
    return DemoResult(_run_overcooked(seed, show), _run_lunarlander(episodes, seed, show))


def load_demonstrations(name: str) -> Demonstrations:
    """Bundled demonstrations, `OVERCOOKED` or `LUNARLANDER`: observations and actions, without the truth."""
    with as_file(files("rpil.cli") / "bundled" / name) as path:
        return formats.read(path)


def load_truth(name: str, column: str) -> Shaped[Array, " M"]:
    """A column of the truth about bundled demonstrations, for the comparison only."""
    with as_file(files("rpil.cli") / "bundled" / name) as path, np.load(path, allow_pickle=False) as arrays:
        return np.asarray(arrays[column])


def _fit(data: Demonstrations, features: str, seed: int, progress: Progress, title: str) -> tuple[RPIL, float]:
    """`RPIL` fitted to `data`, and the duration in seconds."""
    start = time.perf_counter()
    model = RPIL(features, random_state=seed, progress=lambda stage: progress(f"{title}: {stage}")).fit(data)
    return model, time.perf_counter() - start


def _run_overcooked(seed: int, progress: Progress) -> OvercookedResult:
    model, seconds = _fit(load_demonstrations(OVERCOOKED), "raw", seed, progress, "Overcooked")
    audit = model.audit_
    quality, is_good = load_truth(OVERCOOKED, "episode_quality"), load_truth(OVERCOOKED, "is_good")
    low, high = np.quantile(_bootstrap_auroc(audit.log_odds, is_good, seed), [0.025, 0.975])
    return OvercookedResult(
        audit=audit,
        seconds=seconds,
        quality=quality,
        n_scored=int((is_good >= 0).sum()),
        auroc=float(_pair_order(audit.log_odds, is_good).mean()),
        auroc_ci95=(float(low), float(high)),
        spearman=float(spearmanr(audit.log_odds, quality).statistic),
        auroc_of_length=float(_pair_order(audit.lengths, is_good).mean()),
    )


def _pair_order(score: Array, is_good: Array) -> Float[Array, "good bad"]:
    """1 where a good demonstration has a higher score than a bad one, 1/2 for equal scores; the mean is the AUROC."""
    good, bad = score[is_good == 1, None], score[None, is_good == 0]
    return np.asarray((good > bad) + 0.5 * (good == bad))


def _bootstrap_auroc(score: Array, is_good: Array, seed: int) -> Float[Array, " samples"]:
    """The AUROC of bootstrap samples, drawn separately from the good and from the bad demonstrations."""
    order, rng = _pair_order(score, is_good), np.random.default_rng(seed)
    rows, columns = (rng.integers(n, size=(N_RESAMPLES, n)) for n in order.shape)
    return np.asarray(order[rows[:, :, None], columns[:, None, :]].mean(axis=(1, 2)))


def _run_lunarlander(episodes: int, seed: int, progress: Progress) -> LunarLanderResult:
    def play(policy: Policy, name: str) -> Returns:
        def show(done: int, total: int) -> None:
            progress(f"LunarLander: {POLICY_NAMES[name]} lands, {done} of {total}")

        show(0, episodes)
        return rollout(policy, LANDER_ENV, n_episodes=episodes, seed=seed, progress=show)

    data = load_demonstrations(LUNARLANDER)
    model, seconds = _fit(data, LANDER_FEATURES, seed, progress, "LunarLander")
    is_good: Bool[Array, " M"] = load_truth(LUNARLANDER, "is_good") == 1
    policies: dict[str, Policy] = {
        "trust_all": BehavioralCloning(LANDER_FEATURES).fit(data),
        "rpil": model,
        "oracle": BehavioralCloning(LANDER_FEATURES).fit(data.select(is_good)),
        "expert": expert(LANDER_ENV),
    }
    returns: dict[str, Returns] = {}
    not_played = ""
    try:
        returns = {name: play(policy, name) for name, policy in policies.items()}
    except MissingExtraError as error:
        not_played = str(error)
    sides = np.array([SIDES[verdict] for verdict in model.audit_.verdicts])
    wrong = int((sides != np.where(is_good, "upper", "lower")).sum())
    return LunarLanderResult(model.audit_, seconds, returns, wrong, not_played)


def _render_section(macro: str, *values: Any) -> Markup:
    """A macro of demo.html as HTML."""
    return Markup(getattr(html_environment("rpil.cli", ".").get_template("demo.html").module, macro)(*values))


def _overcooked_article(result: OvercookedResult) -> Article:
    low, high = result.auroc_ci95
    about = About("Overcooked: real people", "cramped_room", seconds=result.seconds)
    return Article(
        make_view(result.audit, about),
        summary=f"{result.audit.finding.capitalize()}; agreement of the ranking with a score that it did not see: "
        f"AUROC {result.auroc:.2f} (95\u00a0% interval {low:.2f} to {high:.2f}).",
        sections=[
            ("The data", _render_section("overcooked_data", result)),
            ("Does the ranking agree with an unseen score?", _render_section("overcooked_agreement", result)),
        ],
    )


def _lunarlander_article(result: LunarLanderResult) -> Article:
    summary = f"{result.audit.finding.capitalize()}; {result.wrong_verdicts} of {len(result.audit.ids)} verdicts wrong."
    if result.not_played:
        section = _render_section("lunarlander_not_played", result)
    else:
        means = {name: format_number(played.mean) for name, played in result.returns.items()}
        summary += f" Mean return {means['rpil']}, and {means['trust_all']} when all are trusted."
        section = _render_section("lunarlander_returns", result, POLICY_NAMES)
    about = About("LunarLander: half of the demonstrations corrupted", LANDER_ENV, seconds=result.seconds)
    return Article(
        make_view(result.audit, about),
        summary,
        sections=[
            ("The data", _render_section("lunarlander_data")),
            ("Returns of the policies", section),
        ],
    )
