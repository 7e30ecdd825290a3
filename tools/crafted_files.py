"""Gives rpil small files and situations that were made to mislead it, and says where it does not end as it should.

``python tools/crafted_files.py`` tries all cases and prints a line for each: "as it should be", or what differed.
``--list`` names them, and ``--only NAME,NAME`` takes some. The exit code is 1 where one differs. All take less than a
minute, and need what ``pip install .[dev]`` brings. Set PYTHONPATH to the ``src`` to test.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager
from pathlib import Path
from subprocess import PIPE, Popen
from tempfile import TemporaryDirectory

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # more take ten times as long where other programs run
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from click.testing import CliRunner, Result

import asked
import lerobot_folders
import rpil
from rpil.cli.main import main as command
from rpil.cli.questions.server import Gate
from rpil.cli.questions.session import EpisodeVideos
from served import Client

DATA, COLUMNS = "d.parquet", ("--observations", "x,v", "-q")
DEADLY_SECONDS = 20  # after which a process that does not answer is given up
LONGEST, MOST_COLUMNS = 600, 50_000  # of a sentence, and of a table of CSV
Found = str | None  # what differed


def call(*words: str, **options: object) -> Result:
    """A command in this process, without lines about progress."""
    return CliRunner().invoke(command, words, **options)


def ended(result: Result, words: str = "") -> Found:
    """What differs from success or, with `words`, from a refusal in one short sentence that has them."""
    said, code = result.stderr, 2 if words else 0
    is_one = not words or (len(said) <= LONGEST and words in said and re.fullmatch(r"rpil: [^\n]+\n", said))
    found = f"code {result.exit_code}, {said[-300:] or result.exception!r}"
    return None if is_one and result.exit_code == code else found


def differing(found: object, expected: object) -> Found:
    """The two where they are not equal."""
    return None if found == expected else f"{found!r:.400}, and not {expected!r:.200}"


@contextmanager
def reviewing(*words: str, **variables: str) -> Iterator[tuple[Popen[str], Client]]:
    """``rpil review`` as a process with other `variables` of the environment, and requests to it."""
    start = [sys.executable, "-c", "from rpil.cli.entry import main; main()", "review", DATA, *COLUMNS, *words]
    with Popen(start, env=os.environ | variables, stdout=PIPE, stderr=PIPE, text=True) as process:
        try:
            said = iter(process.stdout.readline, "")
            address = next(filter(None, (re.search(r":(\d+)/\?token=(\S+)", line) for line in said)), None)
            if address is None:
                raise RuntimeError(process.stderr.read())
            yield process, Client(Gate(int(address[1]), address[2]))
        finally:
            process.kill()


def order_of_demonstrations(folder: Path) -> Found:
    """Another order in the file changes no finding, word, doubt or pair."""
    for seed in (12, 14, 20):
        rng, owner, said = np.random.default_rng(seed), np.repeat(np.arange(11), 35), set()
        observations = rng.normal(size=(len(owner), 4))
        actions = np.argmax(2 * observations[:, :3] + rng.gumbel(size=(len(owner), 3)), axis=1)
        actions[owner > 6] = rng.integers(0, 3, 4 * 35)
        data = rpil.Demonstrations.from_groups(observations, actions, owner)
        for k in range(4):
            audit = rpil.RPIL(random_state=0).fit(data.select(np.random.default_rng(k).permutation(11))).audit_
            said.add(
                str((audit.finding, audit.pair, audit.doubts, sorted(zip(audit.ids, audit.verdicts, strict=True))))
            )
        if len(said) > 1:
            return f"the same data are {' or '.join(said):.300}"
    return None


def files_beside_the_labels(folder: Path) -> Found:
    """Finish replaces nothing that another wrote, and writes through no link."""
    outputs = ["keep.json", "verdicts.csv", "weights.parquet"]
    names, link = [*outputs, "precious", "labels-verdicts.csv"], Path("labels-keep.json")
    for name in names:
        Path(name).write_text("MINE")
    link.symlink_to("precious")
    codes = []
    with reviewing("--no-browser") as (_, client):
        for in_the_way in (link, Path("labels-verdicts.csv"), None):
            codes.append(client.post("/api/finish", version=0, write=True)[0])
            mine = [name for name in names if Path(name).exists() and Path(name).read_bytes() == b"MINE"]
            if in_the_way:
                in_the_way.unlink()
    new = [name for name in outputs if Path(f"labels-{name}").exists()]
    return differing((codes, mine, new), ([400, 400, 200], names[:-1], outputs))


def ids_with_white_space(folder: Path) -> Found:
    """Answers about odd ids are read again by every command that takes labels."""
    ids = [" lead", "trail ", "\u00a0space", "\x85next", "\u2028line", "lead", ",", "=1+1", "007", "7", "a\nb", "\t"]
    asked.write(DATA, len(ids), ids)
    results = [call("label", DATA, *COLUMNS, input="\n".join(keys)) for keys in ("3gbgbgbq", "gbgbgbq")]  # 8 at most
    results.append(call("keep", DATA, "--verdicts", "labels.csv", "-o", "kept.parquet"))
    results.append(call("audit", DATA, "--labels", "labels.csv", "--format", "json", *COLUMNS))
    if wrong := next(filter(None, map(ended, results)), None):
        return wrong
    labels = {row["id"]: row["label"] for row in json.loads(results[-1].stdout)["demonstrations"]}
    kept, good = pq.read_table("kept.parquet")["episode_index"], {name for name in labels if labels[name] == "good"}
    return differing(({*labels.values()}, {*kept.to_pylist()}), ({"good", "bad"}, good))


def table_of_many_columns(folder: Path) -> Found:
    """Time grows with the number of columns and not with its square, and very many are refused."""
    taken = {}
    for n in (10, 1_000, 8_000, MOST_COLUMNS + 1):  # the first imports what is needed
        names, rows = ",".join(f"x{k}" for k in range(n)), [f"{m // 3},{m % 2}{',0.5' * n}" for m in range(6)]
        Path("wide.csv").write_text("\n".join([f"episode,action,{names}", *rows, ""]))
        start = time.process_time()
        wrong = ended(call("info", "wide.csv"), f"{MOST_COLUMNS:,} at most" if n > MOST_COLUMNS else "")
        taken[n] = time.process_time() - start
        if wrong or (n > 1_000 and taken[n] > 25 * taken[1_000]):  # 8 times; it was 50 times
            return f"{n:,} columns: {wrong or f'{taken[n]:.2f} s, and 1,000 take {taken[1_000]:.2f} s'}"
    return None


def video_times_that_are_no_numbers(folder: Path) -> Found:
    """They are named: a review shows no videos, and ``rpil keep`` writes nothing."""
    n, wrong = 5, []
    lerobot_folders.write(folder / "plain", [8] * n, per_file=n)
    Path("labels.csv").write_text("id,label\n0,good\n1,bad\n")
    place, column = "meta/episodes/chunk-000/file-000.parquet", "videos/observation.images.front/{}_timestamp".format
    table = pq.read_table(f"plain/{place}")
    for start in (None, float("nan"), -1e300, float("inf"), "soon", 0.0):
        times = {column("from"): pa.array([start] * n, pa.string() if start == "soon" else pa.float64())}
        times |= {column("to"): pa.array([2.0] * n)} if start == 0.0 else {}  # from the first episode to the last
        shutil.copytree("plain", f"from {start}")
        pq.write_table(
            pa.table({key: times.get(key, table[key]) for key in table.column_names}), f"from {start}/{place}"
        )
        videos = EpisodeVideos.of(f"from {start}", range(n), 20.0)
        json.dumps([videos.of_one(m) for m in range(n)], allow_nan=False)  # as the server of a review answers
        keep = call("keep", f"from {start}", "--verdicts", "labels.csv", "-q", "-o", f"kept {start}")
        said = "TypeError" in keep.stderr
        found = keep.exit_code, Path(f"kept {start}").exists(), "from_timestamp is" in videos.note, said
        if found != ((0, True, False, False) if start == 0.0 else (2, False, True, False)):
            wrong.append(f"from {start}: {videos.note[:70]!r}, code {keep.exit_code}, {keep.stderr[:150]!r}")
    return "; ".join(wrong) or None


def address_of_the_review_in_the_process_list(folder: Path) -> Found:
    """All users see the arguments of a browser: its token is in a file that this user alone may read."""
    Path("browser.sh").write_text('cp -p "${1#file://}" page.html; echo "$1" > new; mv new address\n')
    with reviewing(BROWSER=f"sh '{folder}/browser.sh' %s") as (process, client):
        until = time.monotonic() + DEADLY_SECONDS
        while not Path("address").exists() and time.monotonic() < until:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        process.wait(DEADLY_SECONDS)
    address, page = Path("address").read_text().strip(), folder / "page.html"
    if client.gate.token in address:
        return f"the browser is called with {address}"
    still_there = Path(address.removeprefix("file://")).exists()
    return differing((client.gate.url in page.read_text(), page.stat().st_mode & 0o77, still_there), (True, 0, False))


def secrets_in_addresses(folder: Path) -> Found:
    """They are in no message; and no file that is passed on names the folders of a person."""
    names = ("auth", "authorization", "pwd", "pass", "sas", "code", "jwt", "token", "access_key", "X-Amz-Signature")
    addresses = [f"https://h.example/x.csv{sign}{name}=HIDDEN" for name in names for sign in "?;#&"]
    addresses += ["https://HIDDEN:HIDDEN@h.example/x.csv", "s3://HIDDEN:HID/HIDDEN@b/x.parquet"]  # of no network
    for address in addresses:
        for words in (["info", address], ["audit", address], ["check", address], ["keep", address, "-o", "k.csv"]):
            result = call(*words)
            if wrong := ended(result, "addresses are not read") or differing("HIDDEN" in result.output, False):
                return f"rpil {words[0]} {address}: {wrong}"
    outputs = ["--report", "r.html", "--keep", "k.json", "--verdicts", "v.parquet"]
    result = call("audit", str(folder / DATA), *COLUMNS, *outputs, env={"HOME": str(folder)})
    named = [name for name in outputs[1::2] if str(folder).encode() in Path(name).read_bytes()]
    return ended(result) or differing(named, [])


def labels_file_replaced_while_the_review_runs(folder: Path) -> Found:
    """What stands in its place is left alone and named, and holds nothing up."""
    path = Path("labels.csv")
    kinds = (path.mkdir, lambda: os.mkfifo(path), lambda: None, lambda: path.symlink_to("elsewhere"))  # None: gone
    with reviewing("--no-browser") as (process, client):
        codes = [client.answer(False, "g", 1)[0], client.ask("GET", f"/api/demonstration/{'9' * 5000}")[0]]
        with socket.create_connection(("127.0.0.1", client.gate.port)) as at:  # which goes away within an answer
            head = f"POST /api/answer HTTP/1.1\r\nhost: {client.host}\r\norigin: http://{client.host}\r\n"
            head += f"x-rpil-token: {client.gate.token}\r\ncontent-type: application/json\r\ncontent-length: 90\r\n"
            at.sendall(f"{head}\r\n{{".encode())
        codes.append(client.answer(0, "g", 1)[0])
        for replace in kinds:
            path.rmdir() if path.is_dir() else path.unlink(missing_ok=True)
            replace()
            codes.append(client.answer(1, "b", 3)[0])
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=DEADLY_SECONDS)
    link = ended(call("label", DATA, *COLUMNS), "a link that leads to nothing")
    found = codes, err, "changed or removed labels.csv" in out, Path("elsewhere").exists()
    return link or differing(found, ([409, 404, 200, *[400] * 4], "", True, False))


def tiny_observations(folder: Path) -> Found:
    """Observations whose squares are no numbers are refused, and do not count as constant."""
    table, finding = pq.read_table(DATA), rpil.audit(DATA, observations=["x", "v"]).finding
    for size, names, words in ((1e-300, "xv", "smaller units"), (1e-300, "v", "smaller units"), (1e-100, "xv", "")):
        columns = {name: table[name].to_numpy() * (size if name in names else 1) for name in table.column_names}
        pq.write_table(pa.table(columns), "tiny.parquet")
        result = call("audit", "tiny.parquet", "--format", "json", *COLUMNS)
        if wrong := ended(result, words) or (not words and differing(json.loads(result.stdout)["finding"], finding)):
            return f"{names} times {size:g}: {wrong}"
    return None


def very_long_label_quoted(folder: Path) -> Found:
    """Of a long text in a file the beginning is quoted."""
    long, lists = "x y" * 30_000, [[[]] * 50] * 900
    for labels in ({"1": long}, {"1": lists}, {"1": {long: 0}}, {long: "good"}):
        Path("labels.json").write_text(json.dumps(labels))
        if wrong := ended(call("audit", DATA, "--labels", "labels.json", *COLUMNS), "labels"):
            return wrong
    return None


def damaged_files(folder: Path) -> Found:
    """A video is refused as what it is, and not for another reason."""
    video = next((lerobot_folders.write(folder / "set", [8, 8]) / "videos").rglob("*.mp4"))
    video.write_bytes(video.read_bytes().replace(b"stsz", b"free"))  # FFmpeg then says that it is not permitted
    wrong = "a damaged video is shown"
    try:
        EpisodeVideos.of("set", range(2), 20.0).frame(0, 0, 2)
    except rpil.DataError as error:
        wrong = None if "it is no video, or a damaged one" in str(error) else str(error)
    return wrong


CASES: dict[str, Callable[[Path], Found]] = {
    case.__name__.replace("_", " "): case
    for case in (
        *(order_of_demonstrations, files_beside_the_labels, ids_with_white_space),
        *(table_of_many_columns, video_times_that_are_no_numbers, secrets_in_addresses),
        *(address_of_the_review_in_the_process_list, tiny_observations, damaged_files),
        *(labels_file_replaced_while_the_review_runs, very_long_label_quoted),
    )
}


def differs(name: str) -> bool:
    """Try a case in a folder of its own, the current one, in which there is `DATA`, and print what differed."""
    start = time.monotonic()
    with TemporaryDirectory(prefix="rpil-") as folder, chdir(folder):
        asked.write(DATA)
        try:
            found = CASES[name](Path(folder).resolve())
        except Exception as error:  # of any type: it is what differed
            found = f"it raised {type(error).__name__}: {error!s:.300}"
    print(f"{name}: {found or 'as it should be'} ({time.monotonic() - start:.1f} s)", flush=True)
    return found is not None


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="NAME,NAME", help="these cases; --list names them")
    parser.add_argument("--list", action="store_true", help="name the cases, and try none")
    given = parser.parse_args(words)
    names = given.only.split(",") if given.only else [*CASES]
    if unknown := {*names} - {*CASES}:
        parser.error(f"--only: there is no case {', '.join(sorted(unknown))}; see --list")
    if given.list:
        print(*names, sep="\n")
    return int(not given.list and sum(map(differs, names)) > 0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # who ignores it, as after nohup, hands that on
    sys.exit(main())
