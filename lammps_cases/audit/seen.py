"""One look's fields by the reference: the stages of a force evaluation, called on the state that LAMMPS shows.

Everything follows from the state as it is: densities, of walls too, are taken from LAMMPS and summed or reconstructed
for nobody but the field ``rho`` itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.evaluation.array_evaluator import Plain
from eos_ref.evaluation.cutoff import at_cutoff
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.parameters import BoolArray, Box, Gradients, Model, State
from eos_ref.model.quantities import required
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import Rounded, error
from lammps_cases.audit.deck import Action
from lammps_cases.audit.fields import corrected_by_hidden_densities, needs
from lammps_cases.comparison.trajectory import Problem
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import combined

Array = npt.NDArray[Any]
EPS = 2.0**-52


@dataclass(frozen=True)
class View:
    """What LAMMPS shows at a look, in its own order of particles.

    ``actions`` are the fixes that change forces, each with the particles it acts on. ``summed`` says that the
    densities of walls are not those that the forces used (after the set-up of a run with rho/sum and
    interface/reconstruct; see the ledger). ``z_n`` are the heights of
    particles in 2D, where they ought to be all the same.
    """

    model: Model
    box: Box
    state: State
    mass_n: Array
    actions: Sequence[tuple[Action, BoolArray]] = ()
    summed: bool = False
    z_n: Array | None = None


class Seen(Simulation):
    """A force evaluation of a view, with rounding bounds; it never takes a step."""

    def __init__(self, view: View, fields: Sequence[str], stages: type[Plain] = Plain) -> None:
        s = view.state
        energy_n = None if s.energy_n is None else Rounded(s.energy_n)
        self.state = State(Rounded(s.x_nc), Rounded(s.v_nc), Rounded(s.rho_n), s.type_n, s.solid_n, energy_n)
        self.model, self.box, self.view = view.model, view.box, view
        self.asked = tuple(fields)
        self.plan = required(self.model, self.asked)
        self.evaluator = at_cutoff(stages)(self.model, self.box, s.type_n, s.solid_n)
        self.evaluator.mass_n = self.mass_n = view.mass_n
        self.fields = {}
        self.gradient = Gradients()
        self.chi_n = None
        self.summed_n: Any = None
        with np.errstate(all="ignore"):
            self.evaluate()

    def _densities(self) -> None:
        s, e, fix = self.state, self.evaluator, self.model.fix
        if "rho" in self.plan and fix.rho_sum:
            self.summed_n = e.density_sum()
        if "correction" in self.plan:
            # Solids of both keywords are corrected with their sums, before the reconstruction.
            both = fix.rho_sum and fix.interface_reconstruct
            e.correct(where(s.solid_n, self.summed_n, s.rho_n) if both else s.rho_n)
        if "chi" in self.plan:
            self.chi_n = self.fields["chi"] = e.same_phase()

    def _external(self, force_nc: Any) -> Any:
        for action, acts_n in self.view.actions:
            rows = acts_n[:, None]
            given_c = np.array([v is not None for v in action.vector])
            # A direction that LAMMPS has scaled to length 1, and size times direction: three roundings on either side.
            vector_c = np.array([v or 0.0 for v in action.vector])[: force_nc.shape[1]]
            given_c = given_c[: force_nc.shape[1]]
            if action.style == "gravity":
                pull = self.mass_n[:, None] * Rounded(vector_c, 6 * EPS * np.abs(vector_c))
                force_nc = where(rows, force_nc + pull, force_nc)
            elif action.style == "addforce":
                force_nc = where(rows, force_nc + vector_c, force_nc)
            else:
                force_nc = where(rows & given_c, vector_c + np.zeros(force_nc.shape), force_nc)
        return force_nc

    def output(self, field: str) -> Any:
        """A field of the evaluation; ``rho`` is the sum."""
        return self.summed_n if field == "rho" else super().output(field)

    def known(self, field: str) -> BoolArray:
        """Of which particles a field can be told.

        Not of those whose density LAMMPS does not show as it was used, nor where rounding decides the class of a
        particle at the surface, nor near particles that do not lie in one plane.
        """
        view = self.view
        solid_n = view.state.solid_n
        everyone: BoolArray = np.ones(len(solid_n), bool)
        if field == "rho" and self.model.fix.interface_reconstruct:
            return ~solid_n & self._in_plane()
        if not needs(field, "pairs", self.model):
            return everyone
        if view.summed and field != "chi" and field != "coordination":
            return ~everyone
        known_n = self._in_plane()
        if needs(field, "correction", self.model) and corrected_by_hidden_densities(self.model):
            known_n = known_n & ~self._beside(solid_n)
        if field in ("surface/r", "surface/n", "shift/v") and "surface" in self.plan:
            open_n = error(self.fields["surface"]) > 0
            known_n = known_n & ~open_n & ~self._beside(open_n)
        return known_n

    def _beside(self, some_n: BoolArray) -> BoolArray:
        """Which particles have neighbours among some."""
        if not some_n.any():
            return some_n
        e = self.evaluator
        beside_n: BoolArray = np.bincount(e.i, some_n[e.j], len(some_n)) > 0
        return beside_n

    def _in_plane(self) -> BoolArray:
        """Which particles lie in a plane with their neighbours, as do these with theirs."""
        tilted_n = self.tilted()
        return ~(tilted_n | self._beside(tilted_n))

    def tilted(self) -> BoolArray:
        """Which particles of a 2D deck have neighbours above or below: LAMMPS takes distances in space."""
        z_n, e = self.view.z_n, self.evaluator
        if z_n is None or "pairs" not in self.plan:
            return np.zeros(len(self.view.state.solid_n), bool)
        tilted_n: BoolArray = np.bincount(e.i, z_n[e.i] != z_n[e.j], len(z_n)) > 0
        return tilted_n


# The fields outside their bounds for stages of an evaluation; values without a bound are left out if so told.
Outside = Callable[[type[Plain], bool], frozenset[str]]
Explained = dict[str, list[Finding]]  # by field


def explain(
    view: View,
    snapshot: Mapping[str, Any],
    listed: Sequence[Finding],
    before: frozenset[str],
    outside: Outside,
    last: Explained | None = None,
) -> Explained:
    """The findings that bring fields back inside their bounds, each field with those that it needs.

    A finding explains nothing if it takes a field out of its bound that was inside.

    Parameters
    ----------
    snapshot : LAMMPS' fields by name
    listed : findings of the engine
    before : the fields outside their bounds by the reference
    last : the answer of an earlier look, tried first
    """
    scene = Problem(view.model, view.box, view.state, 0.0, tuple(snapshot), (0,))

    def after(entries: Sequence[Finding]) -> frozenset[str]:
        variants = [entry.model_variant for entry in entries if entry.model_variant]
        made = combined(variants, scene, dict(snapshot))
        return outside(made[0], any(v.undefined for v in variants)) if made else frozenset(snapshot)

    if last and before <= last.keys():
        entries = list(dict.fromkeys(entry for field in before for entry in last[field]))
        if not after(entries):
            return {field: last[field] for field in before}
    needed = [e for e in listed if e.model_variant and e.model_variant.stages and e.model_variant.applies(scene)]
    if not needed:
        return {}
    left = after(needed)
    if not left < before:
        return {}
    without: dict[str, frozenset[str]] = {}
    for entry in tuple(needed):
        fewer = [other for other in needed if other is not entry]
        without[entry.id] = after(fewer) if fewer else before
        if without[entry.id] == left:
            needed = fewer
    return {field: [e for e in needed if field in without[e.id]] or needed for field in before - left}
