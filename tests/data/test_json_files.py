import time

import pytest

from rpil.data.errors import DataError
from rpil.data.json_files import LARGEST_METADATA, LARGEST_TOML, parse_lines, read_json, read_text, read_toml


def test_text_and_json_are_read_up_to_a_limit(tmp_path):
    path = tmp_path / "info.json"
    path.write_text('{"ä": [1, null]}', encoding="utf-8")
    assert read_json(path) == {"ä": [1, None]}
    assert read_text(path, limit=17) == '{"ä": [1, null]}'
    with pytest.raises(DataError, match=r"info\.json"):
        read_text(path, limit=16)


def test_a_file_with_a_hole_is_not_read_whole(tmp_path):
    path = tmp_path / "info.json"
    with path.open("wb") as file:
        file.truncate(10**12)
    with pytest.raises(DataError, match=rf"info\.json.* {LARGEST_METADATA // 2**20} MiB"):
        read_json(path)


def test_lines_of_json_hold_all_characters_but_ends_of_lines():
    text = '{"task": "a\u2028b\x85c"}\r\n\n[1]\r'
    assert parse_lines(text, "x.jsonl") == parse_lines(text.encode(), "x.jsonl") == [{"task": "a\u2028b\x85c"}, [1]]


@pytest.mark.parametrize(
    "text",
    [
        "KEY = 1",
        "[KEY]",
        "x = {KEY = 1}",
        'x = {a = """\n""", KEY = "1"}',
        '# "\nKEY = 1\n# "',
        "# '\nKEY = 1\n# '",
        'x = "\\""\nKEY = 1\n# "',
        "x = '''a'''''\nKEY = 1\n# '''",
        "x = {a = '''a'''', KEY = 1, b = ''}",
        'x = {a = """\\"""", KEY = 1, b = ""}',
        "x = {a = '''\n,\"''', KEY = 1, b = \"x\"}",
        '["," .KEY."]" ]',
        '# """\nKEY = 1\n# """',
        '"a b" . "\\" ". ' * 500 + "x = 1",
    ],
)
def test_a_key_of_very_many_parts_is_refused_before_it_is_parsed(tmp_path, monkeypatch, text):
    monkeypatch.setattr("tomllib.loads", None)
    place = tmp_path / "x.toml"
    place.write_text(text.replace("KEY", "a." * 5_000 + 'b."c"'))
    with pytest.raises(DataError, match=r"x\.toml: a key in it has more than 8 dots; write plain keys"):
        read_toml(place)


def test_dots_in_lists_and_comments_of_toml_are_no_keys(tmp_path):
    place = tmp_path / "x.toml"
    names = [*(f"observation.joint.{k}" for k in range(20)), "a.b.c.d.e.f.g.h.i.j.k"]
    place.write_text(f"\ufeffa = {names!r} # {'see ... ' * 20}\nb.c = 1.5\n")
    assert read_toml(place) == {"a": names, "b": {"c": 1.5}}
    place.write_text("#" * LARGEST_TOML + "\n")
    with pytest.raises(DataError, match=r"x\.toml: it is longer than 1 MiB"):
        read_toml(place)


HOSTILE = [r"\"", r'"""\"', "'''\"", '"" ', "a ", "#", '"', "'"]


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_toml_takes_no_time(tmp_path, monkeypatch, text):
    monkeypatch.setattr("tomllib.loads", lambda _: {})
    (tmp_path / "x.toml").write_text((text * LARGEST_TOML)[:LARGEST_TOML])
    start = time.process_time()
    assert read_toml(tmp_path / "x.toml") == {}
    assert time.process_time() - start < 2
