"""HDF5 with a group for each demonstration: ``data/demo_i`` of robomimic, robosuite and Isaac Lab, or at the top."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.json_files import object_in
from rpil.data.names import is_observation, natural_key
from rpil.formats import hdf5
from rpil.formats.array_layout import ACTIONS, first, n_actions
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import commas
from rpil.formats.format import StepTables, kept_of
from rpil.formats.step_arrays import NOT_IN_FIRST, Closed, Part, StoredArray, from_parts
from rpil.formats.table_facts import Metadata

if TYPE_CHECKING:
    import h5py

_STEPS_OF_TIME = 10
_GROUP_NAME = "name of the group"
_STATES = (
    "There are no observations (obs): the states of the simulator are used; robomimic's dataset_states_to_obs.py "
    "writes observations."
)


def fits(file: h5py.File) -> bool:
    """Whether there is a group with actions in ``data``, or at the top of the file."""
    return next(_with_actions(file), None) is not None


def read(path: Path, options: ColumnOptions) -> StepTables:
    """Read the arrays that the first group has; images and what describes a demonstration as a whole are ignored."""
    with hdf5.opened(path) as file:
        found, settings = dict(_with_actions(file)), _settings(file)
        in_first = next(iter(found.values()))
        parts = [
            Part(n_actions(arrays), arrays, {_GROUP_NAME: name, **_task(arrays.group, settings)})
            for name, arrays in found.items()
        ]
        in_data = _parent(file) != file
        first_paths, *more = (arrays.paths() for arrays in found.values())
        ignored = dict.fromkeys(sorted(set().union(*more) - first_paths, key=natural_key), NOT_IN_FIRST)
        notes, names = in_first.notes, {}
        if "states" in in_first and not options.observations and not any(map(is_observation, in_first)):
            notes = (*notes, _STATES)
            if _begins_with_time(states := in_first["states"]):
                names = {"states": tuple(map(str, range(1, states.shape[1])))}
                ignored["states.0"] = "simulation time"
                for arrays in found.values():
                    arrays.replace("states", _without_time)
        if in_data and len(found) < len(_parent(file)):
            without = commas([name for name in sorted(_parent(file), key=natural_key) if name not in found])
            notes = (*notes, f"Left out, because they are links, or hold no actions: {without}.")
        format_name = "HDF5 of robomimic's layout" if in_data else "HDF5, a group for each demonstration"
        metadata = Metadata(fps=_steps_a_second(settings), names=names, lengths=_stated_lengths(found))
        return from_parts(parts, _GROUP_NAME, path.name, format_name, options, metadata, notes).with_ignored(ignored)


def _begins_with_time(states: h5py.Dataset) -> bool:
    """Whether the first of the numbers of a state is the time of the simulator: it rises by the same at every step."""
    if states.ndim != 2 or states.shape[1] < 2 or states.dtype.kind != "f" or len(states) < _STEPS_OF_TIME:
        return False
    steps = np.diff(np.asarray(states[:_STEPS_OF_TIME])[:, 0])
    return bool(steps[0] > 0 and np.allclose(steps, steps[0], rtol=1e-3, atol=0))


def _without_time(states: StoredArray) -> StoredArray:
    """States without their first number."""
    shape = (*states.shape[:-1], max(states.shape[-1] - 1, 0))
    return Closed(shape, states.dtype, lambda rows: np.asarray(states[rows])[..., 1:])


def _stated_lengths(found: Mapping[str, hdf5.Arrays]) -> dict[Id, int]:
    """The steps that each demonstration says it has, in ``num_samples``, by the name of its group."""
    numbers = {name: arrays.group.attrs.get("num_samples") for name, arrays in found.items()}
    return {name: int(number) for name, number in numbers.items() if isinstance(number, int | np.integer)}


def keep(path: Path, output: Path, ids: Sequence[Id], options: ColumnOptions) -> None:
    """Write the demonstrations called `ids`, and all else of the file, to a new one; filter keys name no others."""
    with hdf5.copying(path, output) as (source, new):
        parent, found = _parent(source), {name: n_actions(arrays) for name, arrays in _with_actions(source)}
        names = kept_of(found, ids, path)
        dropped = found.keys() - names
        for name, member in hdf5.members(source).items():
            if member == parent:
                _copy_without(dropped, parent, new.create_group(name))
            elif parent != source or name not in dropped:
                source.copy(member, new, name)
        if "total" in parent.attrs:
            _parent(new).attrs["total"] = sum(found[name] for name in names)
        mask = new.require_group("mask") if "mask" in hdf5.groups(new) else {}
        for key in list(mask):
            listed_names = hdf5.Arrays(source["mask"]).get(key)  # by the name that an error says
            found_names = [] if listed_names is None else listed_names[()].tolist()
            del mask[key]
            if listed_names is not None:  # and no link, nor an array whose values are in another file
                mask[key] = np.array([name for name in found_names if name.decode() in names], dtype="S")


def _copy_without(dropped: Container[str], group: h5py.Group, new: h5py.Group) -> None:
    hdf5.copy_attributes(group, new)
    for name, member in hdf5.members(group).items():
        if name not in dropped:
            group.copy(member, new, name)


def _parent(file: h5py.File) -> h5py.Group:
    """The group of the demonstrations."""
    import h5py

    data = hdf5.member(file, "data") if "data" in list(file) else None
    return data if isinstance(data, h5py.Group) else file


def _with_actions(file: h5py.File) -> Iterator[tuple[str, hdf5.Arrays]]:
    """The groups that hold actions, in the order of their names; of very many, each is opened once."""
    import h5py

    parent = _parent(file)
    for name in sorted(parent, key=natural_key):
        group = hdf5.member(parent, name)
        if isinstance(group, h5py.Group) and first(arrays := hdf5.Arrays(group), ACTIONS):
            yield name, arrays


def _settings(file: h5py.File) -> Mapping[str, object]:
    """What the file says of the environment: its name, and how fast it runs."""
    parent = _parent(file)
    found = object_in(parent.attrs.get("env_args")) or object_in(parent.attrs.get("env_info"))
    more = found.get("env_kwargs")
    name = parent.attrs.get("env")
    return {
        **({"env_name": name} if isinstance(name, str) else {}),
        **(more if isinstance(more, dict) else {}),
        **found,
    }


def _task(group: h5py.Group, of_file: Mapping[str, object]) -> dict[str, str]:
    """The task of a demonstration, in words where it has some, or else the name of the environment."""
    about = object_in(group.attrs["ep_meta"]) if "ep_meta" in group.attrs else {}
    task = about.get("lang") or of_file.get("env_name")
    return {"task": task} if isinstance(task, str) and task else {}


def _steps_a_second(of_file: Mapping[str, object]) -> float | None:
    found = of_file.get("control_freq")
    return float(found) if isinstance(found, int | float) and math.isfinite(found) and found > 0 else None
