"""The fields of one sample by the reference: a force evaluation of the state that LAMMPS shows.

Everything follows from the state as it is: densities, of walls too, are LAMMPS'; they are summed only for the field
``rho`` itself, and reconstructed for none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.blocks import in_blocks
from eos_ref.evaluation.cutoff import at_cutoff
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.bonds import Bonds
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import Force, IntArray, Model
from eos_ref.model.state import State
from eos_ref.numbers.elementary import where
from eos_ref.numbers.rounded import Rounded, error
from lammps_cases.audit.deck import Action
from lammps_cases.audit.fields import corrected_by_hidden_densities, needs
from lammps_cases.comparison.problem import Problem

Array = npt.NDArray[Any]


@dataclass(frozen=True)
class ParticleSample:
    """Particles as LAMMPS shows them right after a force evaluation, in its own order.

    Attributes
    ----------
    model, box, state : of the reference
    mass_n : (n,) masses
    actions : fixes that change forces, each with the particles it acts on
    summed : whether densities of walls differ from those that the forces used (after the set-up of a run with rho/sum
        and interface/reconstruct; see the ledger)
    z_n : (n,) heights of particles in 2D, which should all be equal
    unlists_bonded : whether LAMMPS may leave pairs of bonded particles out of its neighbour lists
    newton : the flags of pairs and of bonds
    ranks : number of ranks of LAMMPS
    acted : whether the forces shown are those after the fixes that change them
    bonds : that act
    shelled_n : which particles were in bonds of fix rheo/oxidation in the step before (n,); None: without that fix
    bonds_known_n : of which particles these are all (n,); None: of all
    """

    model: Model
    box: Box
    state: State
    mass_n: Array
    actions: Sequence[tuple[Action, BoolArray]] = ()
    summed: bool = False
    z_n: Array | None = None
    unlists_bonded: bool = False
    newton: tuple[bool, bool] = (True, True)
    ranks: int = 1
    acted: bool = True
    bonds: Bonds = field(default_factory=Bonds)
    shelled_n: BoolArray | None = None
    bonds_known_n: BoolArray | None = None

    def problem(self, fields: tuple[str, ...], steps: tuple[int, ...] = (0,)) -> Problem:
        """Return the sample as a problem for the search of findings."""
        of_lammps = {name: getattr(self, name) for name in ("ranks", "newton", "unlists_bonded")}
        return Problem(self.model, self.box, self.state, 0.0, fields, steps, **of_lammps)

    def of(self, rows_k: Array) -> ParticleSample:
        """Return some of the particles."""
        arrays = {name: of[rows_k] for name, of in vars(self.state).items() if of is not None}
        return replace(
            self,
            state=replace(self.state, **arrays),
            mass_n=self.mass_n[rows_k],
            actions=[(action, acts_n[rows_k]) for action, acts_n in self.actions],
            z_n=None if self.z_n is None else self.z_n[rows_k],
            bonds=self.bonds.of(rows_k, len(self.mass_n)),
            shelled_n=None if self.shelled_n is None else self.shelled_n[rows_k],
            bonds_known_n=None if self.bonds_known_n is None else self.bonds_known_n[rows_k],
        )

    def rounded(self) -> State:
        """Return the state in `Rounded` arrays."""
        s = self.state
        energy_n = None if s.energy_n is None else Rounded(s.energy_n)
        return State(Rounded(s.x_nc), Rounded(s.v_nc), Rounded(s.rho_n), s.type_n, s.solid_n, energy_n, s.mass_n)


@dataclass(frozen=True)
class TimedSample:
    """A sample with its time step, run and step, and the ids of its particles; ``first`` of its run or not."""

    sample: ParticleSample
    timestep: float
    run: int
    step: int
    id_n: IntArray
    first: bool = True


class _GivenDensities(ArrayEvaluator):
    """Evaluator that takes the densities as given, and keeps their sum apart."""

    given_n: Any
    summed_n: Any = None
    forces = True  # whether they are wanted

    def artificial(self, *given: Any) -> Any:
        """Return nothing where no forces are wanted; these terms take the longest of all."""
        return super().artificial(*given) if self.forces else 0.0

    def density_sum(self) -> Any:
        """Keep the sum, return the given densities."""
        self.summed_n = super().density_sum()
        return self.given_n

    def correct(self, rho_n: Any) -> None:
        """Correct as `ArrayEvaluator` does; with both keywords, solids take their sums, before the reconstruction."""
        fix = self.model.fix
        both = fix.rho_sum and fix.interface_reconstruct
        super().correct(where(self.solid_n, self.summed_n, rho_n) if both else rho_n)

    def interface(self, rho_n: Any, acceleration_nc: Any, energy_n: Any = None) -> tuple[Any, Any]:
        """Return the same-phase fraction and the given densities."""
        return self.same_phase(), rho_n


def acted_on(force_nc: Any, actions: Sequence[tuple[Action, BoolArray]], mass_n: Array) -> Any:
    """Return forces after the fixes that change them: by group, where those of a `Model` act by type."""
    d = force_nc.shape[1]
    for action, acts_n in actions:
        rows = acts_n[:, None]
        vector_c = np.array([v or 0.0 for v in action.vector[:d]])
        if action.style == "gravity":
            # A direction that LAMMPS has scaled to length 1, and size times direction: three roundings on either side.
            acceleration_c = (
                Rounded(vector_c, 6 * EPS * np.abs(vector_c)) if isinstance(force_nc, Rounded) else vector_c
            )
            force_nc = where(rows, force_nc + mass_n[:, None] * acceleration_c, force_nc)
        elif action.style == "addforce":
            force_nc = where(rows, force_nc + vector_c, force_nc)
        else:
            set_c = np.array([v is not None for v in action.vector[:d]])
            force_nc = where(rows & set_c, vector_c + np.zeros(force_nc.shape), force_nc)
    return force_nc


class SampleEvaluation:
    """A force evaluation of a sample, with rounding bounds.

    Parameters
    ----------
    sample : ParticleSample
    fields : sequence of str
    stages : class
        Evaluator: the reference's, or that of a finding's variant.
    """

    def __init__(
        self, sample: ParticleSample, fields: Sequence[str], stages: type[ArrayEvaluator] = ArrayEvaluator
    ) -> None:
        state = sample.rounded()
        s = sample.state
        evaluator: Any = in_blocks(type("Given", (_GivenDensities, at_cutoff(stages)), {}), len(s.type_n))
        self.sample = sample
        self._outputs: dict[str, Any] = {}
        self.stages: _GivenDensities = evaluator(sample.model, sample.box, s.type_n, s.solid_n)
        self.stages.mass_n, self.stages.given_n = sample.mass_n, state.rho_n
        self.stages.shelled_n = sample.shelled_n
        self.simulation = Simulation.with_evaluator(state, self.stages, fields)
        self.simulation.bonds = sample.bonds
        self.stages.forces = "f" in self.simulation.plan
        with np.errstate(all="ignore"):
            results = self.simulation.evaluate() if fields else {}
            self.of_pairs = results.get("f")
            if "f" in results and sample.acted:
                results["f"] = acted_on(results["f"], sample.actions, sample.mass_n)

    def output(self, field: str) -> Any:
        """Return a field of the evaluation; ``rho`` is the sum."""
        if field not in self._outputs:
            self._outputs[field] = self.stages.summed_n if field == "rho" else self.simulation.output(field)
        return self._outputs[field]

    def own(self, field: str) -> Any:
        """Return a field of the model itself: forces are those of pairs, before fixes change them."""
        return self.of_pairs if field == "f" else self.output(field)

    def comparable(self, field: str) -> BoolArray:
        """Return the particles for which a field can be compared, (n,).

        Left out are particles whose density LAMMPS does not show as it was used, those at a surface whose class
        rounding decides, and those near particles that do not lie in one plane.
        """
        sample = self.sample
        model, solid_n = sample.model, sample.state.solid_n
        all_n: BoolArray = np.ones(len(solid_n), bool)
        if field == "rho" and model.fix.interface_reconstruct:
            return ~solid_n & self._in_plane()
        if not needs(field, "pairs", model):
            return all_n
        if sample.summed and field not in ("chi", "coordination"):
            return ~all_n
        comparable_n = self._in_plane()
        if field == "f" and sample.bonds_known_n is not None:
            comparable_n = comparable_n & sample.bonds_known_n
        if needs(field, "correction", model) and corrected_by_hidden_densities(model):
            comparable_n = comparable_n & ~self._near(solid_n)
        if field in ("surface/r", "surface/n", "shift/v") and "surface" in self.simulation.fields:
            open_n = error(self.simulation.fields["surface"]) > 0
            comparable_n = comparable_n & ~open_n & ~self._near(open_n)
        return comparable_n

    def _near(self, some_n: BoolArray) -> BoolArray:
        """Return the particles that have neighbours among some."""
        return self.stages.any_neighbour(lambda _, other: other, some_n) if some_n.any() else some_n

    def _in_plane(self) -> BoolArray:
        """Return the particles that lie in a plane with their neighbours and the neighbours of these."""
        tilted_n = self.tilted()
        return ~(tilted_n | self._near(tilted_n))

    def tilted(self) -> BoolArray:
        """Return the particles of a 2D deck with neighbours above or below: LAMMPS takes distances in space."""
        z_n = self.sample.z_n
        if z_n is None or "pairs" not in self.simulation.plan:
            return np.zeros(len(self.sample.state.solid_n), bool)
        return self.stages.any_neighbour(lambda own, other: (own - other) ** 2 > 0, z_n)  # which may underflow


def model_with_forces(sample: ParticleSample) -> Model | None:
    """Return the model with the forces of the deck, or None if these act on other groups than types."""
    forces, type_n = [], sample.state.type_n
    for action, acts_n in sample.actions:
        types = tuple(int(t) for t in np.unique(type_n[acts_n]))
        if not np.array_equal(acts_n, np.isin(type_n, types)):
            return None
        forces.append(Force(action.style, action.vector[: sample.model.dimension], types))  # type: ignore[arg-type]
    return replace(sample.model, forces=tuple(forces))
