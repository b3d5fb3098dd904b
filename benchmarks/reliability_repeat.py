"""The same bits: one run and one comparison, repeated under other circumstances, digest by digest.

`python -m benchmarks.reliability_repeat [--full]` prints the findings.  The locale is German, whose decimal
mark is a comma, set for C and Python alike; where the system has none it is compiled from its sources.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from benchmarks.reliability_digests import digests_of, json_digest
from benchmarks.reliability_finding import Finding
from reference.case import load_case

GERMAN, EAST = "de_DE.UTF-8", "Pacific/Kiritimati"
MAIN = "import locale; locale.setlocale(locale.LC_ALL, ''); from cmpcheck.cli import main; main()"
DURATION = 0.2e-3  # s of polish_full
COMPARED = ("drag_relaxation", "pair_slip", "--engine", "lammps")


def findings(full: bool = False) -> list[Finding]:
    """One finding for each circumstance; without `full`, of the run only."""
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as place:
        folder = Path(place)
        case = load_case("polish_full")
        header = case.case.model_copy(update={"duration": DURATION})
        case.model_copy(update={"case": header}).save(folder / "case.toml")
        tried = circumstances(folder)
        expected = _run(folder, folder / "first", {}) | (_compare(folder / "first", {}, 1) if full else {})
        found = []
        for name, (done, environment, where) in tried.items():
            got = _run(folder, where, environment) | (_compare(where, environment, 1) if full else {})
            found.append(_finding(name, done, expected, got))
        if full:
            got = _compare(folder / "two", {}, 2)
            compared = {key: value for key, value in expected.items() if key.startswith("compare/")}
            done = "The comparison with --jobs 2 against --jobs 1."
            found.append(_finding("two workers", done, compared, got))
        return found


Circumstance = tuple[str, dict[str, str], Path]


def circumstances(folder: Path) -> dict[str, Circumstance]:
    """What was changed, the variables of the environment, and the folder to work in, by name."""
    cold = {"NUMBA_CACHE_DIR": str(folder / "compiled")}
    tried: dict[str, Circumstance] = {
        "again": ("The same commands once more.", {}, folder / "again"),
        "one thread": ("NUMBA_NUM_THREADS=1, OMP_NUM_THREADS=1.", _threads(1), folder / "thread"),
        "two threads": ("NUMBA_NUM_THREADS=2, OMP_NUM_THREADS=2.", _threads(2), folder / "threads"),
        "another folder": ("A path with spaces and letters beyond ASCII.", {}, folder / "ein Ordner, ü"),
        "another time zone": ("TZ=Pacific/Kiritimati, 14 hours ahead.", {"TZ": EAST}, folder / "tz"),
        "nothing compiled yet": ("An empty folder of compiled code.", cold, folder / "cold"),
        "everything compiled": ("The same folder again.", cold, folder / "warm"),
    }
    german = german_locale(folder / "locale")
    if german is None:
        where = {"LC_ALL": "C"}
        tried["another locale"] = ("LC_ALL=C; the system has no German one.", where, folder / "c")
    else:
        tried["another locale"] = (f"LC_ALL={GERMAN}, decimal comma.", german, folder / "de")
    return tried


def _threads(number: int) -> dict[str, str]:
    return dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS"), str(number))


def german_locale(folder: Path) -> dict[str, str] | None:
    """The environment for it, made in `folder` where the system has none; None where that cannot be done."""
    test = "import locale; locale.setlocale(locale.LC_ALL, ''); assert locale.str(0.5) == '0,5'"
    check = [sys.executable, "-c", test]
    plain = {"LC_ALL": GERMAN}
    for environment in (plain, plain | {"LOCPATH": str(folder)}):
        if "LOCPATH" in environment:
            if shutil.which("localedef") is None:
                return None
            folder.mkdir()
            made = ["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / GERMAN)]
            subprocess.run(made, capture_output=True)
        if subprocess.run(check, env=os.environ | environment, capture_output=True).returncode == 0:
            return environment
    return None


def _run(folder: Path, where: Path, environment: Mapping[str, str]) -> dict[str, str]:
    _call(where, environment, "run", str(folder / "case.toml"), "--out", "run")
    return {f"run/{name}": digest for name, digest in digests_of(where / "run").items()}


def _compare(where: Path, environment: Mapping[str, str], jobs: int) -> dict[str, str]:
    _call(where, environment, "compare", *COMPARED, "--jobs", str(jobs), "--out", "report")
    found = digests_of(where / "report" / "data")
    found["report.json"] = json_digest(json.loads((where / "report" / "report.json").read_text("utf-8")))
    return {f"compare/{name}": digest for name, digest in found.items()}


def _call(where: Path, environment: Mapping[str, str], *words: str) -> None:
    where.mkdir(exist_ok=True)
    paths = os.pathsep.join(filter(None, (str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", ""))))
    done = subprocess.run(
        [sys.executable, "-c", MAIN, *words], cwd=where, env=os.environ | {"PYTHONPATH": paths} | environment,
        capture_output=True, text=True,
    )  # fmt: skip
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(words)}: exit code {done.returncode}: {done.stderr.strip()[-500:]}")


def _finding(name: str, done: str, expected: Mapping[str, str], got: Mapping[str, str]) -> Finding:
    differ = sorted(key for key in expected.keys() | got.keys() if expected.get(key) != got.get(key))
    outcome = f"{len(expected) - len(differ)} of {len(expected)} digests are the same"
    outcome += f"; not {', '.join(differ[:3])}" if differ else ""
    return Finding(name, done, outcome, not differ and bool(expected), {"digests": float(len(expected))})


if __name__ == "__main__":
    for found in findings("--full" in sys.argv):
        print(found.line(), flush=True)
