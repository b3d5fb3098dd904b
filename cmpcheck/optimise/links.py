"""Which design runs lie beside a report, so that its page can link them."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

DESIGNS = "optimise"  # folder beside the report that `cmpcheck optimise` writes to


class DesignLink(NamedTuple):
    """A design run, as seen from the report's folder."""

    name: str
    href: str


def designs_beside(report: Path) -> list[DesignLink]:
    """The finished design runs beside a report: for reports/latest those in reports/optimise."""
    pages = sorted((report.parent / DESIGNS).glob("*/index.html"))
    return [
        DesignLink(page.parent.name, f"../{DESIGNS}/{quote(page.parent.name)}/index.html")
        for page in pages
        if (page.parent / "table.csv").is_file()
    ]
