"""The command `cmpcheck rerun`: its options, and how it ends.

It imports what it needs when it runs, as `cli.py` does.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cmpcheck.shell import BadInput, command, complain

if TYPE_CHECKING:
    from cmpcheck.results import SuiteResult


@command()
def rerun(
    report: Annotated[Path, typer.Argument(metavar="REPORT", help="a report.json, or its folder")],
    out: Annotated[Path, typer.Option(help="folder of the new report")] = Path("reports/rerun"),
    jobs: Annotated[int | None, typer.Option(min=1, help="processes; default one per processor")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with a comparison that was interrupted or killed")
    ] = False,
    force: Annotated[
        bool, typer.Option("--force", help="write into a folder that holds other files")
    ] = False,
) -> None:
    """Repeat a report and say what changed.

    Runs what the report was asked for, with the code and the engines as they are now, and compares the two
    row by row.  changes.md and changes.json lie beside the new report; exit code 1 when a result changed by
    more than round-off.
    """
    from cmpcheck.comparing import Stopped, make_report
    from cmpcheck.report import report_json
    from cmpcheck.request import read_report, request_of_report
    from cmpcheck.rerun import Changes, compare_reports
    from cmpcheck.rerun_words import changes_json, changes_markdown, sentences

    if resume and force:
        raise BadInput("--resume and --force: one goes on, the other starts again; allowed: one of them")
    file, before = read_report(report)
    if out.resolve() == file.parent.resolve():
        raise BadInput(f"{out}: is the report that is repeated; choose another folder")
    request = request_of_report(file)

    def compared(result: SuiteResult) -> Changes:
        return compare_reports(before, json.loads(report_json(result)))

    def write_changes(result: SuiteResult, folder: Path) -> None:
        changes = compared(result)
        for name, text in (
            ("changes.json", changes_json(changes)),
            ("changes.md", changes_markdown(changes)),
        ):
            (folder / name).write_text(text, "utf-8", newline="\n")

    try:
        result = make_report(request, out, jobs or os.cpu_count() or 1, force, resume, write_changes)
    except Stopped as stopped:
        complain(str(stopped), stopped.code)
    changes = compared(result)
    for line in sentences(changes):
        typer.echo(line)
    typer.echo(f"report: {out / 'index.html'}, changes: {out / 'changes.md'}")
    raise typer.Exit(int(changes.any))
