"""Whatever a library raises while data are read is one sentence that names the place."""

import errno
import os

import numpy as np
import pyarrow as pa
import pytest

from rpil.data.errors import DataError, MissingExtraError, guarded

FOREIGN = [
    KeyError("actions"),
    RecursionError("maximum recursion depth exceeded"),
    UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte"),
    AssertionError(),
    pa.ArrowInvalid("Parquet magic bytes not found. Either the file is corrupted. \n\tOr this is no file."),
    np.linalg.LinAlgError("\x1b[31mred\x1b[0m \u202e"),
    ValueError("x" * 1000),
]


@pytest.mark.parametrize("error", FOREIGN, ids=lambda error: type(error).__name__)
def test_a_foreign_error_is_one_sentence(error):
    with (
        pytest.raises(DataError, match=r"^a\.npz: a damaged file .*; write it again\.$") as caught,
        guarded("a.npz", "a damaged file", "write it again"),
    ):
        raise error
    message = str(caught.value)
    assert type(error).__name__ in message
    assert message.isprintable()
    assert ". " not in message
    assert len(message) < 200
    assert caught.value.__cause__ is error


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EINTR, errno.ECHILD, errno.EAGAIN])
def test_what_the_system_lacks_is_no_damage(number):
    said = r"^a\.npz: the system could not read it \(.*\); try again\.$"
    with pytest.raises(DataError, match=said) as caught, guarded("a.npz"):
        raise OSError(number, os.strerror(number))
    assert "damage" not in str(caught.value)


@pytest.mark.parametrize("file", [None, "drive/1.csv"])
def test_permissions_are_no_damage(file):
    with pytest.raises(DataError, match=f"^{file or 'drive'}: .*permissions") as caught, guarded("drive"):
        raise PermissionError(errno.EACCES, "Permission denied", file)
    assert "damage" not in str(caught.value)


@pytest.mark.parametrize(
    "error",
    [
        *(DataError("b.npz: it is bad; repair it."), MissingExtraError("HDF5", "hdf5"), KeyboardInterrupt()),
        *(UserWarning("an error by the user's wish"), SystemExit(3), OSError(errno.ENOSPC, "No space left on device")),
        OSError(errno.EROFS, "Read-only file system"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_what_is_no_fault_of_the_data_passes(error):
    with pytest.raises(type(error)) as caught, guarded("a.npz"):
        raise error
    assert caught.value is error
