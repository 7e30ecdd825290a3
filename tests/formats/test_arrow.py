from collections import UserList
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest

import rpil
from problems import make
from rpil.data.errors import DataError
from rpil.formats import table as flat

pd = pytest.importorskip("pandas")


FRAMES = {
    "pyarrow": lambda table: table,
    "pandas": pa.Table.to_pandas,
    "polars": lambda table: pytest.importorskip("polars", reason="needs polars").from_arrow(table),
    # Text as polars gives it to Arrow.
    "views": lambda table: table.set_column(0, table.column_names[0], table[0].cast(pa.string_view())),
}


@pytest.fixture(scope="module")
def problem():
    return make("random", 0, n_good=16, n_bad=8, steps=(10, 20))


@pytest.mark.parametrize("library", FRAMES)
def test_frames_are_read_as_files_are(library, problem):
    names = [f"demo {m}" for m in range(24)]
    given = rpil.Demonstrations(problem.observations, problem.actions, problem.offsets, names)
    frame = FRAMES[library](flat.from_demonstrations(given, {"is_good": np.arange(24) < 16}))
    read = rpil.read(frame)
    assert read.ids == given.ids
    np.testing.assert_array_equal(read.observations, given.observations)
    np.testing.assert_array_equal(read.actions, given.actions)
    first = rpil.read(frame, observations="observation.0", exclude="is_good")
    np.testing.assert_array_equal(first.observations, given.observations[:, :1])


def test_trajectories_are_read_and_frames_are_fitted(problem):
    trajectories = [
        SimpleNamespace(obs=np.vstack([seen, seen[-1]]), acts=acted)  # as those of imitation
        for seen, acted in rpil.Demonstrations(problem.observations, problem.actions, problem.offsets)
    ]
    np.testing.assert_array_equal(rpil.read(trajectories).observations, problem.observations)
    frame = flat.from_demonstrations(rpil.read(trajectories), {}).to_pandas()
    forms = (rpil.read(frame), frame, UserList(trajectories))  # the last as imitation loads them
    first, *others = (rpil.BehavioralCloning().fit(given).predict(problem.observations[:5]) for given in forms)
    np.testing.assert_array_equal(others, [first, first])
    with pytest.raises(DataError, match="trajectories have no columns to choose"):
        rpil.read(trajectories, id="episode")


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"obs_x": [1.0, 2.0], "action": [0, 1]}, "the frame: no column says which demonstration .* with split_gap=.$"),
        ({"episode": [0, 0], "obs_x": [object(), 1], "action": [0, 1]}, "the frame: a column holds values"),
        (
            pd.DataFrame([[0, 1.0, 2.0, 1]], columns=["episode", "x", "x", "action"]),
            "the frame: column 'x' appears twice",
        ),
    ],
)
def test_faults_of_frames_name_the_frame(columns, message):
    with pytest.raises(DataError, match=f"^{message}"):
        rpil.read(pd.DataFrame(columns))
