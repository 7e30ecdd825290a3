"""Rows K to O: the whole default fit of recorded data, one cross-fit of scikit-learn beside, and of wide made data."""

from __future__ import annotations

import statistics
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression, Ridge
from sklearn.model_selection import GroupKFold
from threadpoolctl import threadpool_limits

import rpil
from rpil.data.demonstrations import Demonstrations
from rpil.data.formats.dataset import Dataset
from rpil.estimators.rpil import RPIL
from speed_data import wide_regression
from speed_timing import Measured, Skipped

N_FOLDS = 5


def default_fit(letter: str, path: Path | None, repeats: int) -> Measured | Skipped:
    """CPU seconds of `RPIL().fit`, those of reading included, and how many times those of the cross-fit they are."""
    if path is None or not path.exists():
        return Skipped("give the folder of recorded data with --data" if path is None else f"{path} is not there")
    with threadpool_limits(1, "blas"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        data, ours, theirs = opened(path), [], []
        data = data.select(slice(None)) if isinstance(data, Dataset) else data
        for _ in range(repeats):
            taken, model = cpu_seconds(lambda: RPIL().fit(opened(path)))
            ours.append(taken)
            design = model.judge_features_.design(data.observations)[:, :-1]
            theirs.append(cpu_seconds(lambda design=design: cross_fit(design, data))[0])
    seconds = {"ours": statistics.median(ours), "cross_fit": statistics.median(theirs)}
    values = {letter: seconds["ours"], f"{letter}_ratio": seconds["ours"] / seconds["cross_fit"]}
    details = {"cpu_seconds": seconds, "shape": list(design.shape), "finding": model.audit_.finding}
    return Measured(values, details)


def wide_fit(size: dict[str, int], repeats: int) -> Measured:
    """O: CPU seconds of `RPIL().fit` on observations with very many columns."""
    data = wide_regression(size["steps"], size["features"], size["actions"], size["demonstrations"]).demonstrations
    with threadpool_limits(1, "blas"):
        runs = [cpu_seconds(lambda: RPIL().fit(data)) for _ in range(repeats)]
    seconds = [taken for taken, _ in runs]
    return Measured({"O": statistics.median(seconds)}, {"cpu_seconds": seconds, "finding": runs[0][1].audit_.finding})


def opened(path: Path) -> Demonstrations | Dataset:
    """A file, or a folder of many."""
    return rpil.open_dataset(path) if path.is_dir() else rpil.read(path)


def cpu_seconds(run: Callable[[], Any]) -> tuple[float, Any]:
    """Processor seconds of all threads of this process, and what the run returns."""
    begun = time.process_time()
    answer = run()
    taken = time.process_time() - begun
    print(f"  {taken:.3g} s of CPU", file=sys.stderr, flush=True)
    return taken, answer


def cross_fit(design: NDArray[Any], data: Demonstrations) -> NDArray[Any]:
    """What five scikit-learn models say of the demonstrations that they were not fitted to."""
    actions = data.actions.reshape(len(data.actions), -1)
    discrete = actions.shape[1] == 1 and actions.dtype.kind in "iub"
    said = np.empty(len(design)) if discrete else np.empty(actions.shape)
    for teach, test in GroupKFold(N_FOLDS).split(design, groups=data.groups):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            if discrete:
                model = LogisticRegression(max_iter=1000).fit(design[teach], actions[teach, 0])
                said[test] = model.predict_log_proba(design[test]).max(axis=1)
            else:
                said[test] = Ridge().fit(design[teach], actions[teach]).predict(design[test]).reshape(len(test), -1)
    return said
