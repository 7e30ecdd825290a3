"""Methods that rank demonstrations, written from their papers; `PEERS[name]` is a module.

Each has ``score(made, answers, seed) -> (M,)``, higher is better. A method that weighs steps has ``weights(made,
answers, seed) -> (N,)`` besides, and one that changes actions ``corrected(made, answers, seed) -> Demonstrations``. One
that learns from answers says how many in ``N_ANSWERS``. `NotMadeForIt` says why there is no score. None but the
oracle reads the truth.
"""

from __future__ import annotations

from types import ModuleType

from . import (
    bcnd,
    counter_bc,
    cupid,
    deminf,
    everything,
    few_shot,
    forest,
    ileed,
    length,
    oracle,
    psd,
    qoq,
    random_share,
    sal,
    success,
)
from .common import NotMadeForIt

__all__ = ["ALL", "ORACLE", "PEERS", "NotMadeForIt"]

ALL, ORACLE = "all", "oracle"
PEERS: dict[str, ModuleType] = {
    ALL: everything,
    "random 60 %": random_share,
    "length alone": length,
    "success flag": success,
    "isolation forest": forest,
    "few-shot regression": few_shot,
    "DemInf": deminf,
    "CUPID's formula": cupid,
    "QoQ": qoq,
    "SAL": sal,
    "PSD": psd,
    "ILEED": ileed,
    "BCND": bcnd,
    "Counter-BC": counter_bc,
    ORACLE: oracle,
}
