import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.formats.columns import ColumnOptions
from rpil.formats.recording import from_tables
from rpil.formats.step_arrays import Part, from_parts

RNG = np.random.default_rng(0)


def part(name, n_steps, **changes):
    arrays = {
        "obs/arm": RNG.normal(size=(n_steps, 2)).astype(np.float32),
        "obs/grip": RNG.normal(size=n_steps),
        "obs/camera": np.zeros((n_steps, 4, 4, 3), np.uint8),
        "obs/jpeg": np.zeros((n_steps, 50), np.uint8),
        "actions": RNG.normal(size=(n_steps, 3)),
        "rewards": np.zeros(n_steps),
    }
    return Part(n_steps, arrays | changes, {"demo": name, "task": f"task of {name[0]}"})


def recording(parts):
    return from_tables(from_parts(parts, "demo", "toy.hdf5", "toy", ColumnOptions()))


def test_other_types_are_read_as_they_are():
    codes = np.array([3, 1, 3, 1, 2], ">i4")
    halves = np.array([0.5, 1, 2, 3, 4], np.float16)
    who = np.array([b"Ann"] * 5)
    one = part("a", 5, **{"actions": codes, "obs/grip": halves, "operator": who})
    read = recording([one])
    assert read.demonstrations.actions.tolist() == [3, 1, 3, 1, 2]
    assert read.demonstrations.is_discrete
    np.testing.assert_array_equal(read.demonstrations.observations[:, 2], halves)
    assert read.operators == [("a", "Ann")]
    assert {*read.description.ignored} == {"obs/camera", "obs/jpeg", "rewards"}


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (part("b", 7, **{"obs/grip": np.zeros(3)}), r"demonstration 'b': 'obs/grip' has the shape \(3,\)"),
        (part("b", 7, **{"obs/arm": np.zeros((7, 3))}), r"demonstration 'b': 'obs/arm' has the shape \(7, 3\)"),
        (part("b", 7, **{"obs/arm": np.zeros((7, 2), complex)}), "'obs/arm' has .* complex128"),
        (Part(7, {"actions": np.zeros((7, 3))}, {"demo": "b", "task": ""}), "demonstration 'b': it has no 'obs/arm'"),
    ],
)
def test_a_demonstration_outliers_the_first_is_refused(second, message):
    with pytest.raises(DataError, match=message):
        recording([part("a", 5), second])


class Declared:
    """An array that may only be asked for its size."""

    shape, dtype = (5, 10**4), np.dtype(float)

    def __getitem__(self, rows):
        raise AssertionError("its values were read")


def test_declared_sizes_are_checked_before_values_are_read():
    parts = [part("a", 5, **{"obs/arm": Declared()})]
    with pytest.raises(DataError, match=r"toy.hdf5: .*memory"):
        from_parts(parts, "demo", "toy.hdf5", "toy", ColumnOptions(memory="100KB"))
