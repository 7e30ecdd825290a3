"""``rpil demo``: two bundled data sets, audited as a user would, and scored against truth that the audit never saw."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray
from scipy.stats import spearmanr

from rpil.audit.html.number_format import format_number, format_percent
from rpil.audit.html.page import Article, write_page
from rpil.audit.html.pictures import returns_figure, score_figure
from rpil.audit.record import Audit
from rpil.data import formats
from rpil.data.demonstrations import Demonstrations
from rpil.data.errors import DataError
from rpil.estimators.cloning import BehavioralCloning
from rpil.estimators.rpil import RPIL
from rpil.simulation.experts import expert
from rpil.simulation.rollouts import Returns, rollout

OVERCOOKED = "overcooked_cramped_room.npz"
LUNARLANDER = "lunarlander_corrupted.npz"
LANDER = "LunarLander-v3"

# One setting for every policy of the lander: what differs between them is the demonstrations alone. "auto" finds the
# same verdicts and as good policies, and takes five times as long.
_LANDER_FEATURES = "folded"
_N_RESAMPLES = 2000

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Overcooked:
    """How the audit of real people, which took `seconds`, agrees with the score `quality` (M,) it never saw.

    The AUROC by log-odds, with its bootstrap interval, and that by length, which learns nothing, are of the `n_scored`
    recordings that are clearly good or clearly bad; Spearman's rank correlation is over all.
    """

    audit: Audit
    seconds: float
    quality: NDArray[np.float64]
    n_scored: int
    auroc: float
    auroc_ci95: tuple[float, float]
    spearman: float
    auroc_of_length: float


@dataclass(frozen=True, eq=False)
class LunarLander:
    """What the verdicts are worth: returns of "trust_all", "rpil", "oracle" and "expert" on the same starts, and how
    many verdicts are wrong; "uncertain" is wrong too."""

    audit: Audit
    seconds: float
    returns: dict[str, Returns]
    wrong_verdicts: int


@dataclass(frozen=True, eq=False)
class Demo:
    """What `run` found."""

    overcooked: Overcooked
    lunarlander: LunarLander

    def to_dict(self) -> dict[str, Any]:
        """The figures, as ``rpil demo --json`` prints them."""
        people, lander = self.overcooked, self.lunarlander
        returns = {name: {"mean": found.mean, "ci95": list(found.ci95)} for name, found in lander.returns.items()}
        return {
            "overcooked": {"finding": people.audit.finding, "auroc": people.auroc, "spearman": people.spearman},
            "lunarlander": {"finding": lander.audit.finding, **returns, "wrong_verdicts": lander.wrong_verdicts},
        }

    def lines(self) -> list[str]:
        """A few sentences for the terminal."""
        people, lander = self.overcooked, self.lunarlander
        low, high = people.auroc_ci95
        names = {"trust_all": "trusting all", "rpil": "R-PIL", "oracle": "oracle", "expert": "expert"}
        returns = (
            f"{names[key]} {found.mean:.0f} ({found.ci95[0]:.0f} to {found.ci95[1]:.0f})"
            for key, found in lander.returns.items()
        )
        episodes = len(lander.returns["rpil"].returns)
        return [
            f"Overcooked, {len(people.quality)} real people: {people.audit.finding}. The ranking against a score it "
            f"never saw: AUROC {people.auroc:.2f} (95 % interval {low:.2f} to {high:.2f}, the best third against the "
            f"worst), Spearman {people.spearman:.2f}.",
            f"LunarLander, 10 expert and 10 corrupted demonstrations: {lander.audit.finding}. "
            f"{lander.wrong_verdicts} of {len(lander.audit.ids)} verdicts wrong.",
            f"Mean return over {episodes} landings (95 % interval): {', '.join(returns)}.",
        ]

    def write_report(self, path: str | os.PathLike[str]) -> None:
        """Write both audits and their scores to `path` as one self-contained HTML file."""
        write_page(
            path,
            [_overcooked_part(self.overcooked), _lunarlander_part(self.lunarlander)],
            title="rpil demo",
            headline="Which demonstrations can be trusted?",
            introduction="Two sets of demonstrations of unknown quality. R-PIL sees observations and actions, nothing "
            "else: no rewards, no scores, no labels. Afterwards its ranking and its verdicts are compared with the truth.",
        )


def run(*, episodes: int = 100, seed: int = 0, progress: Progress | None = None) -> Demo:
    """Audit both bundled data sets, learn from them, and score what was found in `episodes` landings of every policy.

    Raises
    ------
    DataError
        If `episodes` leave no interval.
    MissingExtraError
        If Gymnasium or its Box2D environments are not installed.
    """
    if episodes < 2:
        raise DataError(f"The demo needs two landings or more for an interval, not {episodes}: raise episodes.")
    told = progress or (lambda _: None)
    # The lander first: a missing Gymnasium shows at once.
    lunarlander = _lunarlander(episodes, seed, told)
    return Demo(_overcooked(seed, told), lunarlander)


def load(name: str) -> Demonstrations:
    """Bundled demonstrations, `OVERCOOKED` or `LUNARLANDER`: observations and actions, without the truth."""
    with as_file(files("rpil.cli") / "bundled" / name) as path:
        return formats.read(path)


def _truth(name: str, what: str) -> NDArray[Any]:
    """What is known about each bundled demonstration, (M,): for scoring alone."""
    with as_file(files("rpil.cli") / "bundled" / name) as path, np.load(path, allow_pickle=False) as stored:
        return stored[what]


def _audit(data: Demonstrations, features: str, seed: int, told: Progress, where: str) -> tuple[RPIL, float]:
    start = time.perf_counter()
    model = RPIL(features, random_state=seed, progress=lambda words: told(f"{where}: {words}")).fit(data)
    return model, time.perf_counter() - start


def _overcooked(seed: int, told: Progress) -> Overcooked:
    model, seconds = _audit(load(OVERCOOKED), "raw", seed, told, "Overcooked")  # its policy is not used
    audit = model.audit_
    quality, is_good = _truth(OVERCOOKED, "episode_quality"), _truth(OVERCOOKED, "is_good")
    low, high = np.quantile(_resampled_auroc(audit.log_odds, is_good, seed), [0.025, 0.975])
    return Overcooked(
        audit=audit,
        seconds=seconds,
        quality=quality,
        n_scored=int((is_good >= 0).sum()),
        auroc=float(_wins(audit.log_odds, is_good).mean()),
        auroc_ci95=(float(low), float(high)),
        spearman=float(spearmanr(audit.log_odds, quality).statistic),
        auroc_of_length=float(_wins(audit.lengths, is_good).mean()),
    )


def _wins(score: NDArray[Any], is_good: NDArray[Any]) -> NDArray[np.float64]:
    """Whether each good one beats each bad one, (n_good, n_bad), a tie counting half; the mean is the AUROC."""
    good, bad = score[is_good == 1, None], score[None, is_good == 0]
    return (good > bad) + 0.5 * (good == bad)


def _resampled_auroc(score: NDArray[Any], is_good: NDArray[Any], seed: int) -> NDArray[np.float64]:
    """The AUROC of bootstrap samples, drawn among the good and among the bad."""
    wins, rng = _wins(score, is_good), np.random.default_rng(seed)
    rows, columns = (rng.integers(n, size=(_N_RESAMPLES, n)) for n in wins.shape)
    return wins[rows[:, :, None], columns[:, None, :]].mean(axis=(1, 2))


def _lunarlander(episodes: int, seed: int, told: Progress) -> LunarLander:
    def play(policy: Any, name: str) -> Returns:
        def say(done: int, of: int) -> None:
            told(f"LunarLander: {name} lands, {done} of {of}")

        say(0, episodes)
        return rollout(policy, LANDER, n_episodes=episodes, seed=seed, progress=say)

    best = play(expert(LANDER), "the expert")
    data = load(LUNARLANDER)
    model, seconds = _audit(data, _LANDER_FEATURES, seed, told, "LunarLander")
    good = _truth(LUNARLANDER, "is_good") == 1
    trust_all = BehavioralCloning(_LANDER_FEATURES).fit(data)
    oracle = BehavioralCloning(_LANDER_FEATURES).fit(data.select(good))
    right = np.where(good, "expert", "adversary")
    return LunarLander(
        audit=model.audit_,
        seconds=seconds,
        returns={
            "trust_all": play(trust_all, "trusting all"),
            "rpil": play(model, "R-PIL"),
            "oracle": play(oracle, "the oracle"),
            "expert": best,
        },
        wrong_verdicts=int((np.array(model.audit_.verdicts) != right).sum()),
    )


def _paragraphs(*texts: str) -> Markup:
    return Markup("\n").join(Markup("<p>{}</p>").format(text) for text in texts)


def _beside(text: Markup, figure: Markup) -> Markup:
    return Markup('<div class="pair"><div>{}</div>{}</div>').format(text, figure)


# What to make of the verdicts on people: where they were not told apart, and where they were.
_VERDICTS = (
    "Where the scores are one group no player gets a verdict.",
    "“Adversary” means no more than: plays unlike that.",
)


def _overcooked_part(found: Overcooked) -> Article:
    low, high = found.auroc_ci95
    what = _paragraphs(
        f"{len(found.quality)} people played the kitchen game Overcooked in pairs, each steering one cook: fetch "
        "onions, fill the pot, serve the soup. A demonstration is what one player saw and pressed, without the moments "
        "in which nothing was pressed. The games come with Overcooked-AI (overcooked-ai 1.1.0, MIT licence).",
        "No bad demonstrations were planted here; some people played better than others. R-PIL ranks them by how well "
        "a policy of the players that agree best predicts what they press. "
        + _VERDICTS[found.audit.finding == "told apart"],
    )
    close = low <= found.auroc_of_length <= high
    agreement = _paragraphs(
        "The score is what a player got done: a point for each onion put into a pot, three for each soup fetched and "
        "three for each soup served.",
        "Take a player of the best third and one of the worst: the better one is ranked higher in "
        f"{format_percent(found.auroc)} of such pairs (AUROC {found.auroc:.2f}). These are {found.n_scored} people only: "
        f"95\u00a0% bootstrap interval {low:.2f} to {high:.2f}.",
        f"Over all {len(found.quality)} players the rank correlation (Spearman) is {found.spearman:.2f}.",
        f"For comparison: the number of steps alone has AUROC {found.auroc_of_length:.2f} here, because players who "
        f"press more keys get more done{': these data do not show which of the two ranks better' if close else ''}.",
    )
    return Article(
        title="Overcooked: real people",
        audit=found.audit,
        source="cramped_room",
        summary=f"{found.audit.finding.capitalize()}; the ranking against a score it never saw: AUROC "
        f"{found.auroc:.2f} (95\u00a0% interval {low:.2f} to {high:.2f}).",
        sections=[
            ("What this is", what),
            (
                "Does the ranking agree with a score it never saw?",
                _beside(agreement, score_figure(found.audit, found.quality, "Score of the player")),
            ),
        ],
        seconds=found.seconds,
    )


# What is shown of each policy: its name, and what it learned from.
_POLICIES = {
    "trust_all": ("Trust all", "all 20 demonstrations, as behavioural cloning does"),
    "rpil": ("R-PIL", "all 20, each weighted by its trust"),
    "oracle": ("Oracle", "the 10 good demonstrations alone, known from the truth"),
    "expert": ("Expert", "nothing: the closed-form pilot itself"),
}


def _lunarlander_part(found: LunarLander) -> Article:
    size, wrong, episodes = len(found.audit.ids), found.wrong_verdicts, len(found.returns["rpil"].returns)
    all_, ours = found.returns["trust_all"].mean, found.returns["rpil"].mean
    verdicts = f"{wrong} of {size} verdicts are wrong (“uncertain” would count as wrong)"
    same = "; so R-PIL learns from the same ten demonstrations as the oracle" if wrong == 0 else ""
    what = _paragraphs(
        "A closed-form pilot flies the lunar lander 20 times. In ten of these demonstrations every recorded action is "
        "then replaced by one drawn at random. R-PIL is told neither which they are nor how many.",
    )
    worth = _paragraphs(
        f"Four policies fly from the same {episodes} starts, which are in none of the demonstrations; a return of 200 "
        "counts as solved. All that learn have the same features: they differ in the demonstrations that they trust.",
        f"{verdicts}{same}.",
    )
    rows = [(*_POLICIES[key], returns.mean, *returns.ci95) for key, returns in found.returns.items()]
    figure = returns_figure([(name, mean, low, high) for name, _, mean, low, high in rows])
    return Article(
        title="LunarLander: half of the demonstrations corrupted",
        audit=found.audit,
        source=LANDER,
        summary=f"{found.audit.finding.capitalize()}; {wrong} of {size} verdicts wrong. Mean return {format_number(ours)}, "
        f"against {format_number(all_)} when all are trusted.",
        sections=[("What this is", what), ("What trust is worth", _beside(worth, figure) + _returns_table(rows))],
        seconds=found.seconds,
    )


def _returns_table(rows: Sequence[tuple[str, str, float, float, float]]) -> Markup:
    """The figures behind the picture: name, what it learned from, mean, low and high end."""
    body = Markup("\n").join(
        Markup(
            '<tr><th scope="row">{}</th><td>{}</td><td class="right">{}</td><td class="right">{} to {}</td></tr>'
        ).format(name, source, *map(format_number, values))
        for name, source, *values in rows
    )
    head = Markup("").join(
        Markup('<th scope="col" class="{}"><div class="plain">{}</div></th>').format(side, name)
        for name, side in (("Policy", ""), ("Learned from", ""), ("Mean return", "right"), ("95 % interval", "right"))
    )
    return Markup('<div class="scroll"><table><thead><tr>{}</tr></thead><tbody>{}</tbody></table></div>').format(
        head, body
    )
