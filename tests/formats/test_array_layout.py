"""What says which steps are a demonstration, in NPZ and HDF5 alike."""

from __future__ import annotations

import numpy as np
import pytest

import rpil
from rpil.data.errors import DataError
from rpil.formats.array_layout import Arrays
from rpil.formats.registry import find
from samples import LENGTHS, MOVES, OWNERS, STATES, stacked

h5py = pytest.importorskip("h5py", reason="needs the extra hdf5")

N, M, T = len(OWNERS), len(LENGTHS), max(LENGTHS)
IS_LAST = np.isin(np.arange(N), np.cumsum(LENGTHS) - 1)
STEPS = {"observations": STATES, "actions": MOVES}
NO_ID = STEPS | {"episode_ids": np.where(IS_LAST, np.nan, 0)}

ROWS = {"obs": stacked(STATES), "actions": stacked(MOVES)}
EACH = "Each first index of the arrays is one demonstration"
TERMINALS, CUTS = IS_LAST & (OWNERS == 1), IS_LAST & (OWNERS != 1)
LAYOUTS = [
    ("Demonstrations end at dones.", {"obs": STATES, "acts": MOVES, "dones": IS_LAST}),
    ("end at dones.", {"expert_observations": STATES, "expert_actions": MOVES, "dones": IS_LAST}),
    ("end at dones.", STEPS | {"dones": IS_LAST.reshape(-1, 1)}),
    ("end at terminals and timeouts.", STEPS | {"terminals": TERMINALS, "timeouts": CUTS}),
    ("end at terminations and truncations.", STEPS | {"terminations": TERMINALS, "truncations": CUTS}),
    ("end at terminals alone: without timeouts, one that was", STEPS | {"terminals": IS_LAST.astype(float)}),
    ("begin at episode_starts.", STEPS | {"episode_starts": np.roll(IS_LAST, 1), "episode_returns": np.ones(M)}),
    ("are as long as episode_lengths says.", STEPS | {"episode_lengths": np.array(LENGTHS)}),
    (
        "There are no timeouts: demonstrations end at terminals, and where next_obs is not the following observation.",
        STEPS | {"next_obs": np.where(IS_LAST[:, None], 9, np.roll(STATES, -1, axis=0))},
    ),
    (f"{EACH}, as long as lengths says.", ROWS | {"lengths": np.array(LENGTHS)}),
    (f"{EACH}, as long as valid", {"states": ROWS["obs"], "acts": ROWS["actions"], "valid": stacked(OWNERS >= 0)}),
    (f"{EACH}, which ends at dones.", ROWS | {"dones": np.arange(T) == np.array(LENGTHS)[:, None] - 1}),
    (f"{EACH}, as long as", ROWS | {"obs": stacked(STATES, T + 1), "lengths": np.array(LENGTHS)}),
]

LONGER = np.array([30, 22, 30, 9, 17, 26, 12, 30, 21, 15])
"""Steps of demonstrations in arrays whose first index is the time."""


def time_first(noise=False):
    """Arrays (T, M, ...), and which rows of them are steps."""
    rng, shape = np.random.default_rng(0), (max(LONGER), len(LONGER))
    moves = rng.normal(size=(*shape, 2))
    is_step = np.arange(shape[0])[:, None] < LONGER
    seen = rng.normal(size=moves.shape) if noise else np.cumsum(moves, axis=0)
    return {"observations": seen * is_step[..., None], "actions": moves * is_step[..., None]}, is_step


def said_of_time_first():
    arrays, is_step = time_first()
    last = is_step & ~np.roll(is_step, -1, axis=0)
    last[-1] = is_step[-1]
    for noise in (False, True):
        yield f"mask {noise}", time_first(noise)[0] | {"mask": is_step.astype(float)}
    yield "mask of one column", arrays | {"mask": is_step[..., None]}
    yield "ends", arrays | {"dones": last}
    yield "lengths", arrays | {"lengths": LONGER}


SAID = dict(said_of_time_first())


@pytest.mark.parametrize("said", SAID)
def test_the_first_index_may_be_the_time(said, written):
    found = rpil.read(written(SAID[said]))
    assert found.lengths.tolist() == LONGER.tolist()
    for m, (seen, moves) in enumerate(found):
        np.testing.assert_array_equal(seen, SAID[said]["observations"][: LONGER[m], m])
        np.testing.assert_array_equal(moves, SAID[said]["actions"][: LONGER[m], m])


@pytest.fixture(params=[".npz", ".hdf5"])
def written(request, tmp_path):
    def write(arrays):
        path = tmp_path / f"steps{request.param}"
        if request.param == ".npz":
            np.savez(path, **arrays)
        else:
            with h5py.File(path, "w") as file:
                for name, array in arrays.items():
                    file[name] = array.astype("S") if array.dtype.kind == "U" else array
        return path

    return write


@pytest.mark.parametrize(("note", "arrays"), LAYOUTS)
def test_demonstrations_are_those_that_the_arrays_say(written, note, arrays, tmp_path):
    path = written(arrays)
    for on_disk in (False, True):
        recording = rpil.open(path, on_disk=on_disk)
        found = recording.demonstrations.select(slice(None))
        assert (found.ids, found.lengths.tolist()) == ((0, 1, 2), list(LENGTHS))
        np.testing.assert_array_equal(found.observations, STATES)
        np.testing.assert_array_equal(found.actions, MOVES)
        assert note in recording.description.notes[0]
    output = tmp_path / f"kept{path.suffix}"
    if layout := find(path).unkept():
        assert layout == "arrays of this layout"
        return
    find(path).keep(output, [2, 0])
    kept = rpil.read(output)
    np.testing.assert_array_equal(kept.observations, STATES[OWNERS != 1])
    np.testing.assert_array_equal(kept.actions, MOVES[OWNERS != 1])
    assert kept.lengths.tolist() == [LENGTHS[0], LENGTHS[2]]


def test_what_is_said_of_stacked_demonstrations_as_a_whole_is_known(written):
    about = {"episode_id": np.array([7, 5, 6]), "success": np.array([1.0, 0.0, 1.0]), "camera": np.zeros((2, 2))}
    recording = rpil.open(written(ROWS | {"lengths": np.array(LENGTHS)} | about), outcome="success")
    assert recording.demonstrations.ids == (7, 5, 6)
    assert recording.facts.outcomes[0].tolist() == [1, 0, 1]
    assert {"camera", "lengths", "success"} <= recording.description.ignored.keys()


def test_stacked_demonstrations_without_lengths_have_as_many_steps_each(written):
    recording = rpil.open(written(ROWS))
    assert recording.demonstrations.lengths.tolist() == [T] * M
    assert f"Each first index of the arrays is one demonstration of {T} steps." in recording.description.notes


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (STEPS | {"dones": IS_LAST[1:]}, rf"dones has the shape \({N - 1},\)"),
        (STEPS | {"episode_starts": np.array(["no"] * N, "S")}, "episode_starts has .* the type .S2"),
        (STEPS | {"terminals": np.zeros(N)}, "nothing says where demonstrations begin"),
        (STEPS | {"next_observations": np.ones((N, 2))}, "after 14 of 15 steps.* the order of the steps was lost"),
        (STEPS | {"next_obs": STATES[1:]}, r"next_obs has the shape \(14, 2\) and observations \(15, 2\)"),
        (ROWS | {"lengths": np.array([T, T + 1, 1])}, f"lengths must be 1 to {T} for each of {M} demonstrations"),
        (ROWS | {"mask": np.ones((M, T - 1))}, rf"mask has the shape \({M}, {T - 1}\) for actions of \({M}, {T}\)"),
        (ROWS | {"dones": np.eye(M, T) + np.eye(M, T, 2)}, "dones end more than one demonstration in .* first index 0"),
        ({"actions_0": STATES, "states_0": STATES}, "nothing says .*; add .*, or write a group with actions and obs"),
        (NO_ID, "row 4: demonstration ids must be whole numbers or text; fill in the missing"),
    ],
)
def test_arrays_that_do_not_fit_together_are_refused(written, arrays, message):
    with pytest.raises(DataError, match=rf"^steps\..*[:,] {message}"):
        rpil.read(written(arrays))


def test_a_value_that_is_missing_in_both_is_no_end():
    seen, following = np.arange(12.0).reshape(6, 2), np.arange(2.0, 14.0).reshape(6, 2)
    seen[2, 0] = following[1, 0] = np.nan
    following[3] = 99
    arrays = {"observations": seen, "next_observations": following, "actions": np.ones((6, 1))}
    assert Arrays(arrays, "gap.hdf5").cut().ids.tolist() == [0, 0, 0, 0, 1, 1]
    seen[2, 0] = 4.0
    assert Arrays(arrays, "gap.hdf5").cut().ids.tolist() == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize("asked", [None, "obs", "obs*"])
def test_numbers_of_an_observation_may_have_names(written, asked):
    arrays = {"obs": STATES, "actions": MOVES, "episode_ids": OWNERS}
    path = written(arrays | {"observation_names": np.array(["x", "y"])})
    assert rpil.read(path, **({"observations": asked} if asked else {})).observation_names == ("x", "y")
    path = written(arrays | {"obs": STATES[:, :1], "observation_names": np.array(["x"])})
    assert rpil.read(path).observation_names == ("x",)


def test_values_of_demonstrations_are_read_where_they_are_named(written):
    about = {"who": np.array(["c", "a", "b"]), "length": np.array([3.0, 1.0, 2.0])}
    path = written(STEPS | {"episode_ids": (2 - OWNERS).astype(np.float16)} | about)
    recording = rpil.open(path, operator="who")
    assert recording.operators == [("2", "c"), ("1", "a"), ("0", "b")]
    assert recording.description.ignored["length"] == "not one value for each step"
    assert rpil.open(path).operators == []
