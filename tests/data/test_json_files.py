import pytest

from rpil.data import memory
from rpil.data.errors import DataError
from rpil.data.memory import LARGEST_METADATA, check_text, read_json, read_text
from rpil.formats.parquet import MetaFolder


def test_text_and_json_are_read_up_to_a_limit(tmp_path):
    path = tmp_path / "info.json"
    path.write_text('{"ä": [1, null]}', encoding="utf-8-sig")  # with a mark of three bytes
    assert (read_json(path), read_text(path, limit=20)) == ({"ä": [1, None]}, '{"ä": [1, null]}')
    with pytest.raises(DataError, match=r"info\.json"):
        read_text(path, limit=19)


def test_a_file_with_a_hole_is_not_read_whole(tmp_path):
    path = tmp_path / "info.json"
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(DataError, match=rf"info\.json.* {LARGEST_METADATA // 2**20} MiB"):
        read_json(path)


def test_lines_of_json_hold_all_characters_but_ends_of_lines_and_a_text_not_too_many_lists(tmp_path, monkeypatch):
    (tmp_path / "meta").mkdir()
    text = '{"task": "a\u2028b\x85c"}\r\n\n[1]\r'
    (tmp_path / "meta" / "tasks.jsonl").write_text(text, encoding="utf-8", newline="")
    assert MetaFolder(tmp_path).rows("tasks") == [{"task": "a\u2028b\x85c"}, [1]]
    monkeypatch.setattr(memory, "MOST_LISTS", 2)
    check_text('{"a": []}', "x.json", LARGEST_METADATA)
    for text in ("[[], []]", b"[[{}]]"):
        with pytest.raises(DataError, match=r"x\.json: it holds more than 2 lists and objects"):
            check_text(text, "x.json", LARGEST_METADATA)
