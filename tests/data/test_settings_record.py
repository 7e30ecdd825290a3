"""Values of settings records."""

import numpy as np
import pytest

from rpil.data.errors import DataError
from rpil.data.settings_record import settings_record


@settings_record(share="[0, 1)")
class Record:
    count: int = 3
    tol: float = 0.1
    share: float = 0.5
    ridges: tuple[float, ...] = (1.0, 0.1)
    name: str = "raw"
    prior: float | None = None

    def __post_init__(self) -> None:
        if self.name == self.prior:
            raise DataError("The name is the prior.")


def test_values_inside_their_intervals_are_taken():
    record = Record(count=1, tol=np.float64(2), share=0, ridges=(5,), name="", prior=-1.0)
    assert (record.count, record.tol, record.share, record.ridges) == (1, 2.0, 0, (5,))


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"count": 0}, "Record: count=0 must be a whole number in [1, inf)."),
        ({"count": 1.5}, "Record: count=1.5 must be a whole number in [1, inf)."),
        ({"tol": 0.0}, "Record: tol=0.0 must be a number in (0, inf)."),
        ({"tol": float("nan")}, "Record: tol=nan must be a number in (0, inf)."),
        ({"tol": "1"}, "Record: tol='1' must be a number in (0, inf)."),
        ({"share": 1.0}, "Record: share=1.0 must be a number in [0, 1)."),
        ({"name": None}, "The name is the prior."),
        ({"ridges": ()}, "Record: ridges=() must be a tuple of numbers, each in (0, inf)."),
        ({"ridges": (1.0, -1.0)}, "Record: ridges=(1.0, -1.0) must be a tuple of numbers, each in (0, inf)."),
        ({"ridges": 1.0}, "Record: ridges=1.0 must be a tuple of numbers, each in (0, inf)."),
    ],
)
def test_field_and_interval_of_a_wrong_value_are_named(wrong, sentence):
    with pytest.raises(DataError) as error:
        Record(**wrong)
    assert str(error.value) == sentence
