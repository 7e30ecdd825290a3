import math

import pytest

from rpil.data import memory
from rpil.data.errors import DataError
from rpil.data.memory import LARGEST_METADATA, finite, object_in, parse, parse_lines, read_json, read_text


def test_text_and_json_are_read_up_to_a_limit(tmp_path):
    path = tmp_path / "info.json"
    path.write_text('{"ä": [1, null]}', encoding="utf-8-sig")  # with a mark of three bytes
    assert read_json(path) == {"ä": [1, None]}
    assert read_text(path, limit=20) == '{"ä": [1, null]}'
    with pytest.raises(DataError, match=r"info\.json"):
        read_text(path, limit=19)


def test_a_file_with_a_hole_is_not_read_whole(tmp_path):
    path = tmp_path / "info.json"
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(DataError, match=rf"info\.json.* {LARGEST_METADATA // 2**20} MiB"):
        read_json(path)


def test_lines_of_json_hold_all_characters_but_ends_of_lines():
    text = '{"task": "a\u2028b\x85c"}\r\n\n[1]\r'
    assert parse_lines(text, "x.jsonl") == [{"task": "a\u2028b\x85c"}, [1]]


def test_json_of_too_many_lists_is_refused(monkeypatch):
    monkeypatch.setattr(memory, "MOST_LISTS", 2)
    assert parse('{"a": []}', "x.json") == {"a": []}
    for text in ("[[], []]", b"[[{}]]"):
        with pytest.raises(DataError, match=r"x\.json: it holds more than 2 lists and objects"):
            parse(text, "x.json")


def test_numbers_that_json_has_not_become_none():
    assert finite({"a": [1.5, math.nan, (-math.inf, "b")], "c": 2}) == {"a": [1.5, None, [None, "b"]], "c": 2}


def test_a_text_without_an_object_holds_none():
    assert object_in('{"a": 1}') == {"a": 1}
    for other in ("[1]", "no JSON", 3, "[" * 100_000):
        assert object_in(other) == {}
