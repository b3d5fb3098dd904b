"""What one part of `reports/reliability.md` has found; the parts are the modules `reliability_*.py` here."""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """One promise, and what came out when it was tried."""

    name: str
    done: str  # what was tried, one sentence
    outcome: str  # what happened, one sentence
    holds: bool
    numbers: dict[str, float | str] = {}  # noqa: RUF012  what was measured, by name with its unit

    def line(self) -> str:
        """For the terminal."""
        numbers = "; ".join(
            f"{name} {value:.6g}" if isinstance(value, float) else f"{name} {value}"
            for name, value in self.numbers.items()
        )
        return f"{'holds' if self.holds else 'FAILS'}: {self.name}: {self.outcome}" + (
            f" ({numbers})" if numbers else ""
        )
