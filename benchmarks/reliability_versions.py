"""The lowest and the newest version of each dependency that pyproject.toml allows.

`python -m benchmarks.reliability_versions [--full]` prints the findings.  --full (ten minutes, with a package
index at hand) installs the wheel into an empty environment with each, and runs the cheap tests of the sdist.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from email import message_from_bytes
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

from benchmarks.reliability_finding import Finding
from benchmarks.reliability_packaging import build, environment, ran, unpacked

# tests of what stands on the libraries, in about three minutes
CHEAP = (
    "case_files", "case_optimise", "bad_input_cases", "contact", "drag", "recording", "spool", "trajectories",
    "report", "cli", "export", "plots", "lammps_engine", "fix", "statistics", "convergence",
    "optimise_methods", "optimise_cluster", "figures",
)  # fmt: skip
SHOWN = ("h5py", "lammps", "matplotlib", "meshio", "mpi4py", "numba", "numpy", "pandas", "pint", "pyarrow",
         "pydantic", "rich", "scipy", "typer")  # fmt: skip
EXTRAS = ("", "test", "cluster", "optimise")  # that of tests, and those that it contains
LINTERS = ("import-linter", "mypy", "ruff")  # tests need none, and they raise what the project asks for: rich


def findings(full: bool = False) -> Iterator[Finding]:
    """One for each end of the versions; without `full`, none."""
    if not full:
        return
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        place = Path(folder)
        sdist, wheel = build(place / "dist")
        for name, resolution in (("lowest", "lowest-direct"), ("newest", "highest")):
            yield tested(sdist, wheel, place / name, name, resolution)


def requirements(wheel: Path) -> list[str]:
    """What the wheel and its tests need, to be asked for directly: lowest-direct lowers nothing else."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        lines = message_from_bytes(archive.read(name)).get_all("Requires-Dist", [])
    found = []
    for needed in map(Requirement, lines):
        if needed.name not in ("cmpcheck", *LINTERS) and (
            needed.marker is None or any(needed.marker.evaluate({"extra": extra}) for extra in EXTRAS)
        ):
            extras = f"[{','.join(sorted(needed.extras))}]" if needed.extras else ""
            found.append(f"{needed.name}{extras}{needed.specifier}")
    return found


def at_bound(text: str, versions: dict[str, str]) -> bool:
    """Whether what is installed is the least that a requirement allows, as 2.0.0 for >=2.0."""
    needed = Requirement(text)
    (bound,) = (Version(part.version) for part in needed.specifier)
    release = Version(versions[canonicalize_name(needed.name)]).release
    return release[: len(bound.release)] == bound.release


def tested(sdist: Path, wheel: Path, folder: Path, name: str, resolution: str) -> Finding:
    """The cheap tests of the sdist with the wheel, on one end of the allowed versions."""
    programs, tree = environment(folder), unpacked(sdist, folder / "tree")
    python, asked = programs / "python", requirements(wheel)
    ran([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", "uv"], folder)
    ran([programs / "uv", "pip", "install", "-q", "--python", python, "--resolution", resolution,
         f"cmpcheck[cluster,optimise] @ {wheel.as_uri()}", *asked], folder)  # fmt: skip
    done = subprocess.run(  # not python -m pytest, which would find the packages in the tree
        [str(programs / "pytest"), "-q", "-p", "no:cacheprovider", "-W", "ignore", "-m", "not slow",
         *(f"tests/test_{part}.py" for part in CHEAP)],
        cwd=tree, capture_output=True, text=True, env=os.environ | {"NUMBA_CACHE_DIR": str(folder / "numba")},
    )  # fmt: skip
    said = done.stdout.strip().splitlines()[-1] if done.stdout.strip() else done.stderr[-300:]
    failed = re.findall(r"(?m)^(?:FAILED|ERROR) (\S+)", done.stdout)
    listed = json.loads(ran([python, "-m", "pip", "list", "--format", "json"], folder))
    versions = {canonicalize_name(entry["name"]): entry["version"] for entry in listed}
    above = [] if name != "lowest" else [text for text in asked if not at_bound(text, versions)]
    return Finding(
        f"{name} version of each dependency",
        f"uv pip install --resolution {resolution}, then the cheap tests",
        "; ".join([said.strip("= "), *failed[:5], *(f"not at its bound: {text}" for text in above)]),
        done.returncode == 0 and not above,
        {name: versions[name] for name in SHOWN if name in versions},
    )


def main() -> None:
    for finding in findings(full="--full" in sys.argv[1:]):
        print(finding.line(), flush=True)


if __name__ == "__main__":
    main()
