"""The reference's steppers, by name: which of them this version has, and a case that is run by one."""

from __future__ import annotations

from reference.case import Case, CaseError, load_case

PLAIN, FAST = "plain", "fast"


def case_of(name: str, stepper: str) -> Case | None:
    """The case, one that ships, with this stepper; None where this version has no such stepper."""
    case = load_case(name)
    if stepper == PLAIN:
        return case
    try:
        return case.replaced({"numerics.stepper": stepper})
    except CaseError:
        return None


def steppers() -> tuple[str, ...]:
    """Those that this version has, the plain one first."""
    return tuple(name for name in (PLAIN, FAST) if case_of("polish", name) is not None)
