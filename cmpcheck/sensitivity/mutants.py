"""What a seeded error is; the list of all of them is `catalogue/`.

How one is put into a copy of the sources is `patching.py`; what notices it, `checks.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

SIDES = ("reference", "lammps", "both")


@dataclass(frozen=True)
class Mutant:
    """One seeded error: a patch to the text of one file.

    `old` stands once in the file and gives way to `new`, in which SIZE is the size of the error, in `unit`.
    """

    name: str
    breaks: str  # in a sentence
    where: str  # file:function
    old: str
    new: str
    size: float = 1.0  # in the quick profile
    unit: str = ""  # "": the error has no size, it is there or not
    side: str = "reference"  # who makes it: one of SIDES; the other engine does it right
    cases: tuple[str, ...] = ()  # that LAMMPS runs for it, "case" or "case variant"; the reference runs all
    factor: float = 100.0  # turns a size into the unit that is shown: 0.01 is 1 %
    profile: str = "quick"  # "full": what notices it takes too long to compile for the quick one
    explained: str = ""  # why nothing can notice it: a derivation

    def __post_init__(self) -> None:
        if self.side not in SIDES:
            raise ValueError(f"{self.name}: side {self.side!r}; allowed: {', '.join(SIDES)}")
        if bool(self.unit) != ("SIZE" in self.new):
            raise ValueError(f"{self.name}: a unit and SIZE in `new` go together")
        if self.side != "reference" and not self.cases:
            raise ValueError(f"{self.name}: name the cases that LAMMPS runs for it")

    @property
    def file(self) -> str:
        """The file, relative to the project."""
        return self.where.partition(":")[0]

    @property
    def continuous(self) -> bool:
        """Whether the error has a size that can be made smaller."""
        return bool(self.unit)

    def shown(self, size: float) -> str:
        """A size as it is read: "0.2 %"; "always" for an error without one.

        >>> Mutant("e", "", "a.py:f", "e", "e * (1 + SIZE)", unit="%").shown(0.002)
        '0.2 %'
        """
        return f"{self.factor * size:.2g} {self.unit}" if self.continuous else "always"
