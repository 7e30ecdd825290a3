"""The goals that the figures of `trust.py` are held against; what was not measured is not met."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.stats import binomtest

from trust_peers import LENGTHENED, SINGLE, WITH_LENGTH
from trust_scores import OURS, WITHOUT_LENGTH
from trust_worlds import CONTINUOUS, FAMILIES

WITHOUT = tuple(name for name in SINGLE if name != "length")
"""Peers that do not look at the number of steps."""

ALL_PEERS = (*SINGLE, *(name + WITH_LENGTH for name in LENGTHENED))
NO_VERDICTS = ("two groups", "nobody stands out", "nothing could be learned")
N_CELLS, N_CONTINUOUS, CONTINUOUS_ASKED = 63, 45, 43
LOW = 0.05
"""Probability below which an excess of errors is no accident."""

Row = dict[str, Any]


def goals(sets: list[Row]) -> list[Row]:
    """Every goal with its figure, whether it is met (None: not measured), and the worlds that miss it."""
    real = [row for row in sets if row["family"] not in FAMILIES]
    by_family = {family: [row for row in sets if row["family"] == family] for family in FAMILIES}
    return [
        of_all(1, "an answer in every world", attempted(sets), lambda row: "verdicts" in row),
        *ranking_goals(real),
        *error_goals(sets, real, by_family["nothing"]),
        *proba_goals(sets, real),
        *style_goals([row for row in by_family["styles"] if "accused" in row]),
        *grid_goals(by_family["simulated"]),
        *power_goals([row for row in by_family["well-specified"] if "correct" in row]),
    ]


def goal(item: int, text: str, met: bool | None, figure: str = "", missed: Iterable[str] = ()) -> Row:
    met = None if met is None else bool(met)
    return {"item": item, "goal": text, "met": met, "figure": figure, "missed": list(missed)}


def of_all(item: int, text: str, asked: list[Row], passes: Callable[[Row], bool]) -> Row:
    """A goal that every one of some worlds has to meet."""
    missed = [row["set"] for row in asked if not passes(row)]
    return goal(item, text, not missed if asked else None, f"{len(asked) - len(missed)} of {len(asked)}", missed)


def auroc(row: Row, method: str) -> float | None:
    found = row["ranking"].get(method)
    return None if found is None else found["auroc"]


def best_peer(row: Row) -> float | None:
    """The highest AUROC of a peer that does not look at length."""
    return max((value for name in WITHOUT if (value := auroc(row, name)) is not None), default=None)


def attempted(rows: Iterable[Row]) -> list[Row]:
    """The worlds that ours has answered, or failed at."""
    return [row for row in rows if OURS in row["seconds"]]


def ranking_goals(real: list[Row]) -> list[Row]:
    asked = attempted(real)
    compared = [row for row in asked if best_peer(row) is not None]
    found = [
        of_all(
            1,
            "AUROC in each real set at least that of the best peer without length, less .05",
            compared,
            lambda row: (auroc(row, OURS) or 0.0) >= best_peer(row) - 0.05 - 1e-9,
        )
    ]
    ahead = {name: lead(compared, name) for name in ALL_PEERS if any(auroc(row, name) is not None for row in compared)}
    least = min(ahead, key=lambda name: ahead[name], default=None)
    text = "mean AUROC .02 above that of every peer, on the real sets that the peer answers"
    said = "" if least is None else f"{ahead[least]:+.3f} against {least}"
    found.append(goal(1, text, None if least is None else ahead[least] >= 0.02 - 1e-9, said))
    for method, least_mean, text in (
        (OURS, 0.88, "mean AUROC over real sets at least .88"),
        (WITHOUT_LENGTH, 0.85, "the same without length at least .85"),
    ):
        mean = np.mean([auroc(row, method) or 0.0 for row in asked]) if asked else None
        met = None if mean is None else bool(mean >= least_mean - 1e-9)
        found.append(goal(1, text, met, "" if mean is None else f"{mean:.3f}"))
    return found


def lead(rows: list[Row], peer: str) -> float:
    """How far our mean AUROC is above a peer's, where the peer has one; a failure of ours is worth nothing."""
    pairs = [(auroc(row, OURS) or 0.0, theirs) for row in rows if (theirs := auroc(row, peer)) is not None]
    ours, theirs = np.mean(pairs, axis=0)
    return float(ours - theirs)


def error_goals(sets: list[Row], real: list[Row], nothing: list[Row]) -> list[Row]:
    judged = [row for row in real if "wrong" in row]
    wrong, given = (sum(row[name] for row in judged) for name in ("wrong", "given"))
    everywhere = [row for row in sets if row.get("given") and auroc(row, OURS) is not None]
    return [
        of_all(
            2,
            "at most 10 % of the verdicts given wrong in each real set (exact test at 95 %)",
            judged,
            lambda row: not row["given"] or binomtest(row["wrong"], row["given"], 0.1, "greater").pvalue >= LOW,
        ),
        goal(
            2,
            "at most 5 % of the verdicts given wrong over all real sets",
            wrong <= 0.05 * given if judged else None,
            f"{wrong} of {given}",
        ),
        of_all(
            2,
            "no AUROC below .4 where verdicts are given, in any world",
            everywhere,
            lambda row: auroc(row, OURS) >= 0.4,
        ),
        of_all(
            2,
            "no verdict and a finding that says so where nothing can be learned",
            attempted(nothing),
            lambda row: row.get("finding") in NO_VERDICTS and not row["given"],
        ),
    ]


def proba_goals(sets: list[Row], real: list[Row]) -> list[Row]:
    scored = [row for row in sets if row.get("brier") is not None and row["family"] != "styles"]
    made = [row for row in scored if row not in real and not row["extra"].get("unknowable")]
    clear = [row for row in attempted(real) if (best_peer(row) or 0.0) >= 0.95]
    return [
        of_all(3, "Brier score no worse than the base rate's in each real set", in_real(scored), brier_holds),
        of_all(3, "the same in each generated world with good and bad that can be known", made, brier_holds),
        of_all(
            3,
            "a verdict for 60 % of the demonstrations in each real set where the best peer without length has an AUROC "
            "of .95",
            clear,
            lambda row: row.get("answered", 0.0) >= 0.6 - 1e-9,
        ),
    ]


def in_real(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row["family"] not in FAMILIES]


def brier_holds(row: Row) -> bool:
    return bool(row["brier"] <= row["base_rate_brier"] + 1e-9)


def style_goals(judged: list[Row]) -> list[Row]:
    accused, of = (sum(row[name] for row in judged) for name in ("accused", "size"))
    differ = [row for row in judged if row["log_ratio"] > 10]
    listed = [row for row in differ if row["style_listed"]]
    return [
        goal(
            4,
            "at most 2 % of the demonstrations accused in style worlds, where all are good",
            accused <= 0.02 * of if judged else None,
            f"{accused} of {of}",
            [row["set"] for row in judged if row["accused"] > 0.02 * row["size"]],
        ),
        goal(
            4,
            "a style is listed in 90 % of the worlds where styles differ by more than 10 nats a demonstration",
            len(listed) >= 0.9 * len(differ) if differ else None,
            f"{len(listed)} of {len(differ)}",
            [row["set"] for row in differ if not row["style_listed"]],
        ),
        of_all(
            4,
            "with one label an AUROC of .99 between those styles, where the true likelihood ratio has it",
            [row for row in differ if (row["oracle_auroc"] or 0.0) >= 0.99 - 1e-9],
            lambda row: row["label_auroc"] >= 0.99 - 1e-9,
        ),
    ]


# ---- the simulated grid ----------------------------------------------------------------------------------------------


def grid_goals(simulated: list[Row]) -> list[Row]:
    asked = attempted(simulated)
    grids = {
        continuous: {
            place: cell_met([row for row in asked if place_of(row) == place])
            for place in dict.fromkeys(map(place_of, asked))
            if (place.split()[0] in CONTINUOUS) == continuous
        }
        for continuous in (False, True)
    }
    final = [row.get("labelled", row) for row in asked if "verdicts" in row]
    wrong, given = (sum(row[name] for row in final) for name in ("wrong", "given"))
    cell = "AUROC .99, a word for 80 %, at most .5 % of them wrong; “two groups” where it cannot, and .99 with labels"
    return [
        cells_goal(f"all {N_CELLS} cells of the simulated grid ({cell})", grids[False], N_CELLS, N_CELLS),
        cells_goal(
            f"{CONTINUOUS_ASKED} of {N_CONTINUOUS} continuous cells", grids[True], N_CONTINUOUS, CONTINUOUS_ASKED
        ),
        goal(
            5,
            "at most 1 % of the verdicts given wrong in simulated worlds, with labels where it cannot be known",
            wrong <= 0.01 * given if final else None,
            f"{wrong} of {given}",
        ),
    ]


def cells_goal(text: str, met: dict[str, bool], size: int, asked: int) -> Row:
    """Met where enough cells are; None where that depends on those that were not measured."""
    right = sum(met.values())
    reached = True if right >= asked else (False if len(met) - right > size - asked else None)
    return goal(5, text, reached, f"{right} of {len(met)} measured", [name for name in met if not met[name]])


def place_of(row: Row) -> str:
    """Environment, kind and share, without the seed."""
    return row["set"].removeprefix("simulated ").rsplit(" ", 1)[0]


def cell_met(draws: list[Row]) -> bool:
    """Whether ranking and words are right over the draws of a cell; the ranking with labels, where they are needed."""
    if any("verdicts" not in row for row in draws):
        return False
    asked = draws[0]["extra"]["unknowable"]
    if asked:
        if any(row["finding"] != "two groups" for row in draws):
            return False
        draws = [row["labelled"] for row in draws]
    aurocs = [row["auroc"] if "auroc" in row else auroc(row, OURS) for row in draws]
    ranked = np.mean(aurocs) >= 0.99 - 1e-9
    if asked:
        return bool(ranked)
    given, wrong, of = np.sum([words_of(row["verdicts"]) for row in draws], axis=0)
    return bool(ranked and given >= 0.8 * of and wrong <= 0.005 * given)


def words_of(verdicts: Row) -> tuple[int, int, int]:
    """The number of demonstrations with a word, those with a wrong one, and all."""
    good, bad = verdicts["good"], verdicts["bad"]
    of = sum(good.values()) + sum(bad.values())
    given = of - good.get("open", 0) - bad.get("open", 0)
    return given, good.get("unlike", 0) + bad.get("typical", 0), of


# ---- worlds in which the model holds ---------------------------------------------------------------------------------


def power_goals(rows: list[Row]) -> list[Row]:
    sizes: dict[str, list[Row]] = {}
    for row in rows:
        sizes.setdefault(f"{row['size']} demonstrations of {row['extra']['steps']} steps", []).append(row)
    counts = {name: [sum(row[count] for row in own) for count in COUNTED] for name, own in sizes.items()}
    weak = {name: f"{ours} of {oracle}" for name, (ours, oracle, *_) in counts.items() if ours < 0.8 * oracle}
    unsound = {
        name: f"{wrong} of {given}, {expected:.1f} expected"
        for name, (_, _, wrong, given, expected) in counts.items()
        if given and binomtest(wrong, given, min(expected / given, 1.0), "greater").pvalue < LOW
    }
    texts = {
        "for each size 80 % of the correct verdicts of an oracle that knows the likelihood ratios": weak,
        "for each size no more of them wrong than P(typical) says (exact test at 95 %)": unsound,
    }
    return [
        goal(
            6,
            text,
            not missed if rows else None,
            f"{len(sizes) - len(missed)} of {len(sizes)}",
            (f"{name} ({figure})" for name, figure in missed.items()),
        )
        for text, missed in texts.items()
    ]


COUNTED = ("correct", "oracle_correct", "wrong", "given", "wrong_expected")
