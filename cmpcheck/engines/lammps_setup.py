"""From a setup to LAMMPS: the deck of a case, its variables, its atoms.

No simulation here (`lammps.py`), and no running of a deck on its own (`cmpcheck/deck.py`).  Decks are in
`units micro`: um, us and pg, in which a speed in m/s is the same number.
"""

from __future__ import annotations

import hashlib
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import cmpcheck
from cmpcheck.display import printable
from cmpcheck.engines.lammps_library import EngineError, error_message, per_atom
from cmpcheck.engines.protocol import Resolution
from cmpcheck.fixes.layout import MICRO, PICOGRAM
from reference.state import Setup, State


class DeckUnits(NamedTuple):
    """The units of a deck, in SI; lengths are um and times us, so that a speed in m/s is the same number."""

    mass: float  # kg
    density: float  # kg/m3
    viscosity: float  # Pa s


MICRO_UNITS = DeckUnits(PICOGRAM, 1e3, 1e-3)  # pg/um3, pg/(um us)

EXTERNAL_FIX = re.compile(r"^[ \t]*fix[ \t]+(\S+)[ \t]+\S+[ \t]+external[ \t]+pf/callback\b.*$", re.MULTILINE)
DRIVER_LINE = re.compile(r"^[ \t]*if[ \t]+\"\$\{driver\}", re.MULTILINE)
QUIT = re.compile(r'(?m)(^[ \t]*|")quit([ \t]+\d+)?([ \t]*(?:#.*)?$|")')
NO_QUIT = "this_deck_quits"

LAST, LONGEST = 3, 200  # lines of a log that are quoted, and characters of each
SOURCE = re.compile(r" ?\(\S*src/\S+\)")


@dataclass(frozen=True)
class Deck:
    """A LAMMPS input script, and the two lines in it that cmpcheck looks for."""

    path: Path
    text: str

    @classmethod
    def read(cls, path: Path) -> Deck:
        """The deck in a file.  Raises EngineError for one that cannot be read."""
        try:
            return cls(path, path.read_text("utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise EngineError(f"{path}: {getattr(error, 'strerror', None) or 'not a text file'}") from None

    @property
    def digest(self) -> str:
        """SHA-256 of its text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def external_fix(self) -> str | None:
        """ID of its `fix ID group external pf/callback`, None without one."""
        match = EXTERNAL_FIX.search(self.text)
        return match.group(1) if match else None

    @property
    def external_line(self) -> str:
        """The line that defines that fix, "" without one."""
        match = EXTERNAL_FIX.search(self.text)
        return match.group() if match else ""

    def definitions(self) -> str:
        """What stands above the line `if "${driver}`: box, styles and fixes, but no atoms.

        A `quit` in it, which would end this process, becomes an unknown command, which LAMMPS reports.
        Raises EngineError when there is no such line.
        """
        match = DRIVER_LINE.search(self.text)
        if match is None:
            raise EngineError(
                f'{self.path}: no line begins with  if "${{driver}}  : cmpcheck reads a deck down to there; '
                "put it between the definitions (box, styles, fixes) and the atoms, as in the decks that ship"
            )
        return QUIT.sub(rf"\1{NO_QUIT}\3", self.text[: match.start()])

    def around_fix(self) -> tuple[str, str]:
        """The deck down to its external fix, included, and the rest."""
        match = EXTERNAL_FIX.search(self.text)
        end = match.end() if match else len(self.text)
        return self.text[:end] + "\n", self.text[end:]


def deck_folder() -> Path:
    """Where the decks that ship are: in a checkout or in an installed package."""
    package = Path(cmpcheck.__file__).parent
    folder = package / "lammps_inputs"
    return folder if folder.is_dir() else package.parent / "lammps_inputs"


def deck_path(case_name: str, engine: str = "") -> Path:
    """The deck that ships for a case: in.CASE for LAMMPS, ENGINE/in.CASE for another engine.

    Raises EngineError when there is none.
    """
    folder = deck_folder() / engine
    path = folder / f"in.{case_name}"
    if path.is_file():
        return path
    names = sorted(path.name[3:] for path in folder.glob("in.*"))
    what = (engine or "lammps").upper()
    raise EngineError(f"no {what} deck for the case {case_name}; there are decks for {', '.join(names)}")


def departure_deck(name: str) -> Path:
    """Where the deck of a known departure is, if there is one."""
    return deck_folder() / "departures" / name


def execute(lmp: Any, text: str, name: Path) -> None:
    """Run a part of the deck `name`; loops with `label` and `jump SELF` work within it.

    Raises EngineError with LAMMPS's message.
    """
    with tempfile.TemporaryDirectory(prefix="cmpcheck-") as folder:
        part = Path(folder) / name.name
        part.write_text(text, "utf-8")
        try:
            lmp.file(str(part))
        except Exception as error:  # the lammps package raises Exception itself
            if type(error).__name__ == "MPIAbortException":  # on this rank only: the others would wait
                print(f"cmpcheck: {name}: {error_message(error)}", flush=True)
                lmp.get_mpi_comm().Abort(1)
            raise EngineError(f"{name}: {error_message(error)}".replace(str(part), str(name))) from None


def variables(
    setup: Setup, resolution: Resolution, time_step: float, units: DeckUnits = MICRO_UNITS
) -> dict[str, float | str]:
    """Values, in the deck's units, of the index variables that decks read; each deck uses those it declares.

    Raises EngineError where the contact law of LAMMPS and LIGGGHTS cannot express the setup.
    """
    model, state = setup.model, setup.state
    if model.static_friction != model.dynamic_friction:
        raise EngineError(
            f"contact.static_friction = {model.static_friction:g} and dynamic_friction = "
            f"{model.dynamic_friction:g}: the engine's contact law has one coefficient, they must be equal"
        )
    z, room = state.position[:, 2], float(state.diameter.max())
    periodic = model.length_z > 0.0
    return {
        "length_x": model.length_x / MICRO,
        "length_y": model.length_y / MICRO,
        "z_low": 0.0 if periodic else min(0.0, float(z.min()) - room) / MICRO,
        "z_high": (model.length_z if periodic else float(z.max()) + room) / MICRO,
        "boundary_z": "p" if periodic else "m",
        "restitution": model.restitution,
        "friction": model.dynamic_friction,
        "contact_duration": resolution.contact_duration / MICRO,
        "pair_ratio": resolution.pair_ratio,
        "steps_per_contact": min(1.0, resolution.pair_ratio) * resolution.contact_duration / time_step,
        "time_step": time_step / MICRO,
        "effective_mass": effective_mass(state, setup.copies) / units.mass,
        "fluid_density": model.fluid_density / units.density,
        "viscosity": model.viscosity / units.viscosity,
        "flow_x": model.flow_x,
        "flow_y": model.flow_y,
        "flow_z": model.flow_z,
        "wall_speed": model.wall_speed,
        "gap": model.gap / MICRO,
    }


def input_flags(values: Mapping[str, float | str]) -> list[str]:
    """Variables as flags of a command line: -var NAME VALUE."""
    return [
        word
        for key, value in values.items()
        for word in ("-var", key, value if isinstance(value, str) else repr(float(value)))
    ]


def last_words(path: Path, noise: re.Pattern[str]) -> str:
    """The last lines of what an engine wrote, in brackets and in one line; lines with noise are left out."""
    try:
        lines = path.read_text("utf-8", "replace").splitlines()
    except OSError:
        return ""
    told = [printable(SOURCE.sub("", line)).strip()[:LONGEST] for line in lines if not noise.search(line)]
    told = [line for line in told if line][-LAST:]
    return f" (log: {' | '.join(told)})" if told else ""


def effective_mass(state: State, copies: int) -> float:
    """The m* (kg) of the pair whose contact lasts t_c: that of a lone pair, or of two mean particles.

    LAMMPS's spring has one stiffness: contacts of other pairs last longer by the root of their m*.
    """
    m_i = m_j = float(state.mass.mean())
    if len(state.mass) == 2 * copies:
        m_i, m_j = float(state.mass.min()), float(state.mass.max())
    return m_i * m_j / (m_i + m_j)


def create_atoms(lmp: Any, state: State) -> None:
    """Put the particles of a state into LAMMPS: particle i becomes the atom with tag i + 1.

    Raises EngineError when LAMMPS takes not all of them.
    """
    n = len(state.mass)
    tags = list(range(1, n + 1))
    positions = (state.position / MICRO).ravel().tolist()
    lmp.create_atoms(n, tags, [1] * n, positions, state.velocity.ravel().tolist())
    if lmp.get_natoms() != n:
        made = int(lmp.get_natoms())
        raise EngineError(f"LAMMPS has created {made} of {n} particles: some lie outside the box")
    local = lmp.extract_setting("nlocal")
    index = np.array(lmp.numpy.extract_atom("id", nelem=local), dtype=np.int64).reshape(-1) - 1
    per_atom(lmp, "radius", local, 1)[:] = state.diameter[index] / 2 / MICRO
    per_atom(lmp, "rmass", local, 1)[:] = state.mass[index] / PICOGRAM
