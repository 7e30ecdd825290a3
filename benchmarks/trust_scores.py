"""How a judge's answers agree with the truth: ranking, verdicts and probabilities, each with an interval."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit
from scipy.stats import binomtest, rankdata, spearmanr

from scoring import VERDICTS, auroc, interval, pair_wins, resampled_auroc, stream
from trust_peers import LENGTHENED, WITH_LENGTH, add_length

OURS = "rpil"
WITHOUT_LENGTH = "rpil without length"
SURE = 0.9
"""Probability from which the oracle of well-specified worlds gives a verdict."""

N_RESAMPLES = 1000

Array = NDArray[Any]
Row = dict[str, Any]


def measured(name: str, truth: Row, rows: dict[str, Row]) -> Row:
    """All figures of one world from the answers of some methods, by method."""
    good = np.array(truth["is_good"])
    quality = None if truth["quality"] is None else np.array(truth["quality"])
    found: Row = {"set": name, "family": truth["family"], "size": len(good), "ranking": {}}
    for method, scores in rankings(truth, rows).items():
        found["ranking"][method] = ranking(scores, good, quality, stream(0, name))
    found["said"] = {method: row["said"] for method, row in rows.items() if row.get("said")}
    found["failed"] = {method: row["error"] for method, row in rows.items() if row.get("error")}
    found["seconds"] = {method: row["seconds"] for method, row in rows.items()}
    ours = rows.get(OURS, {})
    if "verdicts" in ours:
        found |= {name: ours[name] for name in ("finding", "groups")}
        found |= judged(ours, good, stream(0, name))
        found |= beyond(truth, ours)
    return found


def rankings(truth: Row, rows: dict[str, Row]) -> dict[str, Array]:
    """The scores of every method, and those that arithmetic makes of them: with length, or ours without."""
    lengths, found = np.array(truth["lengths"]), {}
    for method, row in rows.items():
        if row.get("scores") is None:
            continue
        scores = found[method] = np.array(row["scores"], dtype=float)
        if method == OURS:
            found[WITHOUT_LENGTH] = scores - np.array(row["length"])
        if method in LENGTHENED:
            found[method + WITH_LENGTH] = add_length(scores, lengths)
    return found


# ---- ranking ---------------------------------------------------------------------------------------------------------


def ranking(scores: Array, good: Array, quality: Array | None, rng: np.random.Generator) -> Row:
    """AUROC of good against bad and Spearman's correlation with quality; None where there is nothing to compare."""
    found: Row = dict.fromkeys(("auroc", "auroc_ci95", "spearman", "spearman_ci95"))
    if {0, 1} <= set(good.tolist()):
        won = pair_wins(scores[good == 1], scores[good == 0])
        found |= {"auroc": float(won.mean()), "auroc_ci95": interval(resampled_auroc(won, rng))}
    if quality is not None and np.ptp(quality) > 0 and np.ptp(scores) > 0:
        draws = resampled_spearman(scores, quality, good, rng)
        found |= {"spearman": float(spearmanr(scores, quality).statistic), "spearman_ci95": interval(draws)}
    return found


def resampled_spearman(scores: Array, quality: Array, good: Array, rng: np.random.Generator) -> Array:
    """Of demonstrations drawn again with replacement, as many good, bad and in between; 0 where all are alike."""
    drawn = np.concatenate(
        [rng.choice(np.flatnonzero(good == k), (N_RESAMPLES, (good == k).sum())) for k in set(good)], 1
    )
    ranks = [rankdata(values[drawn], axis=1) for values in (scores, quality)]
    first, second = (rank - rank.mean(axis=1, keepdims=True) for rank in ranks)
    norm = np.sqrt((first**2).sum(axis=1) * (second**2).sum(axis=1))
    return np.divide((first * second).sum(axis=1), norm, out=np.zeros(len(norm)), where=norm > 0)


# ---- verdicts and probabilities --------------------------------------------------------------------------------------


def judged(row: Row, good: Array, rng: np.random.Generator) -> Row:
    """Verdicts against the truth, where it is known, and the Brier score of P(typical)."""
    verdicts, proba = np.array(row["verdicts"]), np.array(row["expert_proba"])
    counts = {
        name: {verdict: int(((good == kind) & (verdicts == verdict)).sum()) for verdict in VERDICTS}
        for name, kind in (("good", 1), ("bad", 0), ("between", -1))
    }
    wrong, given = right_and_wrong(verdicts, good)
    found: Row = {"verdicts": counts, "wrong": wrong, "given": given, "wrong_ci95": exact_interval(wrong, given)}
    found["answered"] = float((verdicts != "open").mean())
    known = good >= 0
    found |= {"brier": None, "brier_ci95": None, "base_rate_brier": None}
    if known.any():
        losses, share = (proba[known] - good[known]) ** 2, good[known].mean()
        found |= {"brier": float(losses.mean()), "base_rate_brier": float(share * (1 - share))}
        found["brier_ci95"] = interval(resampled_mean(losses, good[known], rng))
    return found


def right_and_wrong(verdicts: Array, good: Array) -> tuple[int, int]:
    """How many of the verdicts given are wrong, and how many are given, where the truth is known."""
    given = (verdicts != "open") & (good >= 0)
    wrong = given & ((verdicts == "typical") != (good == 1))
    return int(wrong.sum()), int(given.sum())


def exact_interval(some: int, of: int) -> list[float] | None:
    """Clopper and Pearson's 95 % interval for a share."""
    if not of:
        return None
    found = binomtest(some, of).proportion_ci(0.95, method="exact")
    return [float(found.low), float(found.high)]


def resampled_mean(values: Array, good: Array, rng: np.random.Generator) -> Array:
    """The mean over as many good and bad demonstrations, drawn again with replacement."""
    total = np.zeros(N_RESAMPLES)
    for kind in set(good.tolist()):
        own = values[good == kind]
        total += rng.multinomial(len(own), np.full(len(own), 1 / len(own)), N_RESAMPLES) @ own
    return total / len(values)


# ---- what more is known of generated worlds --------------------------------------------------------------------------


def beyond(truth: Row, ours: Row) -> Row:
    """Figures of worlds whose truth holds more than good and bad."""
    extra, good = truth["extra"], np.array(truth["is_good"])
    found: Row = {"extra": {key: value for key, value in extra.items() if not isinstance(value, list)}}
    if "style" in extra:
        found |= of_styles(extra, ours)
    if "oracle_log_ratio" in extra:
        found |= against_oracle(np.array(extra["oracle_log_ratio"]), ours, good)
    if extra.get("unknowable") and "labelled" in ours:
        labelled = ours["labelled"]
        asked = np.setdiff1d(np.arange(len(good)), [int(m) for m in labelled["labels"]])
        answers = {name: np.array(labelled[name])[asked] for name in ("scores", "verdicts", "expert_proba")}
        found["labelled"] = judged(answers, good[asked], np.random.default_rng(0))
        found["labelled"]["auroc"] = auroc(*by_kind(answers["scores"], good[asked]))
    return found


def by_kind(scores: Array, good: Array) -> tuple[Array, Array]:
    """Scores of the good, and of the bad."""
    return scores[good == 1], scores[good == 0]


def of_styles(extra: Row, ours: Row) -> Row:
    """Who is accused, whether a style is among the groups that are listed, and what one label makes of it.

    A group counts as a style where nine tenths of it are of that style, and at least half of the style is in it. The
    AUROC is between the styles, without the labelled; the oracle's is that of the true likelihood ratio.
    """
    style = np.array(extra["style"])
    listed = any(
        (style[group] == k).mean() >= 0.9 and (style[group] == k).sum() >= 0.5 * (style == k).sum()
        for group in ours["groups"]
        for k in (0, 1)
        if len(group)
    )
    found: Row = {
        "accused": ours["verdicts"].count("unlike"),
        "log_ratio": float(np.mean(extra["log_ratio"])),
        "groups_listed": len(ours["groups"]) > 0,
        "style_listed": bool(listed),
        "label_auroc": None,
        "oracle_auroc": None,
    }
    if "labelled" in ours:
        asked = np.setdiff1d(np.arange(len(style)), [int(m) for m in ours["labelled"]["labels"]])
        if len(set(style[asked])) == 2:
            for name, scores in (("label", ours["labelled"]["scores"]), ("oracle", extra["style_log_ratio"])):
                found[f"{name}_auroc"] = auroc(*by_kind(np.array(scores)[asked], style[asked] == 0))
    return found


def against_oracle(log_ratio: Array, ours: Row, good: Array) -> Row:
    """Correct verdicts of ours and of an oracle that knows the likelihood ratios, and the errors that ours expects."""
    known = expit(log_ratio)  # a prior of one half
    oracle = np.where(known >= SURE, "typical", np.where(known <= 1 - SURE, "unlike", "open"))
    wrong, given = right_and_wrong(oracle, good)
    verdicts, proba = np.array(ours["verdicts"]), np.array(ours["expert_proba"])
    ours_wrong, ours_given = right_and_wrong(verdicts, good)
    doubt = np.where(verdicts == "typical", 1 - proba, proba)[verdicts != "open"]
    return {
        "oracle_correct": given - wrong,
        "oracle_wrong": wrong,
        "correct": ours_given - ours_wrong,
        "wrong_expected": float(doubt.sum()),
    }
