"""The formats that are recognised by their layout: each is one module, and one line here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from rpil.data.arrays import Id
from rpil.data.errors import DataError, MissingExtraError
from rpil.data.files import StrPath, check_exists
from rpil.data.folders import check_folder
from rpil.formats import aloha, d4rl, hdf5, imitation, lerobot_folder, minari, robomimic, zarr
from rpil.formats.columns import ColumnOptions
from rpil.formats.recording import Recording


class Layout(Protocol):
    """What the module of a format offers."""

    def is_mine(self, path: Path, /) -> bool:
        """Whether the file or folder at `path`, which exists, has this layout; any error means that it has not."""

    def read(self, path: Path, options: ColumnOptions, /) -> Recording:
        """The recording in it; a `DataError` where it cannot be read."""

    def keep(self, path: Path, output: Path, ids: Sequence[Id], /) -> None:
        """Write the demonstrations `ids` (as `read` gives them, or as text), in the order of the file, to `output`."""


LAYOUTS: tuple[Layout, ...] = (lerobot_folder, zarr, minari, imitation, robomimic, d4rl, aloha, hdf5)
"""The formats, in the order in which a path is shown to them."""


def find_layout(path: StrPath) -> Layout | None:
    """The format of a file or folder by its layout; None for tables, arrays of NumPy, and what is not there.

    A `DataError`, before anything is opened, where `check_folder` raises one.
    """
    place = Path(path)
    if not place.exists():
        return None
    check_folder(check_exists(place))
    return next((layout for layout in LAYOUTS if _is_mine(layout, place)), None)


def _is_mine(layout: Layout, path: Path) -> bool:
    """Whether `path` has the `layout`: not so where it is too damaged to tell. What must not be opened is refused."""
    try:
        return layout.is_mine(path)
    except (DataError, MissingExtraError):
        raise
    except Exception:  # damaged files make libraries raise errors of very many types
        return False
