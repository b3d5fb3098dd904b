"""The command line: exit codes, one line per error, what is kept and what is never overwritten."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cmpcheck import outputs
from cmpcheck.cli import app
from cmpcheck.published import benchmark_names, load_benchmark
from reference.case import CASES, available_cases, load_case
from reference.recording import Run

ROOT = Path(__file__).parents[1]

runner = CliRunner()


def call(*arguments: object):
    """Exit code and both streams of a command, in this process; anything unexpected is raised."""
    result = runner.invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def complaint(*arguments: object) -> str:
    """The one line that bad input becomes."""
    result = call(*arguments)
    assert result.exit_code == 2
    assert result.stdout == ""
    lines = result.stderr.splitlines()
    assert len(lines) == 1, result.stderr
    assert lines[0].startswith("cmpcheck: ")
    return lines[0]


@pytest.fixture
def here(tmp_path, monkeypatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def case_file(folder: Path, old: str = "", new: str = "", name: str = "drag_relaxation") -> Path:
    """A copy of a shipped case with one text replaced."""
    text = (CASES / f"{name}.toml").read_text("utf-8")
    assert old in text
    path = folder / "mine.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return path


def test_the_module_runs_as_the_command_does():
    done = subprocess.run(
        [sys.executable, "-m", "cmpcheck", "run", "no_such_case"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert done.stderr.startswith("cmpcheck: unknown case 'no_such_case'")


def test_help_loads_neither_the_model_nor_an_engine():
    code = (
        "import sys\nfrom cmpcheck.cli import app\ntry: app(['--help'])\nexcept SystemExit: pass\n"
        "print([m for m in ('numpy', 'numba', 'pydantic_core', 'lammps', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = done.stdout.splitlines()[-1]
    # typer itself may bring pydantic
    assert loaded in ("[]", "['pydantic_core']")


def test_cases_lists_every_case_with_its_sentence():
    lines = call("cases").stdout.splitlines()
    assert [line.split()[0] for line in lines] == available_cases() + benchmark_names()
    sentences = [load_case(name).case.description for name in available_cases()]
    sentences += [load_benchmark(name).sentence for name in benchmark_names()]
    assert all(sentence in line for sentence, line in zip(sentences, lines, strict=True))


def test_a_benchmark_has_a_deck_to_start_from_and_takes_no_trajectory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert call("init", "--deck", "chung_ooi_4", "in.mine").exit_code == 0
    assert "wall/gran granular" in Path("in.mine").read_text("utf-8")
    assert "unknown case" in complaint("init", "chung_ooi_4", "mine.toml")
    Path("path.csv").write_text("time\n", "utf-8")
    entry = "chung_ooi_4=path.csv"
    assert "a sweep of impacts" in complaint("compare", "chung_ooi_4", "--trajectory", entry)


def test_doctor_names_every_engine_and_succeeds_where_nothing_is_missing():
    result = call("doctor")
    assert result.exit_code == 0
    assert [line.split()[0] for line in result.stdout.splitlines()] == [
        "reference",
        "lammps",
        "lmp",
        "mpiexec",
        "liggghts",
    ]


def test_doctor_gives_the_command_for_what_is_missing_and_exits_1(monkeypatch):
    from cmpcheck.engines import lammps

    monkeypatch.setattr(lammps, "_asked", lambda: ("", "LAMMPS cannot be loaded"))
    result = call("doctor")
    assert result.exit_code == 1
    assert "missing: LAMMPS cannot be loaded" in result.stdout
    assert f"{sys.executable} -m pip install" in result.stdout


def test_doctor_is_content_without_liggghts_which_is_optional_but_says_how_to_get_it(monkeypatch):
    from cmpcheck.engines import liggghts_library

    monkeypatch.setattr(liggghts_library, "available", lambda: (False, "no program liggghts on the path"))
    result = call("doctor")
    assert result.exit_code == 0
    assert "missing: no program liggghts on the path" in result.stdout
    assert "apt-get install liggghts" in result.stdout


# init


@pytest.mark.parametrize("name", available_cases())
def test_init_writes_a_case_that_loads_equal_to_the_shipped_one(name, here):
    assert call("init", name, "mine.toml").exit_code == 0
    assert load_case("mine.toml") == load_case(name)


def test_init_deck_writes_the_shipped_deck_below_the_contract(here):
    from cmpcheck.engines.lammps_setup import deck_path

    assert call("init", "--deck", "pair_head_on", "in.mine").exit_code == 0
    text, shipped = Path("in.mine").read_text("utf-8"), deck_path("pair_head_on").read_text("utf-8")
    assert text.endswith(shipped)
    above = text.removesuffix(shipped).splitlines()
    assert all(line.startswith("#") for line in above)
    assert all(
        any(word in line for line in above) for word in ("effective_mass", "fix ID all nve", "Not needed")
    )


def test_init_never_overwrites_without_force(here):
    Path("mine.toml").write_text("precious", "utf-8")
    assert "mine.toml: exists already" in complaint("init", "pair_slip", "mine.toml")
    assert Path("mine.toml").read_text("utf-8") == "precious"
    assert call("init", "--force", "pair_slip", "mine.toml").exit_code == 0
    assert load_case("mine.toml") == load_case("pair_slip")


def test_init_of_an_unknown_case_suggests_the_nearest(here):
    assert "did you mean 'pair_slip'?" in complaint("init", "pair_slipp", "mine.toml")


# run


def test_run_writes_a_complete_run_folder(here):
    assert call("run", "drag_relaxation").exit_code == 0
    run = Run.load("runs/drag_relaxation")
    assert run.provenance["complete"] is True
    assert len(run.times) == run.case.case.outputs


def test_run_writes_one_folder_for_each_variant(here):
    assert call("run", "wall_oblique", "--out", "mine").exit_code == 0
    variants = [case.variant for case in load_case("wall_oblique").variants()]
    assert sorted(path.name for path in Path("mine").iterdir()) == sorted(variants)
    assert all(Run.load(f"mine/{name}").case.variant == name for name in variants)


def test_two_runs_of_one_case_are_equal_to_the_byte(here):
    for out in ("first", "second"):
        assert call("run", "drag_relaxation", "--out", out).exit_code == 0
    names = sorted(path.name for path in Path("first").iterdir())
    assert names == ["case.toml", "contacts.parquet", "history.parquet", "provenance.json", "trajectory.h5"]
    for name in names:
        first, second = (Path(out, name).read_bytes() for out in ("first", "second"))
        if name == "provenance.json":  # with the wall-clock time, and nothing else that differs
            first, second = (json.loads(text) | {"timing": None} for text in (first, second))
        assert first == second, name


def test_threads_that_there_are_not_are_refused(here):
    assert "--threads: 0 threads; allowed: 1 to " in complaint("run", "drag_relaxation", "--threads", 0)
    beside = complaint("run", "drag_relaxation", "--engine", "lammps", "--threads", 1)
    assert "--threads: lammps takes none from here; allowed: with the reference" in beside
    assert call("run", "drag_relaxation", "--threads", 1).exit_code == 0


def test_run_refuses_an_existing_run_folder_without_force(here):
    call("run", "drag_relaxation")
    before = Path("runs/drag_relaxation/provenance.json").stat().st_mtime_ns
    assert "runs/drag_relaxation: exists already" in complaint("run", "drag_relaxation")
    assert Path("runs/drag_relaxation/provenance.json").stat().st_mtime_ns == before
    assert call("run", "drag_relaxation", "--force").exit_code == 0


def interrupted_after(fraction: float):
    """`simulate` with a checkpoint at each output, for one who presses ^C when so much is done."""
    from reference.simulation import simulate

    def run(case, out, progress, resume):
        def show(done: float) -> None:
            progress(done)
            if done > fraction:
                raise KeyboardInterrupt

        return simulate(case, out, show, resume, checkpoint_interval=0)

    return run


def test_an_interrupted_run_says_how_to_go_on_and_goes_on_to_the_same_bytes(here, monkeypatch):
    assert call("run", "drag_relaxation", "--out", "whole").exit_code == 0
    with monkeypatch.context() as patch:
        patch.setattr("cmpcheck.single.simulate", interrupted_after(0.5))
        stopped = call("run", "drag_relaxation")
    assert stopped.exit_code == 130
    assert "to go on: cmpcheck run drag_relaxation --resume" in stopped.stderr
    assert 0.5 < Run.load("runs/drag_relaxation").times[-1] / 0.9e-6 < 0.6
    line = complaint("run", "drag_relaxation")
    assert "exists already; --resume goes on with a run that is not complete, --force writes over it" in line
    assert "2 sessions" in call("run", "drag_relaxation", "--resume").stdout
    for name in ("trajectory.h5", "contacts.parquet", "history.parquet"):
        assert Path("runs/drag_relaxation", name).read_bytes() == Path("whole", name).read_bytes()
    written = Path("runs/drag_relaxation/trajectory.h5").stat().st_mtime_ns
    again = call("run", "drag_relaxation", "--resume")
    assert again.exit_code == 0
    assert "complete already" in again.stdout
    assert Path("runs/drag_relaxation/trajectory.h5").stat().st_mtime_ns == written


def test_resuming_a_case_with_variants_skips_those_that_are_finished(here, monkeypatch):
    first, second = (case.variant for case in load_case("wall_oblique").variants())
    assert call("run", "wall_oblique", "--out", "whole").exit_code == 0
    assert call("run", "wall_oblique", "--resume").exit_code == 0  # nothing is there: from the beginning
    Path("runs/wall_oblique", second, "provenance.json").unlink()
    written = Path("runs/wall_oblique", first, "trajectory.h5").stat().st_mtime_ns
    result = call("run", "wall_oblique", "--resume")
    assert result.exit_code == 0
    assert "1 of 2 variants were complete already" in result.stdout
    assert Path("runs/wall_oblique", first, "trajectory.h5").stat().st_mtime_ns == written
    for name in (first, second):
        assert Run.load(f"runs/wall_oblique/{name}").provenance["complete"] is True


def test_what_cannot_be_resumed_is_one_line(here):
    call("run", "drag_relaxation", "--out", "mine")
    line = complaint("run", "drag_relaxation", "--resume", "--engine", "lammps", "--out", "mine")
    assert "only the reference" in line
    assert "--resume and --force" in complaint("run", "drag_relaxation", "--resume", "--force")
    assert "another case" in complaint("run", "pair_slip", "--resume", "--out", "mine")
    Path("theirs").mkdir()
    Path("theirs/letter.txt").write_text("precious", "utf-8")
    assert "holds letter.txt and no run" in complaint("run", "pair_slip", "--resume", "--out", "theirs")
    assert [path.name for path in Path("theirs").iterdir()] == ["letter.txt"]


def test_a_run_killed_in_its_process_is_resumed_by_the_same_command(here):
    """kill -9 from outside, as soon as a checkpoint is there."""
    code = (
        "import functools; from cmpcheck import single; from cmpcheck.cli import app\n"
        "single.simulate = functools.partial(single.simulate, checkpoint_interval=0)\n"
        "app(['run', 'mine.toml'])"
    )
    text = (CASES / "polish_full.toml").read_text("utf-8")
    text = text.replace('"1 s"', '"0.5 ms"').replace('"polish_full"', '"mine"')
    Path("mine.toml").write_text(text, "utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    session = subprocess.Popen([sys.executable, "-c", code], env=environment)
    checkpoint = Path("runs/mine/checkpoint/part-00002.h5")
    while not checkpoint.exists() and session.poll() is None:
        time.sleep(0.01)
    session.kill()
    assert session.wait() == -9
    assert "--resume" in complaint("run", "mine.toml")
    result = call("run", "mine.toml", "--resume")
    assert result.exit_code == 0
    assert "2 sessions" in result.stdout
    assert Run.load("runs/mine").provenance["complete"] is True


def test_a_run_ends_with_a_summary(here):
    from polish_example import small_polish

    small_polish().save("mine.toml")
    lines = call("run", "mine.toml", "--out", "mine").stdout.splitlines()
    run = Run.load("mine")
    removals, flatness = (run.contacts.removed_volume > 0).sum(), run.history.flatness
    assert removals > 0
    steps, removed, flat = (" ".join(line.split()) for line in lines[1:4])
    assert steps.startswith(f"steps {run.provenance['steps']:,} in ")
    assert removed.startswith(f"removals {removals:,}, ")
    middle = 0.5 * (flatness[2] + flatness[3])  # of six outputs
    assert flat == (f"flatness 1 at the start, {middle:.3g} half-way, {flatness.iloc[-1]:.3g} at the end")
    assert lines[-1] == "run: mine"
    assert all(f"  note      {note}" in lines for note in run.provenance["notes"])
    assert run.provenance["timing"]["wall_time"] > 0


def test_run_takes_a_case_by_its_path(here):
    path = case_file(here, 'name = "drag_relaxation"', 'name = "mine"')
    assert call("run", path).exit_code == 0
    assert Run.load("runs/mine").case.name == "mine"


# bad input


@pytest.mark.parametrize("command", ["run", "compare"])
@pytest.mark.parametrize(
    "old, new, named",
    [
        ("duration =", "durration =", ["durration"]),
        ("viscosity =", "viscosity = '1 m' #", ["viscosity", "1 m"]),
        ("diameter =", "diameter = '-1 um' #", ["diameter", "-1 um"]),
        ("restitution =", "restitution = 1.5 #", ["restitution", "1.5"]),
    ],
)
def test_a_bad_case_is_one_line_naming_file_key_and_value(command, old, new, named, here):
    line = complaint(command, case_file(here, old, new))
    assert "mine.toml" in line
    for part in named:
        assert part in line


@pytest.mark.parametrize("command", ["run", "compare"])
def test_a_missing_or_malformed_file_and_an_unknown_case_are_one_line(command, here):
    assert "absent.toml: no such file" in complaint(command, "absent.toml")
    Path("broken.toml").write_text("[case\n", "utf-8")
    assert "broken.toml:1: malformed TOML" in complaint(command, "broken.toml")
    line = complaint(command, "pair_slipp")
    assert "unknown case 'pair_slipp': did you mean 'pair_slip'?" in line
    assert all(name in line for name in available_cases())


@pytest.mark.parametrize("command", ["run", "compare"])
def test_an_unknown_engine_is_one_line_with_those_that_exist(command, here):
    line = complaint(command, "drag_relaxation", "--engine", "lamps")
    assert "unknown engine 'lamps': did you mean 'lammps'?" in line
    assert "reference" in line


@pytest.mark.parametrize("command", ["run", "compare"])
def test_a_folder_that_cannot_be_written_is_one_line(command, here):
    Path("file").write_text("", "utf-8")
    assert "file/below: cannot be written" in complaint(command, "drag_relaxation", "--out", "file/below")


@pytest.mark.parametrize("command", ["run", "compare"])
def test_a_requested_engine_that_is_missing_is_bad_input(command, here, monkeypatch):
    from cmpcheck.results import EngineInfo

    absent = EngineInfo("lammps", "", False, "LAMMPS cannot be loaded")
    monkeypatch.setattr("cmpcheck.engines.lammps.LammpsEngine.info", lambda self: absent)
    line = complaint(command, "drag_relaxation", "--engine", "lammps")
    assert "the engine lammps is missing: LAMMPS cannot be loaded" in line


def test_a_state_that_stops_being_finite_exits_1_names_particle_and_time_and_keeps_the_run(here):
    """A speed of 1e200 m/s makes the drag overflow; the folder is there, and not complete."""
    path = case_file(here, "velocity =", "velocity = [1e200, 0, 0] #")
    result = call("run", path, "--out", "mine")
    assert result.exit_code == 1
    assert "Traceback" not in result.stderr
    assert "particle 0" in result.stderr
    assert " s" in result.stderr
    assert Run.load("mine").provenance["complete"] is False


@pytest.mark.parametrize(
    "entry, said",
    [
        ("drag_relaxation", "CASE=FILE"),
        ("swarm=in.mine", "drag_relaxation"),
        ("drag_relaxation=in.absent", "no such file"),
    ],
)
def test_a_bad_deck_option_is_one_line(entry, said, here):
    assert said in complaint("compare", "drag_relaxation", "--deck", entry)


def test_wrong_options_exit_2():
    assert call("compare", "--profile", "fast").exit_code == 2
    assert call("run").exit_code == 2
    assert call("polish").exit_code == 2


# compare


def test_compare_writes_a_report_and_says_where(here):
    result = call("compare", "drag_relaxation", "--engine", "reference", "--out", "report")
    assert result.exit_code == 0, result.stderr
    assert "report: report/index.html" in result.stdout
    assert sorted(path.name for path in Path("report").iterdir()) == sorted(outputs.REPORT_ENTRIES)
    document = json.loads(Path("report/report.json").read_text("utf-8"))
    assert document["schema"] == "cmpcheck-report/1"
    assert {row["case"] for row in document["comparisons"]} == {"drag_relaxation"}
    assert {row["engine"] for row in document["comparisons"]} == {"reference"}


def test_a_report_is_replaced_and_other_files_beside_it_stay(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "old").touch()
    (tmp_path / "report.json").write_text('{"schema": "cmpcheck-report/1"}', "utf-8")
    (tmp_path / "picture.png").touch()
    staging = outputs.stage_report(tmp_path, force=False)
    (staging / "report.json").write_text("new", "utf-8")
    (staging / "data").mkdir()
    assert (tmp_path / "data" / "old").exists()
    outputs.publish_report(staging, tmp_path)
    assert (tmp_path / "report.json").read_text("utf-8") == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "picture.png", "report.json"]
    assert not any((tmp_path / "data").iterdir())


@pytest.mark.parametrize("name, text", [("report.json", '{"schema": "other/1"}'), ("letter.txt", "precious")])
def test_a_folder_with_other_files_is_no_place_for_a_report_without_force(tmp_path, name, text):
    (tmp_path / name).write_text(text, "utf-8")
    with pytest.raises(outputs.OutputError, match=name):
        outputs.stage_report(tmp_path, force=False)
    assert outputs.stage_report(tmp_path, force=True).is_dir()
    assert (tmp_path / name).read_text("utf-8") == text


def test_what_an_interrupted_comparison_left_does_not_stand_in_the_way(tmp_path):
    folder = tmp_path / "latest"
    (outputs.stage_report(folder, force=False) / "data").touch()
    assert not any(outputs.stage_report(folder, force=False).iterdir())


def test_an_interrupted_comparison_exits_130_and_leaves_the_earlier_report(here, monkeypatch):
    def interrupt(*arguments):
        raise KeyboardInterrupt

    Path("report").mkdir()
    Path("report/report.json").write_text('{"schema": "cmpcheck-report/1"}', "utf-8")
    monkeypatch.setattr("cmpcheck.comparing.run_suite", interrupt)
    result = call("compare", "drag_relaxation", "--out", "report")
    assert result.exit_code == 130
    assert "cmpcheck: interrupted: report is as it was" in result.stderr
    assert Path("report/report.json").read_text("utf-8") == '{"schema": "cmpcheck-report/1"}'


def test_a_comparison_that_cannot_begin_leaves_no_folder(here, monkeypatch):
    from reference.case import CaseError

    def refuse(*arguments):
        raise CaseError("mine.toml: no")

    monkeypatch.setattr("cmpcheck.comparing.run_suite", refuse)
    assert "mine.toml: no" in complaint("compare", "drag_relaxation", "--out", "report")
    assert not Path("report").exists()


def test_a_case_named_twice_is_bad_input(here):
    assert "named twice" in complaint("compare", "drag_relaxation", "drag_relaxation")


# deck


@pytest.mark.parametrize(
    "arguments, passed",
    [
        (["in.mine", "-var", "e", "0.5"], ["-in", "in.mine", "-var", "e", "0.5"]),
        (["-in", "in.mine", "-log", "none"], ["-in", "in.mine", "-log", "none"]),
        (["-screen", "none", "-i", "in.mine"], ["-screen", "none", "-i", "in.mine"]),
    ],
)
def test_deck_takes_a_file_first_or_the_flags_of_lmp(arguments, passed, monkeypatch):
    received = []
    monkeypatch.setattr("cmpcheck.deck.run_deck", lambda flags: received.extend(flags) or 3)
    assert call("deck", *arguments).exit_code == 3
    assert received == passed


@pytest.mark.parametrize("arguments", [[], ["-log", "none"], ["in.absent"], ["-in", "in.absent"]])
def test_deck_without_a_deck_is_one_line(arguments, here):
    complaint("deck", *arguments)


# the wheel


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The wheel, unpacked as an installation does."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    subprocess.run([sys.executable, "-m", "zipfile", "-e", str(wheel), str(folder / "site")], check=True)
    return folder / "site"


def test_the_wheel_holds_every_case_deck_and_template(site):
    for held, source in (
        ("reference/cases", "reference/cases"),
        ("cmpcheck/lammps_inputs", "lammps_inputs"),
        ("cmpcheck/templates", "cmpcheck/templates"),
    ):
        shipped = {path.relative_to(ROOT / source) for path in (ROOT / source).rglob("*") if path.is_file()}
        assert {
            path.relative_to(site / held) for path in (site / held).rglob("*") if path.is_file()
        } == shipped
    assert (site / "cmpcheck" / "known_departures.toml").is_file()


def test_an_unpacked_wheel_runs_a_case_from_any_folder(site, here):
    """Without the checkout on the path, and without compiling: the wheel has no compiled code to bring."""
    code = (
        f"import sys; sys.path.insert(0, {str(site)!r})\n"
        "import cmpcheck, reference\n"
        f"assert all(m.__file__.startswith({str(site)!r}) for m in (cmpcheck, reference))\n"
        "from cmpcheck.cli import app\n"
        "app(['run', 'pair_slip'])\n"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert Run.load("runs/pair_slip").provenance["complete"] is True


def test_a_folder_that_another_process_writes_to_is_refused(here):
    """The lock ends with the process that holds it."""
    hold = (
        "import sys; from pathlib import Path; from cmpcheck.outputs import stage_report\n"
        "stage_report(Path('out'), False); print('held', flush=True); sys.stdin.read()"
    )
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
    holder = subprocess.Popen(
        [sys.executable, "-c", hold],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    with holder:
        assert holder.stdout.readline() == "held\n"
        assert "another run is writing" in complaint("compare", "drag_relaxation", "--out", "out")
        assert "another run is writing" in complaint("run", "drag_relaxation", "--out", "out", "--force")
        holder.stdin.close()
    assert call("compare", "drag_relaxation", "--out", "out", "--engine", "reference").exit_code == 0
