"""Laws of a disk that fails in mid-run: one line, no traceback, what was written before is whole, and the run
goes on to the same bytes."""

from __future__ import annotations

import contextlib
import resource
import shutil
from pathlib import Path

import pytest
from test_cli import call

from benchmarks.reliability_digests import digests_of
from benchmarks.reliability_kill import damaged_files
from cmpcheck import single
from reference import simulation
from reference.case import load_case
from reference.recording import write_durably
from reference.simulation import simulate

CASE = "short.toml"


@contextlib.contextmanager
def files_up_to(size: int):
    """Within, no file may grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """A folder with a short case of polishing, which is saved at every output and in between."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(simulation, "PARTICLE_STEPS", 60_000)
    monkeypatch.setattr(single, "simulate", lambda *given: simulate(*given, checkpoint_interval=0.0))
    case = load_case("polish_full")
    header = case.case.model_copy(update={"duration": 0.05e-3, "outputs": 6})
    case.model_copy(update={"case": header}).save(tmp_path / CASE)
    return tmp_path


@pytest.fixture
def whole(here) -> dict[str, str]:
    """Digests of the run that nothing happens to."""
    assert call("run", CASE, "--out", "whole").exit_code == 0
    return digests_of(Path("whole"))


def said(result) -> str:
    """The one line of a command that the disk has stopped."""
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("cmpcheck: ")
    return line


@pytest.mark.parametrize("size", [500, 9_000, 25_000, 100_000])
def test_a_full_disk_is_one_line_and_the_run_goes_on_to_the_same_bytes(here, whole, size):
    with files_up_to(size):
        line = said(call("run", CASE, "--out", "out"))
    assert "File too large; out keeps what was written before; to go on: " in line
    assert damaged_files(Path("out")) == []
    assert call("run", CASE, "--out", "out", "--resume").exit_code == 0
    assert digests_of(Path("out")) == whole


def test_hdf5_is_not_begun_where_there_is_no_room(tmp_path):
    def never(path: Path) -> None:
        pytest.fail("it was begun")

    with files_up_to(1000), pytest.raises(OSError, match=r"File too large: .*a\.h5"):
        write_durably(tmp_path / "a.h5", never, 1001)
    assert list(tmp_path.iterdir()) == []


def test_what_hdf5_says_of_a_full_disk_is_an_error_that_names_the_file(tmp_path):
    def fail(path: Path) -> None:
        path.touch()
        raise RuntimeError("Can't decrement id ref count (unable to extend file, errno = 28, error message)")

    with pytest.raises(OSError, match=r"No space left on device: .*a\.h5"):
        write_durably(tmp_path / "a.h5", fail)
    assert list(tmp_path.iterdir()) == []


def replaced(out: Path) -> None:
    out.rename("moved")
    out.write_text("a file", "utf-8")


@pytest.mark.parametrize("damage", [shutil.rmtree, replaced], ids=["removed", "replaced by a file"])
def test_a_folder_that_is_gone_in_mid_run_is_one_line(here, whole, monkeypatch, damage):
    def interfere(*given):
        case, folder, progress, resume = given

        def notice(fraction: float) -> None:
            if fraction > 0.5 and folder.is_dir() and (folder / "checkpoint").is_dir():
                damage(folder)
            progress(fraction)

        return simulate(case, folder, notice, resume, checkpoint_interval=0.0)

    with monkeypatch.context() as patch:
        patch.setattr(single, "simulate", interfere)
        assert "out" in said(call("run", CASE, "--out", "out"))
    if Path("out").is_file():
        Path("out").unlink()
    assert call("run", CASE, "--out", "out", "--force").exit_code == 0
    assert digests_of(Path("out")) == whole


def test_damage_is_seen(here, whole):
    assert damaged_files(Path("whole")) == []
    for name in ("trajectory.h5", "contacts.parquet", "provenance.json"):
        shutil.copytree("whole", name + "-cut")
        path = Path(name + "-cut", name)
        path.write_bytes(path.read_bytes()[:-40])
        assert len(damaged_files(path.parent)) == 1
