"""Decks with spoilt variables, in LAMMPS: `python -m benchmarks.fuzz.deck_variables COUNT [SEED [FILE]]`.

Each input is a process, `lmp` for decks that need no fix and `cmpcheck deck` for the others, with up to three
`-var NAME VALUE`.  A run that was asked to be long is ended by LAMMPS after `RUNS` seconds; what takes longer
than `SECONDS` hangs.  What is read before LAMMPS is the target `deck` of `targets.py`.
"""

from __future__ import annotations

import json
import random
import re
import subprocess
import sys
import tempfile
from collections import Counter
from functools import cache
from pathlib import Path
from typing import NamedTuple

from benchmarks.fuzz.mutations import NUMBERS, WORDS
from cmpcheck.engines.lammps_setup import Deck, deck_folder

RUNS, SECONDS = 10, 120.0  # s
WITH_FIX = 0.25  # of the inputs: they take ten times as long
VARIABLE = re.compile(r"(?m)^variable[ \t]+(\w+)[ \t]+index[ \t]+(\S+)")
REASONS = ("ERROR", "\nException: ")  # of a deck or of LAMMPS; the latter is how lmp tells one of C++
OWN = ("driver",)  # of whoever reads the deck: another value ends it by design
NOT_FINITE = re.compile(r"(?i)(?<![\w.])-?(nan|inf)(?![\w.])")
SAID = 200  # characters of an output that are told


class Input(NamedTuple):
    """A deck, and what is given to it."""

    deck: str
    with_fix: bool
    values: dict[str, str]

    def command(self) -> list[str]:
        """What is started in the folder of the deck."""
        program = Path(sys.executable).with_name("lmp")
        start = [sys.executable, "-m", "cmpcheck", "deck"] if self.with_fix else [str(program)]
        flags = [word for name, value in self.values.items() for word in ("-var", name, value)]
        return [*start, "-in", self.deck, "-log", "none", *flags]


@cache
def decks() -> dict[bool, dict[str, dict[str, str]]]:
    """The variables of the decks that ship and their values; True: of those that need the fix."""
    found: dict[bool, dict[str, dict[str, str]]] = {True: {}, False: {}}
    for path in sorted(deck_folder().glob("in.*")):
        deck = Deck.read(path)
        values = {name: value for name, value in VARIABLE.findall(deck.text) if name not in OWN}
        found[deck.external_fix is not None][path.name] = values
    return found


def draw(seed: int, k: int) -> Input:
    """Input k of a seed."""
    rng = random.Random(f"variables {seed} {k}")
    with_fix = rng.random() < WITH_FIX
    name, values = rng.choice(sorted(decks()[with_fix].items()))
    names = rng.sample(sorted(values), min(len(values), rng.choice((1, 1, 2, 3))))
    return Input(name, with_fix, {name: spoilt(values[name], rng) for name in names})


def spoilt(value: str, rng: random.Random) -> str:
    """A number of another size or sign, an odd one, or a word."""
    kind = rng.choice((0, 0, 0, 1, 2, 3))
    try:
        size = float(value)
    except ValueError:
        kind = max(kind, 2)
    if kind == 0:
        return repr(size * 10.0 ** rng.uniform(-1.5, 1.5))
    if kind == 1:
        return repr(rng.choice((-1.0, 0.0, 0.5, 2.0, 1.0 + 1e-12)) * size)
    data = rng.choice(NUMBERS if kind == 2 else WORDS)
    return data.replace(b"\0", b"").decode("utf-8", "surrogateescape")


def tried(given: Input) -> tuple[str, str]:
    """Exit code and output of an input become "taken" or "refused", or "finding" and what is wrong."""
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder:
        text = f"timer timeout {RUNS} every 100\n" + (deck_folder() / given.deck).read_text("utf-8")
        Path(folder, given.deck).write_text(text, "utf-8")
        try:
            done = subprocess.run(
                given.command(), cwd=folder, capture_output=True, stdin=subprocess.DEVNULL, timeout=SECONDS
            )
        except subprocess.TimeoutExpired:
            return "finding", f"no end in {SECONDS:g} s"
    said = (done.stdout + done.stderr).decode("utf-8", "replace")
    return judged(done.returncode, said)


def judged(code: int, said: str) -> tuple[str, str]:
    """What an exit code and an output amount to: one of "taken", "refused", "finding", and what is wrong."""
    last = " | ".join(said.split("\n")[-4:])[-SAID:]
    if "Traceback" in said:
        return "finding", f"a traceback: {last}"
    if code < 0 or code > 128:
        return "finding", f"ended by a signal, exit code {code}: {last}"
    if code == 0 and "agrees" in said and NOT_FINITE.search(said):
        return "finding", f"agrees with what is not finite: {NOT_FINITE.search(said)}"
    if code == 0:
        return "taken", ""
    lines = [line for line in said.splitlines() if line.startswith("cmpcheck: ")]
    if len(lines) > 1:
        return "finding", f"exit code {code}, {len(lines)} lines of cmpcheck: {last}"
    if not lines and not any(word in said for word in REASONS):
        return "finding", f"exit code {code} without a reason: {last}"
    return "refused", ""


def main() -> None:
    count, *rest = sys.argv[1:]
    counts: Counter[str] = Counter()
    found = []
    for k in range(int(count)):
        given = draw(int(rest[0]) if rest else 0, k)
        became, wrong = tried(given)
        counts[became] += 1
        if wrong:
            told = f"{given.deck} {' '.join(f'{n}={v[:60]!a}' for n, v in given.values.items())}: {wrong}"
            print(f"{k}: {told}", flush=True)
            found.append({"what": told, "input": k})
    print(dict(counts))
    if rest[1:]:
        Path(rest[1]).write_text(json.dumps({"counts": counts, "findings": found}), "utf-8")


if __name__ == "__main__":
    main()
