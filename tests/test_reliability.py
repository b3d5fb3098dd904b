"""Laws of `reports/reliability.md`: it tells every finding, and what does not hold stands at its top."""

from __future__ import annotations

import json
import os
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from benchmarks import reliability, reliability_kill, reliability_versions
from benchmarks.reliability_digests import array_digest, json_digest, table_digests
from benchmarks.reliability_finding import Finding
from cmpcheck import outputs

HOLDS = Finding("run, killed", "Killed.", "the same | arrays", True, {"kills": 50.0, "exit code": "1"})
FAILS = Finding("a <script>", "Tried.", "a traceback", False)


def written(monkeypatch, folder, *found: Finding, section: str = "kill") -> tuple[int, str]:
    monkeypatch.setattr(
        reliability.importlib,
        "import_module",
        lambda name: SimpleNamespace(findings=lambda full: list(found)),
    )
    code = reliability.main(["--section", section, "--profile", "quick", "--out", str(folder)])
    return code, (folder / reliability.PAGE).read_text("utf-8")


def test_the_page_tells_what_was_found(monkeypatch, tmp_path):
    code, page = written(monkeypatch, tmp_path, HOLDS)
    assert code == 0
    assert "1 of 1 promises hold." in page
    (row,) = (line for line in page.splitlines() if "Killed." in line)
    assert "the same \\| arrays" in row
    assert "kills: 50; exit code: 1" in row


def test_what_does_not_hold_stands_at_the_top_and_fails_the_command(monkeypatch, tmp_path):
    code, page = written(monkeypatch, tmp_path, HOLDS, FAILS)
    assert code == 1
    assert "1 of 2 promises hold.  Not: a \\<script\\>." in page
    assert "<script>" not in page.replace("\\<script\\>", "")


def test_numpy_s_truth_is_told_as_any_other(monkeypatch, tmp_path):
    assert written(monkeypatch, tmp_path, HOLDS._replace(holds=np.bool_(True)))[0] == 0
    assert written(monkeypatch, tmp_path, HOLDS._replace(holds=np.bool_(False)))[0] == 1


def test_a_section_that_breaks_off_is_a_finding_and_what_it_found_before_stays(monkeypatch, tmp_path):
    def breaking(full):
        yield HOLDS
        raise RuntimeError("no such\nfile")

    monkeypatch.setattr(
        reliability.importlib, "import_module", lambda name: SimpleNamespace(findings=breaking)
    )
    code = reliability.main(["--section", "kill", "--profile", "quick", "--out", str(tmp_path)])
    page = (tmp_path / reliability.PAGE).read_text("utf-8")
    assert code == 1
    assert "1 of 2 promises hold.  Not: the section kill." in page
    assert "RuntimeError: no such file" in page


def test_what_a_section_has_found_is_kept_when_the_command_is_stopped(monkeypatch, tmp_path):
    def stopped(full):
        yield HOLDS
        raise KeyboardInterrupt

    monkeypatch.setattr(
        reliability.importlib, "import_module", lambda name: SimpleNamespace(findings=stopped)
    )
    with pytest.raises(KeyboardInterrupt):
        reliability.main(["--section", "kill", "--profile", "quick", "--out", str(tmp_path)])
    page = (tmp_path / reliability.PAGE).read_text("utf-8")
    assert "1 of 1 promises hold." in page
    assert "**Interrupted: what was not tried is missing.**" in page
    code, page = written(monkeypatch, tmp_path, HOLDS, section="disk")
    assert code == 1
    code, page = written(monkeypatch, tmp_path, HOLDS)
    assert code == 0
    assert "Interrupted" not in page


def test_a_section_is_measured_again_and_the_others_stay(monkeypatch, tmp_path):
    written(monkeypatch, tmp_path, FAILS, section="disk")
    code, page = written(monkeypatch, tmp_path, HOLDS)
    assert code == 1
    assert page.index("## Killed") < page.index("## Disk full")
    assert set(json.loads((tmp_path / reliability.KEPT).read_text("utf-8"))) == {"disk", "kill"}


def test_the_sections_of_this_project_are_there():
    for name in ("kill", "disk", "engines", "repeat"):
        assert callable(__import__(reliability._module(name), fromlist=["findings"]).findings)


def test_digests_tell_bits_and_not_clocks():
    table = pd.DataFrame({"a": [0.0, 1.0], "seconds": [1.0, 2.0]})
    assert table_digests("t", table)["t/a"] != array_digest(pd.Series([-0.0, 1.0]).to_numpy())
    assert table_digests("t", table)["t/a"] == array_digest(pd.Series([0.0, 1.0]).to_numpy())
    assert json_digest({"a": 1, "timing": {"wall_time": 1}}) == json_digest({"a": 1, "timing": {}})
    assert json_digest({"a": 1}) != json_digest({"a": 2})


def test_what_a_kill_loses_is_counted_in_each_folder_by_itself(tmp_path):
    compare = reliability_kill.Compare(tmp_path)
    for out, kept in (("a", 2), ("b", 0), ("b", 1)):  # another folder begins with nothing
        folder = tmp_path / out / outputs.STAGING / outputs.FINISHED / "tasks"
        folder.mkdir(parents=True, exist_ok=True)
        for k in range(kept):
            (folder / f"{k}.json").touch()
        assert compare.lost(tmp_path / out, 0.0) == 0.0
    (folder / "0.json").unlink()
    assert compare.lost(tmp_path / "b", 0.0) == 1.0


def test_a_run_loses_what_it_has_computed_since_its_last_checkpoint(tmp_path):
    run, out = reliability_kill.Run(tmp_path), tmp_path / "out"
    (out / "checkpoint").mkdir(parents=True)
    index = out / "checkpoint" / reliability_kill.INDEX
    np.array([100.0, 100.2, 102.0]).tofile(tmp_path / "out.progress")
    assert run.lost(out, 110.0) == 0.0  # no checkpoint: it had ended
    index.touch()
    os.utime(index, (100.5, 100.5))
    assert run.lost(out, 110.0) == 1.5  # the last steps were told at 102 s
    assert run.may_lose() == pytest.approx(reliability_kill.INTERVAL + 1.8)


@pytest.mark.parametrize("found, least", [("2.0.0", True), ("2.0.1", True), ("2.4.6", False), ("3.0", False)])
def test_a_version_that_is_not_the_lowest_is_seen(found, least):
    assert reliability_versions.at_bound("tomli_w>=2.0", {"tomli-w": found}) == least
