"""Fitted estimators to a file and back, without pickle.

The file is a ZIP archive of plain ``.npy`` arrays, as `numpy.savez` makes it, and one ``header.json`` with all the
rest. A header is a tree: numbers and text stand for themselves; an array is named by its member of the archive; an
object is the name of a class in `rpil.schema.KNOWN` and its fields. `load` makes objects of those classes only, and
only where every array has the type and the shape that the class says.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray
from sklearn.utils.validation import check_is_fitted

from rpil import __version__
from rpil.cloning import BehavioralCloning
from rpil.demonstrations import Demonstrations
from rpil.errors import DataError
from rpil.estimators import RPIL
from rpil.features import FeatureMap
from rpil.files import StrPath, check_readable, replacing
from rpil.judge import FINDINGS
from rpil.rment import RMEnt
from rpil.schema import BY_NAME, ESTIMATORS, FITTED, FITTED_ARRAYS, KNOWN

SCHEMA = "rpil fitted estimator"
VERSION = 4

_HEADER = "header.json"
_STEPS = (np.float64, np.float32)  # the latter where there are very many
_TYPES: dict[str, tuple[type, ...]] = {"offsets": (np.int64,), "step_log_ratio": _STEPS, "step_weight": _STEPS}
_NAMES = ("feature_names_in_", "observation_names_")  # of data frames, and of `Demonstrations`


def save(estimator: RPIL | RMEnt | BehavioralCloning, path: StrPath) -> None:
    """Write a fitted estimator to a file of any name.

    All of it comes back, bit for bit, but for what only its own program can make: `progress`, `engine`, `checkpoint`.

    Parameters
    ----------
    estimator : RPIL, RMEnt or BehavioralCloning
    path : path

    Raises
    ------
    DataError
        Where it is another kind of estimator, its policy or adversary is of a class of the user's, or the path cannot
        be written; a file that was there stays as it was.
    """
    kind = type(estimator).__name__
    if ESTIMATORS.get(kind) is not type(estimator):
        raise DataError(f"{path}: a {kind} cannot be saved; save one of {', '.join(ESTIMATORS)}.")
    check_is_fitted(estimator)
    if type(estimator.policy_) not in KNOWN:
        made_of = getattr(estimator.policy_, "estimator", estimator.policy_)
        raise DataError(
            f"{path}: a policy made of a {type(made_of).__name__} cannot be saved without pickle; "
            "keep the weights (rpil audit --weights, or audit_.step_weight) and fit it to them again."
        )
    arrays: dict[str, NDArray[Any]] = {}
    header = {
        "schema": SCHEMA,
        "version": VERSION,
        "rpil": __version__,
        "class": kind,
        "names": {name: [*map(str, getattr(estimator, name))] for name in _NAMES if len(getattr(estimator, name, ()))},
        "params": _params(estimator, arrays),
        "classes": encode(_plain(estimator.classes_, path), "classes", arrays),
        "fitted": {name: encode(getattr(estimator, name), name.strip("_"), arrays) for name in FITTED[kind]},
    }
    if isinstance(estimator, RPIL):
        try:
            header["state"] = encode(estimator.state_, "state", arrays)
        except TypeError as error:
            raise DataError(
                f"{path}: an adversary of the class {error} cannot be saved without pickle; keep the weights "
                "(audit_.step_weight), or fit with an adversary of rpil."
            ) from None
    write_archive(path, header, arrays)


def load(path: StrPath) -> RPIL | RMEnt | BehavioralCloning:
    """Read what `save` wrote; nothing is ever unpickled.

    Raises
    ------
    DataError
        One sentence: no such file, no saved estimator, another version of the format, or a damaged file.
    """
    path = check_readable(path)
    header, arrays = read_archive(path, SCHEMA, "it is no policy that rpil saved; make one with rpil fit, or rpil.save")
    if header.get("class") not in ESTIMATORS:
        raise DataError(
            f"{path}: it holds a {header.get('class')!r}, which rpil {__version__} does not know; "
            f"use rpil {header.get('rpil')}, or fit and save again."
        )
    try:
        estimator = _restore(header, Decoder(arrays))
        with np.errstate(all="ignore"):
            _try_out(estimator)
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise DataError(f"{path}: its parts do not belong together; fit and save it again.") from error
    estimator.source_ = path.name  # so that messages about it can say which file to replace
    return estimator


def write_archive(path: StrPath, header: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """A header and arrays to a file, all of it or nothing."""
    with replacing(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_member(_HEADER), json.dumps(header, indent=1))
        for name, array in arrays.items():
            stream = io.BytesIO()
            npy.write_array(stream, array, allow_pickle=False)
            archive.writestr(_member(f"{name}.npy"), stream.getvalue())


def _member(name: str) -> zipfile.ZipInfo:
    """An entry of the archive without the time of day, so that the same model is the same file."""
    info = zipfile.ZipInfo(name)
    info.external_attr = 0o600 << 16  # readable when unpacked
    return info


def _plain(classes: NDArray[Any], path: StrPath) -> NDArray[Any]:
    """Classes without Python objects: pandas hands text over as those."""
    if classes.dtype.kind == "O" and all(isinstance(value, str) for value in classes):
        return classes.astype(np.str_)
    if classes.dtype.kind not in "biufU":
        raise DataError(f"{path}: actions of type {classes.dtype} cannot be saved; fit on whole numbers or text.")
    return classes


def _params(estimator: Any, arrays: dict[str, NDArray[Any]]) -> dict[str, Any]:
    """Constructor parameters; one that is nothing plain is left out."""
    params = {}
    given = estimator.get_params(deep=False)
    for only_here in ("progress", "engine", "checkpoint"):
        given.pop(only_here, None)
    for name, value in given.items():
        plain = [np.asarray(part).tolist() for part in value] if isinstance(value, list | tuple | np.ndarray) else value
        with suppress(TypeError):
            params[name] = encode(plain, f"params/{name}", arrays)
    return params


def encode(value: Any, name: str, arrays: dict[str, NDArray[Any]]) -> Any:
    """`value` as a node of the header; its arrays go to `arrays`, under names that begin with `name`."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray) and value.dtype.kind in "biufU":
        arrays[name] = value
        return {"array": name}
    if isinstance(value, tuple | list):
        return [encode(item, f"{name}/{k}", arrays) for k, item in enumerate(value)]
    if isinstance(value, Mapping):
        return {"pairs": [[encode(part, name, arrays) for part in pair] for pair in value.items()]}
    if type(value) not in KNOWN or not is_dataclass(value):
        raise TypeError(type(value).__name__)
    content = {f: encode(getattr(value, f), f"{name}/{f}", arrays) for f in _field_names(type(value))}
    return {"class": type(value).__name__, "fields": content}


def _field_names(known: type) -> list[str]:
    """What an object is made of; private fields are what a computation remembers for speed."""
    return [field.name for field in fields(known) if not field.name.startswith("_")]


class Decoder:
    """Nodes of a header back to values, each array used once and checked against the sizes seen before."""

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self.arrays = dict(arrays)
        self.sizes: dict[str, int] = {}

    def array(self, node: Any, axes: str, *dtypes: type) -> NDArray[Any]:
        """The array that `node` names; axes as in `KNOWN`."""
        array = self.arrays.pop(node["array"])
        letters = axes.split()
        if array.ndim != len(letters) or (dtypes and array.dtype not in dtypes):
            raise ValueError(node)
        for size, letter in zip(array.shape, letters, strict=True):
            letter, _, more = letter.partition("+")
            expected = int(letter) if letter.isdigit() else self.sizes.setdefault(letter, size - int(more or 0))
            if size != expected + int(more or 0):
                raise ValueError(node)
        if array.dtype.kind == "f" and np.isnan(array).any():
            raise ValueError(node)
        return array

    def value(self, node: Any) -> Any:
        """What `_encode` was given; lists come back as tuples."""
        if isinstance(node, list):
            return tuple(self.value(item) for item in node)
        if not isinstance(node, dict):
            return node
        if node.keys() == {"pairs"}:
            return {self.value(key): self.value(value) for key, value in node["pairs"]}
        known, content = BY_NAME[node["class"]], node["fields"]
        if node.keys() != {"class", "fields"} or content.keys() != set(_field_names(known)):
            raise KeyError(node["class"])
        shapes = KNOWN[known]
        if known is FeatureMap:  # what comes after it, up to the next one, has as many columns as it
            self.sizes = {letter: size for letter, size in self.sizes.items() if letter not in ("F", "knots", "R")}
        return known(
            **{
                name: self.array(part, shapes[name], *_TYPES.get(name, (np.float64,)))
                if name in shapes
                else self.value(part)
                for name, part in content.items()
            }
        )


def _restore(header: dict[str, Any], decoder: Decoder) -> Any:
    kind = header["class"]
    classes = decoder.array(header["classes"], "K")
    params = {name: decoder.value(node) for name, node in header["params"].items()}
    estimator = ESTIMATORS[kind](**params)
    estimator.classes_ = classes
    if header["fitted"].keys() != set(FITTED[kind]):
        raise KeyError("fitted")
    for name, node in header["fitted"].items():
        axes = FITTED_ARRAYS.get(name)
        setattr(estimator, name, decoder.array(node, axes, np.float64) if axes else decoder.value(node))
    if kind == "RPIL":
        estimator.state_ = decoder.value(header["state"])
    estimator.n_features_in_ = decoder.sizes["D"]
    for name, texts in header["names"].items():
        if name not in _NAMES or len(texts) != estimator.n_features_in_:
            raise ValueError(name)
        setattr(estimator, name, np.array(texts, dtype=object) if name == "feature_names_in_" else tuple(texts))
    if decoder.arrays:
        raise KeyError(f"unknown arrays {sorted(decoder.arrays)}")
    return estimator


def _try_out(estimator: Any) -> None:
    """Use the estimator on one made-up step: parts that do not fit each other fail here, not in the user's hands."""
    observation, classes = np.zeros((1, estimator.n_features_in_)), estimator.classes_
    outputs = estimator.policy_.outputs(estimator.features_.design(observation))
    action = estimator.space_.act(outputs)
    sound = np.isfinite(outputs).all() and (classes[:-1] < classes[1:]).all()
    sound &= len(classes) == getattr(estimator.space_, "n", 0)
    if isinstance(estimator, RMEnt):
        sound &= len(estimator.ids_) == len(estimator.weights_)
    if isinstance(estimator, RPIL):
        audit, state, judged = estimator.audit_, estimator.state_, estimator.judge_ is not None
        bounds = audit.offsets[[0, -1]].tolist() == [0, len(audit.step_weight)] and (audit.lengths > 0).all()
        sound &= bounds and len(audit.ids) == len(audit.verdicts) == len(audit.log_odds)
        sound &= audit.finding in FINDINGS and judged == (state is None)
        json.dumps(audit.to_dict())
        one_step = Demonstrations(observation, classes[action] if len(classes) else action, np.array([0, 1]))
        sound &= not np.isnan(estimator.score_demonstrations(one_step)).any()
        sound &= state is None or np.isfinite(state.prior.log_odds)
    if not sound:
        raise ValueError("values out of range")


def read_archive(path: Path, schema: str, otherwise: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """The header, of the right schema and version, and every array of the archive; what to say of another file."""
    foreign = f"{path}: {otherwise}."
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            started = file.read(2) == b"PK"
        raise DataError(f"{path}: it is damaged or truncated; fit and save it again." if started else foreign)
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            header = json.loads(archive.read(_HEADER)) if _HEADER in names else None
            if not isinstance(header, dict) or header.get("schema") != schema:
                raise DataError(foreign)
            _check_version(path, header)
            arrays = {name.removesuffix(".npy"): _array(archive.read(name)) for name in names if name != _HEADER}
    except DataError:
        raise
    except Exception as error:  # a damaged file makes zipfile, zlib, tokenize and numpy raise whatever they like
        if "allow_pickle" in str(error):
            raise DataError(
                f"{path}: it holds Python objects, which are never unpickled because that can run any code; "
                "fit and save it again."
            ) from error
        raise DataError(f"{path}: it is damaged or truncated; fit and save it again.") from error
    if len(set(names)) < len(names):
        raise DataError(f"{path}: it holds two arrays of one name; fit and save it again.")
    return header, arrays


def _check_version(path: Path, header: dict[str, Any]) -> None:
    version, made_by = header.get("version"), header.get("rpil")
    if version != VERSION:
        raise DataError(
            f"{path}: rpil {made_by} saved it in version {version!r} of the format, but rpil {__version__} reads "
            f"version {VERSION}; use that rpil, or fit and save again."
        )


def _array(content: bytes) -> NDArray[Any]:
    stream = io.BytesIO(content)
    array: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
    if stream.read(1):
        raise ValueError("bytes after the array")
    return array
