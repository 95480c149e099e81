"""Findings about the bonds of shells (bond_style rheo/shell, fix rheo/oxidation)."""

from __future__ import annotations

from typing import Any

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.bonds import BondLaw, ShellBond
from eos_ref.model.interactions import shift_weight
from eos_ref.numbers.columns import Axes
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array, Number
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.document import document
from lammps_cases.findings.entry import ModelFinding, OutcomeFinding
from lammps_cases.findings.variants import Variant


class SofteningShells(ArrayEvaluator):
    """The cubic term of a shell bond has the opposite sign."""

    def bond_force(self, law: BondLaw, r0: Any, r: Any, closing: Any) -> Any:
        """Return the forces, that of a shell with its cubic term subtracted from the linear one."""
        if not isinstance(law, ShellBond):
            return super().bond_force(law, r0, r, closing)
        stretch = r - r0
        relative = stretch / (r0 * law.strain)
        return law.damping * closing - 2 * law.stiffness * (stretch - relative * relative * stretch)


class ShellsAmongOthers(ArrayEvaluator):
    """Particles in shell bonds are shifted by all their neighbours that are in none."""

    def unshelled(self) -> Any:
        """Let all particles shift."""
        return True

    def shift_sums(self, volume_n: Array, w_h: Number) -> Axes:
        """Return the sums without pairs of two particles in shell bonds."""
        if self.shelled_n is None:
            return super().shift_sums(volume_n, w_h)
        both = self.shelled_n[self.i] & self.shelled_n[self.j]
        weight = where(both, 0.0, volume_n[self.j] * shift_weight(self.w, w_h))
        return [self.total(weight * g_a) for g_a in self.gradw]


def has_shells(problem: Problem) -> bool:
    """Return whether the model has bonds of rheo/shell."""
    elastic = problem.model.elastic
    return elastic is not None and any(isinstance(law, ShellBond) for law in elastic.bonds)


def shifts_shells(problem: Problem) -> bool:
    """Return whether particles that may be in shell bonds are shifted."""
    return has_shells(problem) and problem.model.fix.shift is not None


SHELL_SOFTENS = ModelFinding(
    **document("shell-softens"),
    applies_to=("probes.shell-force",),
    outcome="differs",
    ended="answered",
    differing="force of a stretched shell bond",
    variant=Variant(has_shells, SofteningShells, changes=("f",)),
    acts=lambda setting: has_shells(setting.problem),
)

SHELLS_SHIFT = ModelFinding(
    **document("shells-shift"),
    applies_to=("probes.shell-shift",),
    outcome="differs",
    ended="answered",
    differing="shift of particles in a shell",
    variant=Variant(shifts_shells, ShellsAmongOthers, changes=("shift/v",)),
    acts=lambda setting: shifts_shells(setting.problem),
)

SHELL_TIME_REFUSED = OutcomeFinding(
    **document("shell-time-refused"),
    applies_to=("probes.shell-time",),
    outcome="refused",
    engine_error="does not have extra field",
)

ENTRIES = (SHELL_SOFTENS, SHELLS_SHIFT, SHELL_TIME_REFUSED)
