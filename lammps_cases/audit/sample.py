"""Samples of the fields of the particle model: what LAMMPS shows, and what the reference makes of the same state.

Most fields are arrays of atoms; the others are shown by a compute of the audit's own, evaluated at samples
only. LAMMPS evaluates a compute anew for every step and after every set-up, from what the forces have just used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import QUANTITIES
from eos_ref.model.state import State
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit.deck import Action
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.explanation import Explained, explain
from lammps_cases.audit.fields import checked
from lammps_cases.comparison.compare import Comparison, compare_field, excess
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.model_fields import derived

Array = npt.NDArray[Any]
COMPUTE = "eosref_fields"
MEMBERS = "eosref_in_"
SOLID = 1
ATOM_VARIABLE = 1  # extract_variable's LMP_VAR_ATOM
NOT_PRINTED: Mapping[str, Array] = {}


class Sampler:
    """Reads and compares fields; set up before a run.

    Parameters
    ----------
    lmp : lammps
    fields : sequence of str
        The pressure among them is left out.
    model : Model
    actions : sequence of Action
        Fixes that change forces by plain numbers; see `follow_group`.
    mass_t : array or None
        Mass per type, from index 1; None where every particle has its own.
    engine : str
        Version of the distribution, for the ledger.
    """

    def __init__(
        self,
        lmp: Any,
        fields: Sequence[str],
        model: Model,
        actions: Sequence[Action],
        mass_t: Array | None,
        engine: str,
    ) -> None:
        self.lmp, self.model, self.actions, self.mass_t = lmp, model, actions, mass_t
        self.fields = tuple(field for field in checked() if field in fields and field != "pressure")
        self.listed = known(engine)
        self.explained: Explained = {}  # by earlier samples
        self.last: ParticleSample | None = None
        self.tilted = 0  # most particles of a 2D deck that do not lie in a plane with their neighbours
        self.columns: dict[str, slice] = {}
        end = 1
        for field in self.fields:
            if not FIELDS[field].array:
                self.columns[field] = slice(end, end := end + model.dimension ** QUANTITIES[field].rank)
        if self.columns:
            # One column more, as LAMMPS stores a single one as a vector; it must be the pressure: a compute that shows
            # stress/t without it ends in a segmentation fault (LAMMPS 22Jul2025).
            names = ["pressure", *(FIELDS[field].words() for field in self.columns)]
            lmp.command(f"compute {COMPUTE} all rheo/property/atom {' '.join(names)}")

    def compare(self, tag_n: Array, x_nc: Array, setup: bool) -> dict[str, Comparison]:
        """Compare all fields of the particles there are; ``setup`` on the set-up of a run."""
        n = len(tag_n)
        self.last = None
        if not n or not np.isfinite(x_nc[:n]).all():  # no pairs to list; the pressures are compared all the same
            return {}
        self.last = sample = self._sample(n, x_nc, setup)
        shown = self._shown(n)
        comparisons, reference, self.explained = judged(sample, self.fields, tag_n, shown, self.listed, self.explained)
        self.tilted = max(self.tilted, int(reference.tilted().sum()))
        return comparisons

    def _sample(self, n: int, x_nc: Array, setup: bool) -> ParticleSample:
        fix = self.model.fix
        sample = taken(self.lmp, self.model, self.actions, self.mass_t, n, x_nc)
        return replace(sample, summed=setup and fix.rho_sum and fix.interface_reconstruct)

    def _shown(self, n: int) -> dict[str, Array]:
        d = self.model.dimension
        shown: dict[str, Array] = {}
        for field in map(FIELDS.__getitem__, self.fields):
            if field.array:
                shown[field.name] = field.planar(self.lmp.numpy.extract_atom(field.array)[:n].copy(), d)
        if self.columns:
            table = self.lmp.numpy.extract_compute(COMPUTE, 1, 2)[:n].copy()
            for name, columns in self.columns.items():
                shown[name] = table[:, columns].reshape(n, *(d,) * QUANTITIES[name].rank)
        return shown


def judged(
    sample: ParticleSample,
    fields: Sequence[str],
    tag_n: Array,
    shown: Mapping[str, Array],
    listed: Sequence[Finding],
    earlier: Explained,
    evaluation: type[SampleEvaluation] = SampleEvaluation,
    printed: Mapping[str, Array] = NOT_PRINTED,
) -> tuple[dict[str, Comparison], SampleEvaluation, Explained]:
    """Compare fields of a sample with the reference, and explain those that lie outside their bounds.

    Parameters
    ----------
    shown : LAMMPS' fields
    listed : findings of the engine
    earlier : what explained earlier samples
    evaluation : how the reference evaluates the sample
    printed : by how much LAMMPS' fields may be off, as they were printed
    """
    reference = evaluation(sample, fields)
    rows_of = {field: rows_n for field in fields if (rows_n := reference.comparable(field)).any()}

    def sides(field: str, by: SampleEvaluation) -> tuple[Array, Array, Array]:
        a, b, bound = _sides(shown[field], by.output(field), rows_of[field])
        return a, b, bound + printed[field][rows_of[field]] if field in printed else bound

    comparisons = {
        field: compare_field(field, FIELDS[field].stage, tag_n[rows_n], *sides(field, reference), derivation=derived(0))
        for field, rows_n in rows_of.items()
    }
    before = frozenset(field for field, c in comparisons.items() if c.record.verdict == "differs")
    if not before:
        return comparisons, reference, earlier

    def outside(stages: type[ArrayEvaluator], undefined: bool) -> frozenset[str]:
        by = evaluation(sample, fields, stages)
        return frozenset(field for field in rows_of if not _inside(*sides(field, by), undefined))

    explained = explain(sample, shown, listed, before, outside, earlier)
    for field, entries in explained.items():
        record = comparisons[field].record
        record.verdict, record.explained_by = "explained", [entry.id for entry in entries]
    return comparisons, reference, earlier | explained


def known(engine: str) -> list[Finding]:
    """Return the findings of an engine that a sample may show."""
    return [entry for entry in LEDGER if entry.model_variant is not None and entry.listed(engine)]


def taken(
    lmp: Any, model: Model, actions: Sequence[Action], mass_t: Array | None, n: int, x_nc: Array
) -> ParticleSample:
    """Return the particles and the box as they are now, copied; see `follow_group` for the groups of actions."""
    atoms, d = lmp.numpy, model.dimension
    state = State(
        x_nc=x_nc[:n, :d].copy(),
        v_nc=atoms.extract_atom("v")[:n, :d].copy(),
        rho_n=atoms.extract_atom("rho")[:n].copy(),
        type_n=atoms.extract_atom("type")[:n].copy(),
        solid_n=atoms.extract_atom("rheo_status")[:n] & SOLID != 0,
        energy_n=atoms.extract_atom("esph")[:n].copy() if model.thermal is not None else None,
    )
    low, high, xy, yz, xz, periodic, _ = lmp.extract_box()
    tilt = (xy, xz, yz)[: d * (d - 1) // 2]
    ends = tuple(low[:d]), tuple(high[:d])
    box = Box(*ends, tuple(bool(flag) for flag in periodic[:d]), tilt if any(tilt) else ())
    mass_n = atoms.extract_atom("rmass")[:n].copy() if mass_t is None else mass_t[state.type_n]
    z_n = x_nc[:n, 2].copy() if d == 2 else None
    return ParticleSample(model, box, state, mass_n, [(a, members(lmp, a.group, n)) for a in actions], z_n=z_n)


def follow_group(lmp: Any, group: str) -> None:
    """Define what `members` reads; during a run LAMMPS takes no commands."""
    lmp.command(f"variable {MEMBERS}{group} atom gmask({group})")


def members(lmp: Any, group: str, n: int) -> BoolArray:
    """Return the particles that are in a group now, (n,)."""
    in_n: BoolArray = lmp.numpy.extract_variable(f"{MEMBERS}{group}", "all", ATOM_VARIABLE)[:n] != 0
    return in_n


def drop(lmp: Any) -> None:
    """Remove the compute; it holds on to the fixes that were there when the run began."""
    if lmp.has_id("compute", COMPUTE):
        lmp.command(f"uncompute {COMPUTE}")


def _sides(lammps_n: Array, reference: Any, rows_n: Array) -> tuple[Array, Array, Array]:
    """Return a field of some particles by LAMMPS and by the reference, and its bound."""
    a, b, bound = (np.asarray(side, float)[rows_n] for side in (lammps_n, value(reference), error(reference)))
    return a, b, bound


def _inside(lammps_n: Array, reference_n: Array, bound_n: Array, undefined: bool) -> bool:
    """Return whether a field is inside its bound; where values may be undefined, those that have one, if any."""
    if undefined:
        some = np.isfinite(bound_n)
        if not some.any():
            return False
        lammps_n, reference_n, bound_n = lammps_n[some], reference_n[some], bound_n[some]
    return bool(np.all(excess(lammps_n, reference_n, bound_n)[1] <= 1))
