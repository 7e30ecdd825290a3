"""CSV files as people write them: each is read as meant, or refused with a sentence that says what to do."""

from contextlib import nullcontext

import numpy as np
import pytest

from problems import refused
from rpil import formats
from rpil.formats import read_recording

M, T = 4, 15
RNG = np.random.default_rng(7)
X = RNG.normal(size=(M * T, 2)).round(4)
TURN = RNG.integers(0, 3, M * T)
RUN = np.repeat(np.arange(M), T)
STEP = np.tile(np.arange(T), M)
BASE = {"episode": RUN, "step": STEP, "x": X[:, 0], "v": X[:, 1], "action": TURN}
ONE = BASE | {"episode": 0 * RUN, "step": np.arange(M * T)}  # one demonstration, which counts from 0
SHUFFLED = np.random.default_rng(3).permutation(M * T)


def text(columns, sep=",", decimal=".", rows=None, quote=False):
    """The columns as text, one row a line."""

    def cell(value):
        shown = f"{value:g}".replace(".", decimal) if isinstance(value, float | np.floating) else str(value)
        return f'"{shown}"' if quote or sep in shown else shown

    chosen = range(len(next(iter(columns.values())))) if rows is None else rows
    lines = [sep.join(cell(values[row]) for values in columns.values()) for row in chosen]
    return "\n".join([sep.join(columns), *lines, ""])


ns = 1_700_000_000_000_000_000 + 50_000_000 * np.arange(M * T)
VARIANTS = {
    "plain": (text(BASE), {}),
    "semicolons": (text(BASE, ";"), {}),
    "separator of Excel": ("sep=;\n" + text(BASE, ";"), {}),
    "tabs": (text(BASE, "\t"), {}),
    "bars": (text(BASE, "|"), {}),
    "decimal commas": (text(BASE, ";", ","), {}),
    "text like a decimal comma": (text(BASE | {"note": len(RUN) * ["1,5"]}, quote=True), {}),
    "all quoted": (text(BASE, quote=True), {}),
    "spaces around names": (text(BASE).replace("episode,step,x,v,action", " episode , step, x ,v , action"), {}),
    "times": (text(BASE | {"t": STEP * 0.05, "stamp_ns": ns, "wall_time": ns * 1e-9}), {}),
    "row index of pandas": (text({"": np.arange(M * T)} | BASE), {}),
    "comment lines": ("# recorded on Monday\n# by hand\n" + text(BASE), {}),
    "blank last lines": (text(BASE) + "\n\n\n", {}),
    "trailing separators": (text(BASE).replace("\n", ",\n"), {}),
    "shuffled rows": (text(BASE, rows=SHUFFLED), {}),
    "interleaved": (text(BASE, rows=np.argsort(STEP, kind="stable")), {}),
    "text ids": (text(BASE | {"episode": [f"day {m}, run {m}" for m in RUN]}), {"ids": "text"}),
}


def assert_read(d, expected):
    assert (len(d), len(set(d.ids))) == (M, M)
    order = np.lexsort([STEP, RUN])
    by_id = sorted(range(M), key=lambda m: str(d.ids[m]))
    rows = np.concatenate([np.arange(d.offsets[m], d.offsets[m + 1]) for m in by_id])
    np.testing.assert_array_equal(d.observations[rows], X[order])
    np.testing.assert_array_equal(d.actions[rows], TURN[order])
    assert all(isinstance(name, str) == (expected.get("ids") == "text") for name in d.ids)


@pytest.mark.parametrize("variant", VARIANTS)
def test_variants_are_read_as_meant(tmp_path, monkeypatch, variant):
    monkeypatch.setattr("rpil.formats.steps.BATCH_ROWS", 7)
    content, expected = VARIANTS[variant]
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    assert_read(formats.read(tmp_path / "a.csv"), expected)


def test_encodings(tmp_path):
    content = text(BASE | {"episode": [f"Läufe {m}" for m in RUN]})
    (tmp_path / "a.csv").write_text(content, encoding="utf-8-sig")
    recording = read_recording(tmp_path / "a.csv")
    assert_read(recording.demonstrations, {"ids": "text"})
    assert recording.demonstrations.ids[0] == "Läufe 0"
    for head in ("", "é,"):  # in values, and in the names of columns
        (tmp_path / "b.csv").write_text(head + content, encoding="cp1252")
        for on_disk in (False, True):
            with refused(r"^b\.csv: not a CSV file in UTF-8, .*; write it again, as UTF-8\.$"):
                read_recording(tmp_path / "b.csv", on_disk=on_disk)


@pytest.mark.parametrize(
    ("columns", "other", "name"),
    [({n: BASE[n] for n in BASE if n != "episode"}, "a.tsv", "'a'"), (BASE, "b.csv", "0"), (ONE, "b.csv", "0")],
)
def test_a_demonstration_in_two_files_is_refused(tmp_path, columns, other, name):
    for file in ("a.csv", other):
        (tmp_path / file).write_text(text(columns))
    for on_disk in (False, True):
        remedy = "rename one of them" if name == "'a'" else "give each"
        with refused(f"demonstration {name}: it is both in a.csv and in {other}; {remedy}"):
            read_recording(tmp_path, on_disk=on_disk)


HALF = STEP // 8


@pytest.mark.parametrize(
    ("other", "episode", "rows", "has_order", "at"),
    [
        (HALF, RUN, None, True, None), (HALF, RUN, None, False, 9), (0 * STEP, RUN, None, False, None),
        (HALF, RUN, SHUFFLED, True, None), (HALF, RUN, np.argsort(HALF, kind="stable"), True, 33),
        (np.minimum(STEP // 2, 7 - (RUN > 1)), RUN, None, False, 3),  # half of the rows would begin a demonstration
        (np.minimum(STEP // 2, 7 - (RUN > 2)), RUN, None, False, None),
        (RUN // 2, RUN % 2, None, True, 31), (RUN // 2, RUN % 2, None, False, 31),  # each session counts anew
    ],
)  # fmt: skip
@pytest.mark.parametrize("name", ["session", "operator", "task"])
def test_rows_of_one_id_are_several_where_another_column_divides_them(
    tmp_path, name, other, episode, rows, has_order, at
):
    columns = {name: other, "episode": episode, "x": X[:, 0], "action": TURN}
    columns |= {"step": STEP} if has_order else {}
    (tmp_path / "a.csv").write_text(text(columns, rows=rows))
    words = f"demonstration 0, row {at}: column '{name}' changes within this demonstration; write a column of ids"
    with refused(words) if at else nullcontext():
        assert len(formats.read(tmp_path / "a.csv")) == len({*episode})
    assert len(formats.read(tmp_path / "a.csv", id="episode")) == len({*episode})


def test_observations_that_tell_demonstrations_apart_are_noted(tmp_path):
    more = {"seed": RUN * 7, "wind": np.sqrt(RUN), "gravity": 9.81 + 0 * RUN}
    for rows in (None, SHUFFLED):
        (tmp_path / "a.csv").write_text(text({"": RUN} | BASE | more, rows=rows))
        said = read_recording(tmp_path / "a.csv").description
        assert said.notes == ("Constant in each demonstration: seed, wind; exclude what nobody could see.",)
        assert said.short()[-2] == "Ignored: no name (number of the row)."


REFUSED = {
    "texts": (
        text(BASE | {"action": [f"go {k}" for k in range(M * T)]}),
        "60 different texts in 60 steps, .* name a column",
    ),
    "units": ("x,id,action\nm,0,N\n" + "".join(f"1,0,{k / 7}\n" for k in range(60)), "text among numbers, as 'N'"),
    "a second head": (2 * text(BASE), r"line 62: it repeats the names of the columns, .*; correct it"),
    "a quoted name": (text(BASE).replace(",x,", ',"x,', 1), "a quotation begins and does not end in .*, its names"),
    "no rows": ("episode,step,x,action\n", "it has no rows; write one for each step below the names of its columns"),
    "a word among decimal commas": (
        "episode;x;action\n" + 9 * "1;0,5;1,5\n" + "1;O,5;0,5\n",
        r"a\.csv, demonstration 1, row 10: column 'x' holds text \('O,5'\), not numbers; write numbers",
    ),
    "commas": ("run;x;v;action\n" + 9 * "1;.5;1,5;.5\n", r"'v' holds 1,5, and other numbers have a decimal '\.'; w"),
    "points": (
        "run;x;action\n" + 250 * "1;0,5;1,5\n" + "1;.5;0,5\n",
        r"'x' holds \.5, and other numbers .* ','; write",
    ),
    "quoted": (
        "run,x,turn\n" + 9 * '1,"0,5","1,5"\n',
        "no column holds the action: .*; column 'x' has decimal commas; w",
    ),
    "a quoted action": (
        "run,x,action\n" + 9 * '1,.5,"1,5"\n',
        "a.csv: column 'action' has decimal commas; write points",
    ),
    "empty lines": ("\n\n", "a.csv: the file is empty; write it again, or read its folder with skip_bad=True"),
    "no id": (
        text({"versuch": RUN, "x": X[:, 0], "turn": TURN}),
        "no column says which demonstration .*'versuch', 'x'.*; no column holds the action either: .* with action=",
    ),
    "spaces": (text(BASE, " "), "it has one column, 'episode step x v action'; write commas, semicolons or tabs"),
}


@pytest.mark.parametrize("variant", REFUSED)
def test_what_cannot_be_read_is_refused_with_the_place_and_the_remedy(tmp_path, variant):
    content, match = REFUSED[variant]
    (tmp_path / "a.csv").write_text(content)
    with refused(match) as error:
        formats.read(tmp_path / "a.csv")
    assert str(error.value).startswith("a.csv")
