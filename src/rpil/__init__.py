"""Robust probabilistic imitation learning: which demonstrations to trust, and a policy from those."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False  # for type checkers it is true; typing itself takes longer to import than all else here

_HOME = {
    "Audit": "rpil.results.record",
    "BehavioralCloning": "rpil.estimators.cloning",
    "Confusion": "rpil.mixture.adversaries.discrete",
    "DataError": "rpil.data.errors",
    "Dataset": "rpil.formats.format",
    "DaskEngine": "rpil.scale.dask",
    "Demonstrations": "rpil.data.demonstrations",
    "RMEnt": "rpil.estimators.rment",
    "RPIL": "rpil.estimators.rpil",
    "Settings": "rpil.estimators.pipeline",
    "MixtureSettings": "rpil.mixture.settings",
    "JudgeSettings": "rpil.inference.settings",
    "SampleSettings": "rpil.scale.settings",
    "SoftmaxPolicy": "rpil.policies.softmax",
    "audit": "rpil.estimators.within_tasks",
    "check": "rpil.faults.checking",
    "idle_rows": "rpil.segments.ranges",
    "load": "rpil.estimators.persistence",
    "open": "rpil.formats",
    "read": "rpil.formats",
    "reweight": "rpil.estimators.reweight",
    "rollout": "rpil.simulation.rollouts",
    "save": "rpil.estimators.persistence",
    "simulate": "rpil.simulation.simulate",
    "write": "rpil.formats",
}

__all__ = [
    "RPIL",
    "Audit",
    "BehavioralCloning",
    "Confusion",
    "DaskEngine",
    "DataError",
    "Dataset",
    "Demonstrations",
    "JudgeSettings",
    "MixtureSettings",
    "RMEnt",
    "SampleSettings",
    "Settings",
    "SoftmaxPolicy",
    "__version__",
    "audit",
    "check",
    "idle_rows",
    "load",
    "open",
    "read",
    "reweight",
    "rollout",
    "save",
    "simulate",
    "write",
]

if TYPE_CHECKING:
    from typing import Any

    from rpil.data.demonstrations import Demonstrations
    from rpil.data.errors import DataError
    from rpil.estimators.cloning import BehavioralCloning
    from rpil.estimators.persistence import load, save
    from rpil.estimators.pipeline import Settings
    from rpil.estimators.reweight import reweight
    from rpil.estimators.rment import RMEnt
    from rpil.estimators.rpil import RPIL
    from rpil.estimators.within_tasks import audit
    from rpil.faults.checking import check
    from rpil.formats import open, read, write
    from rpil.formats.format import Dataset
    from rpil.inference.settings import JudgeSettings
    from rpil.mixture.adversaries.discrete import Confusion
    from rpil.mixture.settings import MixtureSettings
    from rpil.policies.softmax import SoftmaxPolicy
    from rpil.results.record import Audit
    from rpil.scale.dask import DaskEngine
    from rpil.scale.settings import SampleSettings
    from rpil.segments.ranges import idle_rows
    from rpil.simulation.rollouts import rollout
    from rpil.simulation.simulate import simulate


def __getattr__(name: str) -> Any:
    """Public names are imported at first use: scikit-learn takes a second that ``rpil --help`` does not have."""
    if name == "__version__":
        from importlib.metadata import version

        return version("rpil")
    if name not in _HOME:
        raise AttributeError(f"module 'rpil' has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
