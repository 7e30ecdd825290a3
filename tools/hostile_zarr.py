"""Zarr stores that run a command when they are decoded, and a proof that rpil runs none: ``tools/hostile_zarr.py``.

They name the codec ``pickle``, which numcodecs before 0.16.6 calls with the contents of the file. The script installs
zarr 3.1.6 and numcodecs 0.16.5 with rpil in a temporary environment, shows that the stores do run their command when
zarr opens them there, and that no command of rpil lets them.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from zipfile import ZipFile

ROOT = Path(__file__).parents[1]
VERSIONS = ("zarr==3.1.6", "numcodecs==0.16.5")
FILTER = {"dtype": "|O", "filters": [{"id": "vlen-utf8"}, {"id": "pickle"}]}
COMPRESSOR = {"dtype": "|O", "filters": [{"id": "vlen-utf8"}], "compressor": {"id": "pickle"}}
PLACES = {
    "ends-filter": ("meta/episode_ends", FILTER),
    "ends-compressor": ("meta/episode_ends", COMPRESSOR),
    "data-filter": ("data/task", FILTER),
}
"""Where the codec is named: the array, and what its header says otherwise than that of a sound store."""

DISGUISES = ("{}.zarr", "{}.zarr.zip", "{}.npz", "{}.csv")


def write_store(folder: Path, place: str, marker: Path) -> None:
    """Write a store of 4 steps to `folder`, sound but for one array: to decode it makes the file `marker`."""
    arrays = {"meta/episode_ends": ([2], "<i8"), "data/action": ([4, 1], "<f4"), "data/state": ([4, 2], "<f4")}
    hostile, changes = PLACES[place]
    for name, (shape, dtype) in (arrays | {hostile: arrays.get(hostile, ([4], "|O"))}).items():
        header = {"zarr_format": 2, "shape": shape, "chunks": shape, "dtype": dtype, "compressor": None}
        header |= {"filters": None, "fill_value": 0, "order": "C"}
        (folder / name).mkdir(parents=True)
        (folder / name / ".zarray").write_text(json.dumps(header | (changes if name == hostile else {})))
        sound = b"\2\0\0\0\0\0\0\0\4\0\0\0\0\0\0\0" if dtype == "<i8" else bytes(32 if shape[-1] == 2 else 16)
        # By hand, so that nothing here needs pickle: call os.system with one text.
        content = f"cos\nsystem\n(S'touch {marker}'\ntR.".encode() if name == hostile else sound
        (folder / name / ("0.0" if len(shape) == 2 else "0")).write_bytes(content)


def disguise(folder: Path, path: Path) -> None:
    """Write the store in `folder` to `path`: as a folder, a ZIP file, or, for a CSV, a table before a ZIP file."""
    if path.suffix == ".zarr":
        shutil.copytree(folder, path)
        return
    if path.suffix == ".csv":
        path.write_text("episode_index,observation.x,action\n0,0.1,0\n0,0.2,1\n1,0.3,0\n1,0.1,1\n")
    with ZipFile(path, "a") as archive:
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            archive.write(file, file.relative_to(folder))


def _runs(command: list[str], marker: Path) -> tuple[bool, str]:
    """Whether a command made the marker, and the end of what it said."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    ran = marker.exists()
    marker.unlink(missing_ok=True)
    said = (done.stderr or done.stdout).strip().splitlines() or ["nothing"]
    return ran, said[-1][:150]


def _install(folder: Path) -> Path:
    """A new environment with rpil and the old `VERSIONS`: its programs."""
    venv.create(folder, with_pip=True)
    pip = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet"]
    subprocess.run([*pip, str(ROOT)], check=True)
    subprocess.run([*pip, *VERSIONS], check=True)
    return folder / "bin"


def main() -> int:
    """Print a line for each store and command; 1 where rpil ran what is in one, or where zarr did not."""
    failed = False
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        programs, marker = _install(work / "env"), work / "marker"
        python, rpil = str(programs / "python"), str(programs / "rpil")
        for place, (array, _) in PLACES.items():
            store = work / place
            write_store(store, place, marker)
            ran, said = _runs(
                [python, "-c", f"import zarr; zarr.open_array({str(store)!r}, path={array!r})[...]"], marker
            )
            failed |= not ran
            print(f"{place:22} opened by zarr: {'it RAN, as it must' if ran else f'nothing ran: {said}'}")
            for pattern in DISGUISES:
                path = str(work / pattern.format(place))
                disguise(store, Path(path))
                keep = f"from rpil.formats.registry import find; find({path!r}).keep({str(work / 'ids.json')!r}, [0])"
                calls = {command: [rpil, command, path] for command in ("info", "check", "audit")}
                calls |= {"read": [python, "-c", f"import rpil; rpil.read({path!r})"], "keep": [python, "-c", keep]}
                for what, call in calls.items():
                    ran, said = _runs(call, marker)
                    failed |= ran
                    print(f"{Path(path).name:22} {what:5} {'it RAN' if ran else 'nothing ran'}: {said}", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
