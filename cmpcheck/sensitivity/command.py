"""The command `cmpcheck sensitivity`: its options, and how it ends.

It imports what it needs when it runs, as `cli.py` does.
"""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cmpcheck.shell import INTERRUPTED, BadInput, command, complain, progress_bars


class Profile(StrEnum):
    """How much is run."""

    quick = "quick"
    full = "full"


@command()
def sensitivity(
    cases: Annotated[
        list[str] | None, typer.Argument(metavar="[CASE]...", help="names of cases; default all")
    ] = None,
    profile: Annotated[Profile, typer.Option(help="how much is run")] = Profile.quick,
    out: Annotated[Path, typer.Option(help="folder of the result")] = Path("reports/sensitivity"),
    resume: Annotated[
        bool, typer.Option("--resume", help="go on with a run that was interrupted or killed")
    ] = False,
    jobs: Annotated[int | None, typer.Option(min=1, help="processes; default one per processor")] = None,
    force: Annotated[bool, typer.Option("--force", help="start again in a folder that holds files")] = False,
) -> None:
    """Find out what the suite would have caught.

    Seeds errors into a copy of the sources, one at a time, and lists the checks that notice each.  The full
    profile also finds the smallest size that is noticed, the power of the statistics, and what tests miss.
    """
    from cmpcheck.outputs import write_whole
    from cmpcheck.sensitivity import building, document, page, words
    from cmpcheck.sensitivity.catalogue import all_mutants
    from cmpcheck.sensitivity.run import plan_of, run_plan
    from cmpcheck.sensitivity.store import DOCUMENT, Store

    if resume and force:
        raise BadInput("--resume and --force: one goes on, the other starts again; allowed: one of them")
    plan = plan_of(all_mutants(), cases or [], profile.value, jobs or os.cpu_count() or 1)
    store = Store.resume(out, plan.settings()) if resume else Store.create(out, plan.settings(), force)
    again = " ".join(
        ["cmpcheck sensitivity", *(cases or []), f"--profile {profile.value}", f"--out {out}", "--resume"]
    )
    try:
        with progress_bars() as bars:
            tasks: dict[str, object] = {}

            def show(stage: str, done: int, total: int) -> None:
                if stage not in tasks:
                    tasks[stage] = bars.add_task(stage, total=total)
                bars.update(tasks[stage], completed=done, total=total)  # type: ignore[arg-type]

            run_plan(plan, store, show)
    except KeyboardInterrupt:
        complain(f"interrupted: {out} keeps what was found; to go on: {again}", INTERRUPTED)
    found = building.build(plan, store)
    write_whole(out / "index.html", page.render(found))
    write_whole(out / "sensitivity.md", page.markdown(found))
    write_whole(out / DOCUMENT, document.text_of(found))
    typer.echo(words.headline(found))
    for sentence in filter(None, (words.alarm_sentence(found), words.test_sentence(found))):
        typer.echo(sentence)
    typer.echo(f"page: {out / 'index.html'}")
    raise typer.Exit(int(not document.passes(found)))
