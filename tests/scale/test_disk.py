"""The memory of a fit from disk does not grow with the data."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

# Not ru_maxrss: a child begins with that of its parent. One core: how many blocks several hold at once is chance.
MEASURE = """
import os, re, sys
from pathlib import Path
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from rpil.inference.settings import HeldOutSettings, JudgeSettings, PartSettings
from rpil.scale.settings import AscentSettings, SampleSettings
import rpil, rpil.estimators.rpil, rpil.formats.format, sklearn.preprocessing, pyarrow.parquet, pyarrow.fs

def peak():
    return 1024 * int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

before = peak()
data = rpil.open(sys.argv[1], on_disk=True).demonstrations
sample = SampleSettings(min_steps=5000, steps_per_coefficient=20, block_steps=8192)
ascent = AscentSettings(max_passes=1)
judge = JudgeSettings(held_out=HeldOutSettings(max_folds=2, ridges=(0.01,)), parts=PartSettings(max_steps=1000))
model = rpil.RPIL("raw", settings=rpil.Settings(sample=sample, ascent=ascent, judge=judge)).fit(data)
assert len(model.audit_.step_weight) == data.n_steps
print(peak() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the system does not say how much memory was taken")
def test_memory_does_not_grow_with_the_data(tmp_path):
    """Five times the steps in hardly more memory."""
    one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}  # each thread of BLAS has buffers of its own
    environment = os.environ | {"ARROW_DEFAULT_MEMORY_POOL": "system", "MALLOC_ARENA_MAX": "1"} | one_thread
    taken = [np.inf, np.inf]
    for n_steps in (60_000, 300_000):  # the first is judged as a whole; of the second a few blocks are in memory
        rng = np.random.default_rng(0)
        x = rng.standard_normal((n_steps, 40), dtype=np.float32)
        episode = np.arange(n_steps) // 500
        best = (x @ rng.normal(size=(40, 3)).astype(np.float32)).argmax(axis=1)
        columns = {"episode_index": episode, "action": np.where(episode % 3 == 0, rng.integers(3, size=n_steps), best)}
        table = pa.table(columns | {f"observation.{d}": x[:, d] for d in range(40)})
        # One row group: not even that may be in memory as a whole.
        path, coded = tmp_path / f"{n_steps}.parquet", ["episode_index", "action"]
        pq.write_table(table, path, row_group_size=n_steps, use_dictionary=coded)
    for _ in range(4):  # the system leaves pages of the file in memory, more in some runs: the least of all counts
        for k, path in enumerate((tmp_path / "60000.parquet", tmp_path / "300000.parquet")):
            command = [sys.executable, "-W", "ignore", "-c", MEASURE, str(path)]
            found = subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout
            taken[k] = min(taken[k], float(found))
        if taken[1] - taken[0] < 0.25 * 240_000 * 40 * 4:
            break
    assert 0 < taken[0] < 400e6  # what the judge reads, and the pages of forty columns
    assert taken[1] - taken[0] < 0.25 * 240_000 * 40 * 4
