"""Laws of checkpoints: a run that was killed goes on to the same bytes, never from what is not its own."""

from __future__ import annotations

import hashlib
import itertools
import json
import multiprocessing
import time
from pathlib import Path

import numpy as np
import pytest

from reference import checkpoint, simulation
from reference.case import Case, CaseError, load_case
from reference.checkpoint import INDEX, Checkpoint
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import SimulationError, simulate

RECORDED = ("case.toml", "trajectory.h5", "contacts.parquet", "history.parquet")


def shortened(name="polish_full", **header) -> Case:
    """A case that ships with keys of its header replaced."""
    case = load_case(name).variants()[0]
    return case.model_copy(update={"case": case.case.model_copy(update=header)})


POLISH = shortened(duration=0.2e-3, outputs=16)  # 22 000 steps; the pad comes down in 0.14 ms


@pytest.fixture(autouse=True)
def tight(monkeypatch):
    """A ledger buffer that starts with one row, grows and overflows; two calls of the kernel an output."""
    monkeypatch.setattr(simulation, "LEDGER_ROWS", 1)
    monkeypatch.setattr(simulation, "PARTICLE_STEPS", 60_000)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """The folder of the run that nobody interrupted, and that made no checkpoint."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "LEDGER_ROWS", 1)
        patch.setattr(simulation, "PARTICLE_STEPS", 60_000)
        simulate(POLISH, folder, checkpoint_interval=np.inf)
    return folder


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of all that was recorded; of the provenance without the wall-clock time."""
    found = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in RECORDED}
    provenance = json.loads((folder / "provenance.json").read_text("utf-8"))
    del provenance["timing"]
    return found | {"provenance": json.dumps(provenance)}


def interrupt_at(fraction: float):
    """What raises KeyboardInterrupt when so much is done."""

    def progress(done: float) -> None:
        if done >= fraction:
            raise KeyboardInterrupt

    return progress


def begin(case: Case, folder: Path, fraction: float = 0.5) -> Path:
    """The checkpoint folder of a run that was interrupted; its parts are one for each call of the kernel."""
    with pytest.raises(KeyboardInterrupt):
        simulate(case, folder, interrupt_at(fraction), checkpoint_interval=0)
    return folder / "checkpoint"


# the same bytes


def test_a_run_killed_at_random_moments_ends_in_the_same_bytes(tmp_path, whole):
    """kill -9, five times, a random while after a random checkpoint; none of the moments may matter."""
    random = np.random.default_rng(7)
    for part in sorted(random.choice(26, 5, replace=False)):
        session = multiprocessing.get_context("fork").Process(
            target=simulate,
            args=(POLISH, tmp_path),
            kwargs={"resume": True, "checkpoint_interval": 0},
        )
        session.start()
        while session.is_alive() and not (tmp_path / "checkpoint" / f"part-{part:05}.h5").exists():
            time.sleep(0.001)
        time.sleep(random.uniform(0.0, 0.02))
        session.kill()
        session.join()
        assert session.exitcode == -9
    run = simulate(POLISH, tmp_path, resume=True)
    assert digests(tmp_path) == digests(whole)
    assert len(run.contacts) > 5_000
    assert run.history["removals"].iloc[-1] > 500
    assert run.provenance["timing"]["sessions"] >= 3  # those that lived to save anything


@pytest.mark.nojit
@pytest.mark.parametrize("name", ["bounce_train", "asperity_bounce", "pair_slip", "drag_relaxation"])
@pytest.mark.parametrize("scheme", ["point_implicit", "fixed_point"])
def test_interrupting_a_run_at_any_checkpoint_changes_nothing(tmp_path, name, scheme):
    """With and without surface, contacts and fluid, and with the adaptive step, at four moments."""
    case = shortened(name, outputs=5)
    case = case.model_copy(update={"numerics": case.numerics.model_copy(update={"scheme": scheme})})
    simulate(case, tmp_path / "whole", checkpoint_interval=np.inf)
    for fraction in (0.0, 0.3, 0.5, 0.8):
        with pytest.raises(KeyboardInterrupt):
            simulate(case, tmp_path / "run", interrupt_at(fraction), resume=True, checkpoint_interval=0)
    simulate(case, tmp_path / "run", resume=True, checkpoint_interval=0)
    assert digests(tmp_path / "run") == digests(tmp_path / "whole")


@pytest.mark.parametrize("rows", ["ledger", "history", "positions"])
def test_what_a_checkpoint_loses_is_seen(tmp_path, whole, monkeypatch, rows):
    """The twin of the tests above: a checkpoint that forgets its last row, or the last bit of a position."""
    add = Checkpoint.add

    def forget(self, recorded, state):
        changed = recorded[rows][:-1] if rows != "positions" else np.nextafter(recorded[rows], 1.0)
        add(self, recorded | {rows: changed}, state)

    monkeypatch.setattr(Checkpoint, "add", forget)
    begin(POLISH, tmp_path)
    if rows == "history":  # there is one row for each frame
        with pytest.raises(CaseError, match="history is float64 of shape"):
            simulate(POLISH, tmp_path, resume=True)
        return
    simulate(POLISH, tmp_path, resume=True)
    different = {name for name, digest in digests(tmp_path).items() if digest != digests(whole)[name]}
    file = {"ledger": "contacts.parquet", "history": "history.parquet", "positions": "trajectory.h5"}[rows]
    assert different == {file}


@pytest.mark.parametrize("name", ["heights", "mass", "progress", "counts"])
def test_a_state_that_is_not_restored_is_seen(tmp_path, whole, monkeypatch, name):
    """The surface, the mass picked up, the scalars, or the length of the ledger buffer as at the start."""
    restore = simulation._Recorder.restore

    def forget(self, saved):
        state = dict(saved.state)
        if name == "progress":
            state[name] = state[name].copy()
            state[name][simulation.P.removals] = 0
        elif name == "counts":
            state[name] = state[name].copy()
            state[name][2] = 1000
        else:
            state[name] = getattr(self.state, name).copy()
        restore(self, saved._replace(state=state))

    monkeypatch.setattr(simulation._Recorder, "restore", forget)
    begin(POLISH, tmp_path)
    if name in ("heights", "mass"):
        with pytest.raises(SimulationError, match="balance"):
            simulate(POLISH, tmp_path, resume=True)
    else:
        simulate(POLISH, tmp_path, resume=True)
        assert digests(tmp_path) != digests(whole)


def test_the_clock_decides_when_checkpoints_are_made_and_nothing_else(tmp_path, whole, monkeypatch):
    """A clock that advances 1 s at each look: with an interval of 10 s some checkpoints, the same bytes."""
    ticks = itertools.count()
    made = []
    add = Checkpoint.add
    monkeypatch.setattr(simulation, "perf_counter", lambda: float(next(ticks)))
    monkeypatch.setattr(
        Checkpoint, "add", lambda self, *saved: made.append(saved[1]["wall_time"]) or add(self, *saved)
    )
    simulate(POLISH, tmp_path, checkpoint_interval=10.0)
    assert 2 < len(made) < len(simulation._stops(build_setup(POLISH))) / 3
    assert np.diff(made).min() >= 10.0
    assert digests(tmp_path) == digests(whole)


@pytest.mark.nojit
def test_the_kernel_stops_at_times_that_the_case_alone_decides():
    setup = build_setup(POLISH)
    stops = simulation._stops(setup)
    assert [stop.time for stop in stops if stop.output] == setup.output_times[1:].tolist()
    assert len(stops) == 2 * 15  # 1482 steps of 73 particles are more than 60 000
    most = max(b.time - a.time for a, b in itertools.pairwise(stops)) / setup.time_step * 73
    assert 50_000 < most <= 60_000


# files


def test_parts_are_only_added_and_go_when_the_run_is_complete(tmp_path, whole):
    folder = begin(POLISH, tmp_path, 0.2)
    before = {path.name: path.stat().st_mtime_ns for path in folder.glob("part-*")}
    with pytest.raises(KeyboardInterrupt):
        simulate(POLISH, tmp_path, interrupt_at(0.5), resume=True, checkpoint_interval=0)
    after = {path.name: path.stat().st_mtime_ns for path in folder.glob("part-*")}
    assert len(after) > 2 * len(before) > 8
    assert before.items() <= after.items()
    assert max(path.stat().st_size for path in folder.iterdir()) < 0.5 * sum(
        path.stat().st_size for path in folder.iterdir()
    )
    simulate(POLISH, tmp_path, resume=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(path.name for path in whole.iterdir())


def test_a_part_that_was_not_finished_is_not_read(tmp_path, whole):
    """Killed before the index named it: half a file, under its temporary name or its own."""
    folder = begin(POLISH, tmp_path)
    count = len(list(folder.glob("part-*")))
    for name in (f"part-{count:05}.h5", f".part-{count:05}.h5.partial", f".{INDEX}.partial"):
        (folder / name).write_bytes((folder / "part-00000.h5").read_bytes()[:500])
    simulate(POLISH, tmp_path, resume=True, checkpoint_interval=0)
    assert digests(tmp_path) == digests(whole)


@pytest.mark.parametrize("name", ["part-00000.h5", "part-00003.h5", INDEX])
@pytest.mark.parametrize("damage", ["cut", "changed", "gone", "empty"])
def test_a_damaged_checkpoint_is_refused_in_one_line(tmp_path, name, damage):
    case = shortened("bounce_train", outputs=9)
    path = begin(case, tmp_path) / name
    content = path.read_bytes()
    if damage == "gone":
        path.unlink()
    else:
        middle = len(content) // 2
        changed = content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :]
        path.write_bytes({"cut": content[:-7], "changed": changed, "empty": b""}[damage])
    if (name, damage) == (INDEX, "gone"):  # then there is no checkpoint
        assert simulate(case, tmp_path, resume=True).provenance["timing"]["sessions"] == 1
        return
    with pytest.raises(CaseError, match="checkpoint") as refused:
        simulate(case, tmp_path, resume=True)
    assert str(tmp_path) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert path.parent.exists()


def test_the_checkpoint_of_another_case_is_refused_and_kept(tmp_path):
    folder = begin(shortened("bounce_train", outputs=9), tmp_path)
    parts = sorted(folder.iterdir())
    for other, named in (({"outputs": 9, "seed": 5}, "seed = 5"), ({"outputs": 8}, "outputs = 8")):
        with pytest.raises(CaseError, match=f"belongs to another case, now {named}") as refused:
            simulate(shortened("bounce_train", **other), tmp_path, resume=True)
        assert "\n" not in str(refused.value)
    assert sorted(folder.iterdir()) == parts


def test_the_checkpoint_of_another_version_is_refused(tmp_path, monkeypatch):
    case = shortened("bounce_train", outputs=9)
    begin(case, tmp_path)
    monkeypatch.setattr(checkpoint, "version_of_code", lambda: "of tomorrow")
    with pytest.raises(CaseError, match="another version of the code"):
        simulate(case, tmp_path, resume=True)


def test_the_checkpoint_of_another_initial_state_is_refused(tmp_path):
    case = shortened("bounce_train", outputs=9)
    begin(case, tmp_path)
    setup = build_setup(case)
    setup.state.velocity[0, 0] = np.nextafter(setup.state.velocity[0, 0], 9.0)
    with pytest.raises(CaseError, match="another initial state"):
        simulation.simulate_setup(setup, tmp_path, resume=True)


# what resuming means where there is nothing to resume


def test_resuming_nothing_begins_and_resuming_a_complete_run_returns_it(tmp_path, monkeypatch):
    case = shortened("bounce_train", outputs=9)
    first = simulate(case, tmp_path, resume=True)
    written = (tmp_path / "trajectory.h5").stat().st_mtime_ns
    monkeypatch.setattr(simulation, "simulate_setup", lambda *arguments: pytest.fail("ran again"))
    again = simulate(case, tmp_path, resume=True)
    assert again.positions.tobytes() == first.positions.tobytes()
    assert again.contacts.equals(first.contacts)
    assert (tmp_path / "trajectory.h5").stat().st_mtime_ns == written
    with pytest.raises(CaseError, match="complete run of another case"):
        simulate(shortened("bounce_train", outputs=9, seed=5), tmp_path, resume=True)


def test_a_run_that_begins_anew_forgets_the_checkpoint_and_the_complete_run_there(tmp_path):
    case = shortened("bounce_train", outputs=9)
    simulate(case, tmp_path)
    started = []

    def look(done: float) -> None:
        started.append((tmp_path / "provenance.json").exists())
        interrupt_at(0.3)(done)

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            simulate(case, tmp_path, look, checkpoint_interval=0)
        assert len(list((tmp_path / "checkpoint").glob("part-*"))) == 3
    assert not any(started)
    assert Run.load(tmp_path).provenance["complete"] is False


def test_wall_time_is_that_of_all_sessions(tmp_path, monkeypatch):
    """A clock of 1 s a look: the first session's time until its last checkpoint, and the second's."""
    case = shortened("bounce_train", outputs=9)
    ticks = itertools.count()
    monkeypatch.setattr(simulation, "perf_counter", lambda: float(next(ticks)))
    begin(case, tmp_path)
    with_first = simulate(case, tmp_path, resume=True, checkpoint_interval=np.inf).provenance["timing"]
    alone = simulate(case, tmp_path / "alone", checkpoint_interval=np.inf).provenance["timing"]
    assert with_first["sessions"] == 2
    assert with_first["wall_time"] > alone["wall_time"] > 0


def test_a_complete_run_by_another_version_is_not_returned_as_this_ones(tmp_path, monkeypatch):
    case = shortened(duration=0.02e-3, outputs=2)
    made = simulate(case, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "version_of_code", lambda: "of tomorrow")
        with pytest.raises(CaseError, match="complete run by another version of the code"):
            simulate(case, tmp_path, resume=True)
    assert Run.load(tmp_path).history.equals(made.history)
    assert simulate(case, tmp_path, resume=True).provenance == made.provenance
