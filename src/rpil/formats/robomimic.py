"""HDF5 with a group for each demonstration: ``data/demo_i`` of robomimic, robosuite and Isaac Lab, or at the top."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpil.data.arrays import Id
from rpil.data.errors import DataError
from rpil.data.files import StrPath, replacing
from rpil.data.id_values import check_ids
from rpil.data.names import is_observation
from rpil.formats import hdf5
from rpil.formats.columns import ColumnOptions
from rpil.formats.description import listed
from rpil.formats.format import Format, keep_by_own_ids
from rpil.formats.lerobot import Metadata
from rpil.formats.parts import Part, from_parts
from rpil.formats.recording import Recording

if TYPE_CHECKING:
    import h5py

MASK = "rpil_kept"
"""The filter key in ``mask`` under which `write_mask` lists demonstrations."""

_GROUP_NAME = "name of the group"
_STATES = (
    "There are no observations (obs): the states of the simulator are used; robomimic's dataset_states_to_obs.py "
    "writes observations."
)


def claims(path: Path) -> bool:
    """Whether there is a group with actions in ``data``, or at the top of the file."""
    return hdf5.has_layout(path, lambda file: bool(_demonstrations(file)))


def read(path: Path, options: ColumnOptions) -> Recording:
    """Read the arrays that the first group has; images and what describes a demonstration as a whole are ignored."""
    with hdf5.opened(path) as file:
        groups, found, settings = hdf5.groups(_parent(file)), _demonstrations(file), _settings(file)
        first = hdf5.contents(groups[next(iter(found))])
        parts = [
            Part(len(actions), hdf5.Arrays(groups[name]), {_GROUP_NAME: name, **_task(groups[name], settings)})
            for name, actions in found.items()
        ]
        in_data = _parent(file) != file
        notes = first.notes
        if "states" in first.arrays and not options.observations and not any(map(is_observation, first.arrays)):
            notes = (*notes, _STATES)
        if in_data and len(found) < len(groups):
            without = listed([name for name in groups if name not in found])
            notes = (*notes, f"Left out, because they hold no actions: {without}.")
        format_name = "HDF5 of robomimic's layout" if in_data else "HDF5, a group for each demonstration"
        metadata = Metadata(fps=_steps_a_second(settings), lengths=_stated_lengths(groups, found))
        return from_parts(parts, _GROUP_NAME, path.name, format_name, options, metadata, notes)


def _stated_lengths(groups: Mapping[str, h5py.Group], names: Iterable[str]) -> dict[Id, int]:
    """The steps that each demonstration says it has, in ``num_samples``, by the name of its group."""
    found = {name: groups[name].attrs.get("num_samples") for name in names}
    return {name: int(number) for name, number in found.items() if isinstance(number, int | np.integer)}


def keep(path: Path, output: Path, ids: Sequence[Id]) -> None:
    """Write the demonstrations called `ids`, and all else of the file, to a new one; filter keys name no others."""
    with hdf5.copying(path, output) as (source, new):
        names, parent, found = _checked(source, path, ids), _parent(source), _demonstrations(source)
        dropped = found.keys() - names
        for name, member in hdf5.members(source).items():
            if member == parent:
                _copy_without(dropped, parent, new.create_group(name))
            elif parent != source or name not in dropped:
                source.copy(member, new, name)
        if "total" in parent.attrs:
            _parent(new).attrs["total"] = sum(len(found[name]) for name in names)
        mask = new.require_group("mask") if "mask" in hdf5.groups(new) else {}
        for key in list(mask):
            listed_names = hdf5.array_at(mask, key)
            if listed_names is not None and listed_names.size > len(found):
                raise DataError(f"{path.name}: mask/{key} lists more names than there are demonstrations; repair it.")
            found_names = [] if listed_names is None else hdf5.load(listed_names, path.name).tolist()
            del mask[key]
            if listed_names is not None:  # and no link, nor an array whose values are in another file
                mask[key] = np.array([name for name in found_names if name.decode() in names], dtype="S")


def _copy_without(dropped: Container[str], group: h5py.Group, new: h5py.Group) -> None:
    hdf5.copy_attributes(group, new)
    for name, member in hdf5.members(group).items():
        if name not in dropped:
            group.copy(member, new, name)


def write_mask(path: StrPath, output: StrPath, ids: Sequence[Id]) -> None:
    """Write the file with one more filter key, ``mask/rpil_kept``, that lists `ids`, to `output`.

    `output` may be `path`: then the file is replaced by the copy, once that is whole. A `DataError` where an id is
    unknown, or the demonstrations are not in ``data``, where robomimic looks for them.
    """
    path, output = Path(path), Path(output)
    with hdf5.opened(path) as file:
        names = _checked(file, path, ids)
        is_free = "mask" not in list(file) or "mask" in hdf5.groups(file)
        if _parent(file) == file or not is_free:
            raise DataError(f"{path.name}: only demonstrations in data have filter keys, in mask; use keep.")
    with replacing(output) as temporary:
        shutil.copyfile(path, temporary)
        with hdf5.writing(temporary, output, "r+") as new:
            mask = new.require_group("mask")
            if MASK in list(mask):
                del mask[MASK]
            mask[MASK] = np.array(names, dtype="S")


def _checked(file: h5py.File, path: Path, ids: Sequence[Id]) -> list[str]:
    """The names of the demonstrations called `ids`, in the order of the file."""
    found = _demonstrations(file)
    check_ids(ids, found, path.name, "the ids")
    wanted = set(map(str, ids))
    return [name for name in found if name in wanted]


def _parent(file: h5py.File) -> h5py.Group:
    """The group of the demonstrations."""
    return hdf5.groups(file).get("data", file)


def _demonstrations(file: h5py.File) -> dict[str, h5py.Dataset]:
    """The actions of each demonstration, by the name of its group, with the numbers in names in order."""
    found = {name: hdf5.first_array(group, hdf5.ACTIONS) for name, group in hdf5.groups(_parent(file)).items()}
    return {name: actions for name, actions in found.items() if actions is not None}


def _settings(file: h5py.File) -> Mapping[str, object]:
    """What the file says of the environment: its name, and how fast it runs."""
    parent = _parent(file)
    found = _json_of(parent, "env_args") or _json_of(parent, "env_info")
    more = found.get("env_kwargs")
    name = parent.attrs.get("env")
    return {
        **({"env_name": name} if isinstance(name, str) else {}),
        **(more if isinstance(more, dict) else {}),
        **found,
    }


def _json_of(group: h5py.Group, name: str) -> dict[str, object]:
    """The object in an attribute that holds JSON; empty where there is none."""
    try:
        found = json.loads(group.attrs.get(name, ""))
    except (ValueError, TypeError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _task(group: h5py.Group, of_file: Mapping[str, object]) -> dict[str, str]:
    """The task of a demonstration, in words where it has some, or else the name of the environment."""
    task = _json_of(group, "ep_meta").get("lang") or of_file.get("env_name")
    return {"task": task} if isinstance(task, str) and task else {}


def _steps_a_second(of_file: Mapping[str, object]) -> float | None:
    found = of_file.get("control_freq")
    return float(found) if isinstance(found, int | float) and math.isfinite(found) and found > 0 else None


FORMAT = Format(
    name="HDF5 of robomimic",
    claims=claims,
    read=read,
    keep=keep_by_own_ids(keep),
    check_output=hdf5.check_output,
    mask=lambda path, ids: write_mask(path, path, ids),
)
