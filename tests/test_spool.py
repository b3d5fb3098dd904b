"""Laws of spool.py: what a run records may lie on the disk meanwhile, and nothing else depends on where."""

from __future__ import annotations

import hashlib
import json
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from reference import recording, simulation, spool
from reference.case import Case, CaseError, load_case
from reference.checkpoint import Checkpoint
from reference.ledger import COLUMNS, empty_ledger
from reference.process import build_setup
from reference.recording import TRAJECTORY, Run
from reference.simulation import simulate

RECORDED = ("case.toml", "trajectory.h5", "contacts.parquet", "history.parquet")


def shortened(**header) -> Case:
    case = load_case("polish_full").variants()[0]
    return case.model_copy(update={"case": case.case.model_copy(update=header)})


POLISH = shortened(duration=0.2e-3, outputs=16)  # 5000 contacts and more


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Run, Path]:
    """A run that was in memory until its end."""
    folder = tmp_path_factory.mktemp("whole")
    return simulate(POLISH, folder), folder


def digests(folder: Path) -> dict[str, str]:
    found = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in RECORDED}
    provenance = json.loads((folder / "provenance.json").read_text("utf-8"))
    del provenance["timing"]
    return found | {"provenance": json.dumps(provenance)}


@pytest.mark.parametrize("least", [0, 7_777, 200_000])
def test_where_the_rows_are_meanwhile_changes_no_byte(tmp_path, whole, monkeypatch, least):
    """Every frame by itself, some rows at a time, and parts that are cut anywhere."""
    monkeypatch.setattr(spool, "SPILL_BYTES", least)
    spilled, spill = [], Checkpoint.spill
    monkeypatch.setattr(
        Checkpoint, "spill", lambda self, rows: spilled.append(len(rows["ledger"])) or spill(self, rows)
    )
    run = simulate(POLISH, tmp_path, checkpoint_interval=np.inf)
    assert len(spilled) >= 3
    assert sum(spilled) > 3_000
    assert digests(tmp_path) == digests(whole[1])
    for name in TRAJECTORY:
        assert getattr(run, name).tobytes() == getattr(whole[0], name).tobytes()
    assert run.contacts.equals(whole[0].contacts)
    assert run.history.equals(whole[0].history)


def test_a_run_that_was_interrupted_goes_on_from_spilled_rows(tmp_path, whole, monkeypatch):
    """Those before a checkpoint are kept, those after it are written over: it may have been killed there."""
    monkeypatch.setattr(spool, "SPILL_BYTES", 20_000)

    def stop(done: float) -> None:
        if done > 0.7:
            raise KeyboardInterrupt

    ticks = iter(np.arange(1000.0))
    with monkeypatch.context() as patch:  # one checkpoint, and parts between and after
        patch.setattr(simulation, "perf_counter", lambda: next(ticks))
        with pytest.raises(KeyboardInterrupt):
            simulate(POLISH, tmp_path, stop, checkpoint_interval=4.0)
    written = {path.name for path in (tmp_path / "checkpoint").glob("part-*")}
    named = set(json.loads((tmp_path / "checkpoint" / "checkpoint.json").read_text())["parts"])
    assert len(named) > 2
    assert named < written
    simulate(POLISH, tmp_path, resume=True, checkpoint_interval=np.inf)
    assert digests(tmp_path) == digests(whole[1])


@pytest.mark.parametrize("lost", ["ledger", "frames"])
def test_a_part_that_is_forgotten_is_seen(tmp_path, whole, monkeypatch, lost):
    """The twin of the tests above."""
    monkeypatch.setattr(spool, "SPILL_BYTES", 20_000)
    read = spool.read_rows

    def forget(files, keys):
        keys = tuple(keys)
        for k, rows in enumerate(read(files, keys)):
            if k != 1 or (keys == ("ledger",)) != (lost == "ledger"):
                yield rows

    monkeypatch.setattr(spool, "read_rows", forget)
    simulate(POLISH, tmp_path, checkpoint_interval=np.inf)
    assert digests(tmp_path) != digests(whole[1])


def test_memory_does_not_grow_with_the_rows(tmp_path, monkeypatch):
    """Ten times as many rows and frames, the same peak; without a checkpoint ten times as much."""
    monkeypatch.setattr(spool, "SPILL_BYTES", 200_000)
    monkeypatch.setattr(recording, "ROW_GROUP", 1_000)
    setup = build_setup(POLISH)
    frame = dict(zip(TRAJECTORY, (setup.state.position, setup.state.velocity, setup.state.mass), strict=True))
    row = dict.fromkeys(spool.COLUMNS, 1.0)

    def peak(frames: int, on_disk: bool) -> int:
        checkpoint = Checkpoint(tmp_path / "run", setup) if on_disk else None
        if checkpoint is not None:
            checkpoint.start()
        tracemalloc.start()
        held = spool.Spool(checkpoint, len(setup.state.mass))
        for k in range(frames):
            held.add_frame(float(k), frame, row)
            held.add_contacts(empty_ledger(300) + k % 3)
        recording._write_ledger(tmp_path / "contacts.parquet", held.contacts())
        found = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert pq.read_metadata(tmp_path / "contacts.parquet").num_rows == 300 * frames
        return found

    rows = 8 * len(COLUMNS) * 300  # bytes of a frame's rows, 53 kB; its history and time stay, 1.2 kB
    few, many = peak(40, on_disk=True), peak(400, on_disk=True)
    assert many - few < 360 * 0.1 * rows
    assert peak(400, on_disk=False) > 400 * rows


def test_what_was_opened_reads_the_rest_when_it_is_asked_for(tmp_path, whole):
    source = whole[1]
    run = Run.open(source)
    assert not {"contacts", *TRAJECTORY} & set(run.__dict__)
    assert run.contacts.equals(whole[0].contacts)
    assert np.array_equal(run.positions, whole[0].positions)
    with pytest.raises(AttributeError, match="no attribute 'energies'"):
        run.energies  # noqa: B018
    for name in (*RECORDED, "provenance.json"):
        (tmp_path / name).write_bytes((source / name).read_bytes())
    late = Run.open(tmp_path)
    (tmp_path / "contacts.parquet").unlink()
    with pytest.raises(CaseError, match="not a run folder") as refused:
        late.contacts  # noqa: B018
    assert "\n" not in str(refused.value)
    with pytest.raises(CaseError, match="not a run folder"):
        Run.open(tmp_path)
