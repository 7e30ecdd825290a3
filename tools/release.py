"""All that a release needs: ``python tools/release.py --check``, in an environment with `pip install -e '.[dev]'`.

It checks the version and the change log, what wheel and source distribution hold, the licences of everything that is
installed with rpil and its extras, and the tests with the lowest and the newest dependencies (`tools/environments.py`).
With the newest a warning is an error, as pyproject.toml says. ``--quick`` leaves the two environments out.
The list of all dependencies, dist/sbom.json, is written in CycloneDX 1.6. The exit code is 1 where something is wrong.
"""

from __future__ import annotations

import argparse
import json
import re
import runpy
import subprocess
import sys
import tarfile
import tempfile
import tomllib
import uuid
import zipfile
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = ("plot", "gym", "torch", "dask", "zarr", "hdf5", "video", "review")
LIBRARIES_OF_SIZE = 4_000_000
"""Bytes of wheel and source distribution at most: what is bundled is a quarter of a megabyte."""

PERMISSIVE = re.compile(
    r"\b(MIT|BSD|0BSD|Apache|ISC|PSF|Python Software Foundation|CC0|Zlib|HPND|Unlicense|MIT-CMU|zlib|MPL|Mozilla)", re.I
)
"""Licences that ask for no more than to be named; MPL asks for changes of its own files alone."""

LOOKED_AT = {
    "pygame-ce": "LGPL: gymnasium draws with it, with the extra gym alone, and rpil does not hand it on",
    "nvidia": "proprietary: torch for Linux needs them, with the extra torch alone, and rpil does not hand them on",
    "cuda": "the same",
}
"""Why others are no fault, by their names or the first words of them."""

Package = dict[str, object]


def version_faults(root: Path = ROOT) -> list[str]:
    """Where version, change log and citation do not agree."""
    version = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    final, is_dev = version.partition(".dev")[0], ".dev" in version
    heading = re.search(r"^## (\S+) \((.+?)\)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    citation = re.search(r"^version: (\S+)$", (root / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    faults = []
    if re.fullmatch(r"\d+\.\d+\.\d+(\.dev\d+)?", version) is None:
        faults.append(f"pyproject.toml: {version} is no semantic version")
    if heading is None or heading[1] != final:
        faults.append(f"CHANGELOG.md: the first section is not {final}")
    elif is_dev != (heading[2] == "unreleased"):
        faults.append(f"CHANGELOG.md: {final} ({heading[2]}) and version {version}: a release has a date and no .dev")
    if citation is None or citation[1] != version:
        faults.append(f"CITATION.cff: the version is not {version}")
    return faults


def contents_faults(wheel: Path, source: Path, root: Path = ROOT) -> list[str]:
    """Where the built files hold too much or too little."""
    library = {path.relative_to(root / "src") for path in (root / "src" / "rpil").rglob("*") if path.is_file()}
    wanted = {path.as_posix() for path in library if "__pycache__" not in path.parts}
    in_wheel = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    with tarfile.open(source) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    wanted_of_source = {f"src/{name}" for name in wanted} | {"pyproject.toml", "LICENSE", "NOTICE", "README.md"}
    faults = [f"{wheel.name}: {name} is missing" for name in sorted(wanted - in_wheel)]
    faults += [f"{wheel.name}: {name} is not of the library" for name in sorted(in_wheel - wanted)]
    faults += [f"{source.name}: {name} is missing" for name in sorted(wanted_of_source - names)]
    faults += [f"{source.name}: holds {name}" for name in sorted(names) if name.startswith(("tests/", "benchmarks/"))]
    large = [path for path in (wheel, source) if path.stat().st_size > LIBRARIES_OF_SIZE]
    return faults + [f"{path.name}: {path.stat().st_size:,} bytes" for path in large]


# ---- dependencies ----------------------------------------------------------------------------------------------------


def needs_of(name: str, extras: Iterable[str] = ()) -> list[tuple[str, tuple[str, ...]]]:
    """What a package needs, each with its extras; what needs an extra that is not asked for is left out."""
    found = []
    for line in metadata.requires(name) or ():
        need, _, marker = line.partition(";")
        wanted = re.findall(r"extra\s*==\s*[\"']([\w.-]+)", marker)
        parts = re.match(r"\s*([\w.-]+)\s*(?:\[([\w,\s.-]+)\])?", need)
        if parts is not None and (not wanted or set(wanted) & set(extras)):
            asked = tuple(extra.strip() for extra in (parts[2] or "").split(",") if extra.strip())
            found.append((parts[1].lower().replace("_", "-"), asked))
    return found


def dependencies(extras: Iterable[str] = EXTRAS) -> dict[str, Package]:
    """Everything that is installed of what rpil needs, directly or not: version, licence, and needs of its own."""
    found: dict[str, Package] = {}
    queue = needs_of("rpil", extras)
    while queue:
        name, asked = queue.pop()
        try:
            about = metadata.metadata(name)
        except metadata.PackageNotFoundError:  # of another platform, or an extra that is not installed here
            continue
        if name == "rpil" or name in found:
            continue
        needs = needs_of(name, asked)
        found[name] = {
            "version": about["Version"],
            "licence": licence_of(about),
            "needs": sorted({n for n, _ in needs}),
        }
        queue += needs
    return dict(sorted(found.items()))


def licence_of(about: metadata.PackageMetadata) -> str:
    """The licence of a package: its expression, its classifiers, or the first line of its text."""
    text = (about.get_all("License") or [""])[0].strip()
    kinds = [value.rpartition(" :: ")[2] for value in about.get_all("Classifier") or () if value.startswith("License")]
    if "License-Expression" in about:
        return str(about["License-Expression"])
    return ", ".join(kinds) if kinds else text.partition("\n")[0][:80]


def licence_faults(found: dict[str, Package]) -> list[str]:
    return [
        f"{name}: its licence is {each['licence'] or 'not said'!r}; look at it"
        for name, each in found.items()
        if not {name, name.partition("-")[0]} & {*LOOKED_AT} and not PERMISSIVE.search(str(each["licence"]))
    ]


def bill_of_materials(found: dict[str, Package]) -> dict[str, object]:
    """The list of the dependencies in CycloneDX 1.6; the same list has the same serial number."""

    def component(name: str, kind: str, version: object, licence: object) -> dict[str, object]:
        purl = f"pkg:pypi/{name}@{version}"
        about = {"type": kind, "bom-ref": purl, "name": name, "version": version, "purl": purl}
        return about | {"licenses": [{"license": {"name": licence}}]}

    own = component("rpil", "library", PROJECT["version"], PROJECT["license"])
    parts = [component(name, "library", each["version"], each["licence"]) for name, each in found.items()]
    refs = {str(each["name"]): str(each["bom-ref"]) for each in (own, *parts)}
    needs = {"rpil": [name for name, _ in needs_of("rpil", EXTRAS)]} | {name: found[name]["needs"] for name in found}
    graph = [
        {"ref": refs[name], "dependsOn": sorted({refs[need] for need in wanted if need in refs})}  # type: ignore[union-attr]
        for name, wanted in needs.items()
    ]
    body = {"metadata": {"component": own}, "components": parts, "dependencies": graph}
    serial = uuid.uuid5(uuid.NAMESPACE_URL, json.dumps(body, sort_keys=True))
    return {"bomFormat": "CycloneDX", "specVersion": "1.6", "serialNumber": f"urn:uuid:{serial}", "version": 1} | body


# ---- all of it -------------------------------------------------------------------------------------------------------


def check(quick: bool) -> list[str]:
    """Everything, one line printed for each; returns what is wrong."""
    faults = version_faults()
    print(f"version {PROJECT['version']}, change log, citation: {len(faults)} faults", flush=True)
    found = dependencies()
    faults += licence_faults(found)
    (ROOT / "dist").mkdir(exist_ok=True)
    (ROOT / "dist" / "sbom.json").write_text(json.dumps(bill_of_materials(found), indent=1) + "\n", encoding="utf-8")
    print(f"licences of {len(found)} packages; dist/sbom.json", flush=True)
    environments = runpy.run_path(str(ROOT / "tools" / "environments.py"))
    with tempfile.TemporaryDirectory(prefix="rpil-") as folder:
        wheel = environments["build"](Path(folder))
        (source,) = wheel.parent.glob("*.tar.gz")
        wrong = contents_faults(wheel, source)
        print(f"{wheel.name}: {wheel.stat().st_size:,} bytes; {source.name}; {len(wrong)} faults", flush=True)
    faults += wrong
    for versions in () if quick else ("lowest", "newest"):
        command = [sys.executable, str(ROOT / "tools" / "environments.py"), versions]
        if subprocess.run(command, check=False).returncode:
            faults.append(f"{versions} dependencies: tests fail")
    return faults


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", required=True, help="check all, and publish nothing")
    parser.add_argument("--quick", action="store_true", help="without the tests in environments of their own")
    faults = check(parser.parse_args().quick)
    print("\n".join(faults) or "Ready.")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
