"""Types of columns by how their texts are written."""

from __future__ import annotations

import pyarrow as pa
import pytest

from rpil.formats.text_types import exact_type, written_as


@pytest.mark.parametrize(
    ("texts", "floats", "kind"),
    [
        (["1", "2"], False, pa.int64()),
        (["1", None], False, pa.int64()),
        (["01", "1"], False, pa.string()),
        (["0.5", "1"], False, pa.string()),  # of an id
        (["0.5", "-0"], True, pa.float64()),
        (["-0", "1"], True, pa.string()),
        (["12345678901234567890", "0.5"], True, pa.string()),
        (["left", "1"], True, pa.string()),
    ],
)
def test_a_column_has_the_type_of_all_its_texts_in_any_pieces(texts, floats, kind):
    whole = exact_type(written_as(pa.chunked_array([texts]), floats))
    pieces = set().union(*(written_as(pa.chunked_array([[text]], pa.string()), floats) for text in texts))
    assert whole == exact_type(pieces) == kind
