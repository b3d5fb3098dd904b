"""Good inputs to start from, made by the project itself; the trajectories are right."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

import meshio
import numpy as np
import pandas as pd

from cmpcheck.engines.lammps_setup import deck_folder
from cmpcheck.export import export_run
from cmpcheck.optimise.problem import Sample
from cmpcheck.optimise.store import FILE, Evaluated, Store
from reference.case import CASES, Case, load_case
from reference.recording import Run
from reference.simulation import simulate

OUTPUTS = 6  # of a trajectory
OPTIMISED = "table_1"  # the case of an optimisation
CUT = b"\x00FILE\x00"  # between the files of one input

TEXTS = (
    b"0.9 um", b"1 mPa s", b"4 psi", b"3950 kg/m^3", b"-1.5e-3 m/s", b"length=um,time=us,mass=pg", b"micro",
    b"10 ps", b"1 m**2/s**2", b"0 s", b"1 degC", b"1 um um", b"1e999 m",
)  # fmt: skip


@functools.cache
def pair() -> Case:
    """Two spheres, head on: the case that the trajectories are of."""
    case = load_case("pair_head_on").variants()[0]
    return case.replaced({"case.outputs": OUTPUTS})


@functools.cache
def right_run() -> Run:
    """What a right trajectory holds."""
    return simulate(pair())


def cases() -> list[bytes]:
    """The cases that ship."""
    return [path.read_bytes() for path in sorted(CASES.glob("*.toml"))]


def _rows() -> pd.DataFrame:
    run = right_run()
    times, count = run.masses.shape
    columns = np.column_stack(
        [run.positions.reshape(-1, 3), run.velocities.reshape(-1, 3), run.masses.ravel()]
    )
    rows = pd.DataFrame(columns, columns=["x", "y", "z", "vx", "vy", "vz", "mass"])
    rows.insert(0, "particle", np.tile(np.arange(count), times))
    rows.insert(0, "time", np.repeat(run.times, count))
    return rows


def tables() -> list[bytes]:
    """CSV files, with and without velocities and statements."""
    rows = _rows()
    stated = "# units: si\n# time_step: 2e-11\n# contact_duration: 0\n"
    return [
        text.encode()
        for text in (
            stated + rows.to_csv(index=False),
            "# units: si\n" + rows.drop(columns=["vx", "vy", "vz", "mass"]).to_csv(index=False),
            rows.to_csv(index=False, sep=" "),
        )
    ]


def parquets() -> list[bytes]:
    """Parquet files, plain and compressed."""
    rows, found = _rows(), []
    rows.attrs = {"units": "si"}
    with tempfile.TemporaryDirectory() as folder:
        for compression in (None, "zstd"):
            rows.to_parquet(Path(folder) / "a.parquet", compression=compression)
            found.append((Path(folder) / "a.parquet").read_bytes())
    return found


def dumps() -> list[bytes]:
    """A dump with units and times, and one with steps for times."""
    with tempfile.TemporaryDirectory() as folder:
        (path,) = export_run(right_run(), "dump", Path(folder) / "out")
        text = path.read_bytes()
    bare = text.replace(b"ITEM: UNITS\nmicro\n", b"")
    return [text, bare]


def series() -> list[bytes]:
    """An index and one of its files: as XML with text, and as JSON with a binary file."""
    run, found = right_run(), []
    with tempfile.TemporaryDirectory() as folder:
        for form in ("ascii", "binary"):
            files = []
            for k in range(len(run.times)):
                points, number = run.positions[k], np.arange(len(run.diameters))
                data = {"velocity": run.velocities[k], "particle": number, "mass": run.masses[k]}
                mesh = meshio.Mesh(points, [("vertex", number.reshape(-1, 1))], point_data=data)
                path = Path(folder) / f"p{k}.vtu"
                meshio.vtu.write(path, mesh, binary=form == "binary")
                files.append(path.read_bytes())
            entries = "".join(
                f'<DataSet timestep="{time!r}" part="0" file="p{k}.vtu"/>\n'
                for k, time in enumerate(run.times.tolist())
            )
            index = f'<VTKFile type="Collection" units="si"><Collection>\n{entries}</Collection></VTKFile>\n'
            found.append(CUT.join([index.encode(), *files]))
    return found


def decks() -> list[bytes]:
    """Decks that ship, with flags."""
    flags = b"-in\nin.case\n-var\ndriver\nmine\n-log\nnone"
    paths = [path for path in sorted(deck_folder().glob("in.*")) if path.is_file()]
    return [flags + CUT + path.read_bytes() for path in paths[:6]]


def folders() -> list[bytes]:
    """What a recipe is made of, see `targets.folder`: which file, how, and where."""
    return [bytes([k, how]) + bytes(range(10, 42)) for k in range(9) for how in range(3)]


def stores() -> list[bytes]:
    """Two strings with their samples and a state."""
    with tempfile.TemporaryDirectory() as folder:
        made = Store.create(Path(folder) / "out", load_case(OPTIMISED), force=False)
        for n, string in enumerate([(1.0, 73, 9e-7, 0.1), (2.0, 50, 6e-7, 0.16)]):
            number = made.number_of(string)
            samples = [(number, k, Sample(0.5, 0.5, 1e-9, 1e-15, 2.0, "")) for k in range(15)]
            made.add_samples(samples)
            made.add_result(number, Evaluated(string, 0.5, 0.01, 15, True))
            made.add_asked("genetic", n, 0, ["random"], [number])
        made.save_state(1, {"population": [[1.0, 73]], "costs": [0.5]})
        made.close()
        return [(Path(folder) / "out" / FILE).read_bytes()]


SEEDS = {
    "case": cases,
    "table": tables,
    "parquet": parquets,
    "dump": dumps,
    "series": series,
    "text": lambda: list(TEXTS),
    "deck": decks,
    "folder": folders,
    "store": stores,
}
