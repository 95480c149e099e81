"""One finding, and the engines it is known on."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from eos_ref import EOSTable
from eos_ref.eos.table import FloatArray
from lammps_cases.comparison.compare import State
from lammps_cases.findings.variants import Variant
from lammps_cases.records.run_record import Verdict

ALL = ("2025.7.22.0.1", "2025.7.22.1.0", "2025.7.22.2.0", "2025.7.22.4.0")
NEWEST = ALL[-1]
Law = Callable[[EOSTable, State], FloatArray]


@dataclass(frozen=True)
class Entry:
    """One finding.

    Attributes
    ----------
    documented, observed : what the manual says (with its place), what LAMMPS does
    argument : why the documented behaviour is the right one
    workaround : what a user can do meanwhile
    cases : patterns of the cases that show it
    scene : the smallest scene that shows it
    variant : replaces the reference's pressure, for a finding in an equation of state
    particles : the variant of the particle model, for a finding in its fields
    outcome, outcome_text : verdict and part of the message that it predicts, for a finding in refusals
    """

    id: str
    title: str
    severity: Literal["low", "medium", "high"]
    documented: str
    observed: str
    argument: str
    workaround: str
    cases: tuple[str, ...]
    engines: tuple[str, ...]
    scene: str = ""
    variant: Law | None = None
    particles: Variant | None = None
    outcome: Verdict | None = None
    outcome_text: str = ""

    @property
    def named_variant(self) -> str:
        """What reproduces or predicts it: a variant's name, or the outcome of a run."""
        part = self.variant or (self.particles and (self.particles.stages or self.particles.stepping))
        return part.__name__ if part else (self.outcome or "")

    def covers(self, case: str, engine: str) -> bool:
        """Whether the entry speaks of a case on an engine, given by its distribution's version.

        A finding is explained on the engines it was seen on, and nowhere else: where it comes back, or is met for the
        first time, it is red. A build without a distribution is taken as the newest.
        """
        return self.listed(engine) and any(fnmatch.fnmatchcase(case, pattern) for pattern in self.cases)

    def listed(self, engine: str) -> bool:
        """Whether an engine, given by its distribution's version, is known to have the fault."""
        return engine in self.engines or (not engine and NEWEST in self.engines)
