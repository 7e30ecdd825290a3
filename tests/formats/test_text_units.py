"""No row of a text is lost in silence: of damaged copies of CSV each is refused, or read whole."""

import random

import rpil
from rpil.data.errors import DataError

NOTES = {
    "plain": lambda k: "ok" if k % 7 else "",
    "quoted": lambda k: f'"take {k}, ok"' if k % 3 else '""',
    "doubled": lambda k: '"said ""go"""' if k % 5 else '""',
    "inches": lambda k: '5" wide' if k % 4 else '"5"" wide"',
}


def table(note, separator=",", first=False, n=48):
    """A text table with a note in its last column, or its second."""
    rows = [["episode_index", "observation.x", "action", "note"]]
    rows += [[str(k // 12), f"{k / 7:.3f}", str(k % 2), NOTES[note](k)] for k in range(n)]
    rows = [[row[0], row[3], *row[1:3]] if first else row for row in rows]
    return "".join(f"{separator.join(row)}\n" for row in rows)


SAMPLES = [
    *((f"{note}-{place}.csv", table(note, first=place == "second")) for note in NOTES for place in ("last", "second")),
    ("tabs.tsv", table("quoted", "\t")),
    ("semicolons.csv", table("doubled", ";")),
]


def mutant(text, rng):
    """The text with a mark that is dropped, doubled, moved or added, or a line that is cut."""
    marks = [k for k, sign in enumerate(text) if sign in '",;\t{}[]:']
    quotes = [k for k in marks if text[k] == '"'] or marks
    place, other = rng.choice(quotes if rng.random() < 0.6 else marks), rng.randrange(len(text))
    kind = rng.choice(("drop", "double", "move", "add", "pair", "cut", "join"))
    if kind == "drop":
        return text[:place] + text[place + 1 :]
    if kind == "double":
        return text[:place] + text[place] + text[place:]
    if kind == "move":
        rest = text[:place] + text[place + 1 :]
        return rest[:other] + text[place] + rest[other:]
    if kind == "add":
        return text[:other] + rng.choice('",;\t') + text[other:]
    if kind == "pair":  # two quotation marks at borders of values
        borders = sorted(rng.sample([k for k, sign in enumerate(text) if sign in ",;\t\n"], 2))
        return text[: borders[0] + 1] + '"' + text[borders[0] + 1 : borders[1]] + '"' + text[borders[1] :]
    end = text.find("\n", other)
    return text[:other] + text[end if kind == "cut" else end + 1 :]


def units(text):
    """The rows or lines that are in a text."""
    return len([line for line in text.split("\n") if line.strip()]) - 1


def lost(folder, seeds):
    """The mutants that are read with other units, of those of these seeds."""
    found = []
    for seed in seeds:
        rng = random.Random(seed)
        name, text = SAMPLES[seed % len(SAMPLES)]
        damaged = mutant(text, rng)
        (folder / name).write_text(damaged)
        try:
            n = rpil.open(folder / name, id="episode_index").description.steps
        except DataError:
            continue
        if n != units(damaged):
            found.append((seed, name, n, units(damaged)))
    return found


def test_no_row_of_a_mutant_is_lost_in_silence(tmp_path):
    assert lost(tmp_path, range(200)) == []
