"""Bring README.md and its picture up to date with reports/example, after `make example` has written it.

The table between the marks in README.md is written from report.json; the picture is a screenshot of the page,
where a headless Chromium is installed.  Nothing is computed here.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
EXAMPLE = ROOT / "reports" / "example"
MARKS = re.compile(r"(<!-- table: begin -->\n).*?(<!-- table: end -->)", re.DOTALL)
PICTURE = (1180, 760)  # pixels


def cell(rows: list[dict]) -> str:
    """Status of a case in one engine, and its worst error over tolerance."""
    if not rows:
        return "not compared"
    counts = Counter("disagree, known" if "known_departure" in row else row["status"] for row in rows)
    words = ", ".join(f"{n} {status.replace('_', ' ')}" for status, n in counts.items())
    judged = [row for row in rows if row["status"] in ("agree", "disagree") and row["tolerance"]]
    if not judged or counts["disagree, known"]:
        return words
    return f"{words}; worst {max(row['error'] / row['tolerance'] for row in judged):.2g}"


def table(report: dict) -> str:
    """One row for each case: the physics, and how each engine did."""
    engines = [engine["name"] for engine in report["engines"] if engine["available"]]
    lines = ["| case | physics | " + " | ".join(engines) + " |", "|---" * (2 + len(engines)) + "|"]
    for case in report["cases"]:
        rows = [row for row in report["comparisons"] if row["case"] == case["name"]]
        cells = [cell([row for row in rows if row["engine"] == engine]) for engine in engines]
        lines.append(f"| `{case['name']}` | {case['sentence']} | " + " | ".join(cells) + " |")
    caption = "Number of comparisons, and the largest error divided by its tolerance."
    return "\n".join([*lines, "", caption, ""])


def screenshot(page: Path, picture: Path) -> None:
    """Save the top of a page as a picture, if there is a Chromium."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if browser is None:
        print(f"no Chromium: {picture} is as it was")
        return
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
        command += ["--disable-background-networking", "--disable-sync", "--no-first-run"]
        command += [f"--user-data-dir={profile}", f"--window-size={PICTURE[0]},{PICTURE[1]}"]
        subprocess.run([*command, f"--screenshot={picture}", page.as_uri()], check=True, capture_output=True)


def main() -> None:
    """Rewrite the table and the picture."""
    report = json.loads((EXAMPLE / "report.json").read_text("utf-8"))
    readme = ROOT / "README.md"
    text = MARKS.sub(lambda match: match.group(1) + table(report) + match.group(2), readme.read_text("utf-8"))
    readme.write_text(text, "utf-8")
    shutil.rmtree(EXAMPLE / "data", ignore_errors=True)  # run folders are large and can be made again
    (EXAMPLE / "junit.xml").unlink(missing_ok=True)  # of use to the run that made it only
    screenshot(EXAMPLE / "index.html", EXAMPLE / "picture.png")


if __name__ == "__main__":
    main()
