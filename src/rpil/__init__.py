"""Robust probabilistic imitation learning: which demonstrations to trust, and a policy from those."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOME = {
    "AmbiguousWarning": "rpil.errors",
    "Audit": "rpil.audit",
    "BehavioralCloning": "rpil.cloning",
    "Confusion": "rpil.adversaries",
    "DataError": "rpil.errors",
    "Dataset": "rpil.formats.dataset",
    "DaskEngine": "rpil.engines",
    "Demonstrations": "rpil.demonstrations",
    "RMEnt": "rpil.rment",
    "RPIL": "rpil.estimators",
    "SoftmaxPolicy": "rpil.policies",
    "TorchPolicy": "rpil.policies.torch",
    "load": "rpil.persistence",
    "open_dataset": "rpil.formats.dataset",
    "read": "rpil.formats",
    "reweight": "rpil.reweighting",
    "rollout": "rpil.rollouts",
    "save": "rpil.persistence",
    "simulate": "rpil.simulation",
    "write": "rpil.formats",
}

__all__ = [
    "RPIL",
    "AmbiguousWarning",
    "Audit",
    "BehavioralCloning",
    "Confusion",
    "DaskEngine",
    "DataError",
    "Dataset",
    "Demonstrations",
    "RMEnt",
    "SoftmaxPolicy",
    "TorchPolicy",
    "__version__",
    "load",
    "open_dataset",
    "read",
    "reweight",
    "rollout",
    "save",
    "simulate",
    "write",
]

if TYPE_CHECKING:
    from rpil.adversaries import Confusion
    from rpil.audit import Audit
    from rpil.cloning import BehavioralCloning
    from rpil.demonstrations import Demonstrations
    from rpil.engines import DaskEngine
    from rpil.errors import AmbiguousWarning, DataError
    from rpil.estimators import RPIL
    from rpil.formats import read, write
    from rpil.formats.dataset import Dataset, open_dataset
    from rpil.persistence import load, save
    from rpil.policies import SoftmaxPolicy
    from rpil.policies.torch import TorchPolicy
    from rpil.reweighting import reweight
    from rpil.rment import RMEnt
    from rpil.rollouts import rollout
    from rpil.simulation import simulate


def __getattr__(name: str) -> Any:
    """Public names are imported at first use: scikit-learn takes a second that ``rpil --help`` does not have."""
    if name not in _HOME:
        raise AttributeError(f"module 'rpil' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
