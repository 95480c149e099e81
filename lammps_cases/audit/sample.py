"""Samples of the fields of the particle model: LAMMPS' output, and the reference's evaluation of the same state.

Most fields are arrays of atoms; the others are shown by a compute of the audit's own, evaluated at samples
only. LAMMPS evaluates a compute again for every step and after every set-up, from what the forces have just used.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.bonds import ShellBond
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model
from eos_ref.model.quantities import QUANTITIES
from eos_ref.model.state import State
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit import arrays, bonds
from lammps_cases.audit.deck import Action
from lammps_cases.audit.effects import Explained, Left, explain
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.fields import checked
from lammps_cases.comparison.compare import Comparison, compare_field, components, excess
from lammps_cases.engine.reading import read_list
from lammps_cases.findings import LEDGER, Finding
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.records.case_parts import FieldRecord
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.model_fields import derived

Array = npt.NDArray[Any]
COMPUTE = "eosref_fields"
SOLID = 1


@dataclass(frozen=True)
class Printed:
    """How a printed sample is evaluated, and by how much its fields may be off."""

    evaluation: type[SampleEvaluation]
    errors: Mapping[str, Array]


@dataclass(frozen=True)
class JudgedSample:
    """A sample compared with the reference.

    Attributes
    ----------
    comparisons : by field; without those that cannot be predicted, or of which no particle can be compared
    reference : the reference's evaluation
    alone : evaluations with a finding that is not fitted to the sample, by id
    explained : what explained fields of this sample and of earlier ones
    unpredictable : by field, the findings that affect it and that cannot be evaluated in this sample
    """

    comparisons: dict[str, Comparison]
    reference: SampleEvaluation
    alone: dict[str, SampleEvaluation]
    explained: Explained
    unpredictable: Explained


class Sampler:
    """Reads and compares fields; set up before a run.

    Parameters
    ----------
    lmp : lammps
    fields : sequence of str
        The pressure among them is left out.
    model : Model
    actions : sequence of Action
        Fixes that change forces by plain numbers.
    mass_t : array or None
        Mass per type, from index 1; None where every particle has its own.
    engine : str
        Version of the distribution, for the ledger.
    unlists_bonded : bool
        Whether LAMMPS may leave pairs of bonded particles out of its neighbour lists.
    hybrid : bool
        Whether the deck has bond_style hybrid.
    followed : bool
        Whether all forces of the deck are known, so that the reference can take steps of its own.
    """

    def __init__(
        self,
        lmp: Any,
        fields: Sequence[str],
        model: Model,
        actions: Sequence[Action],
        mass_t: Array | None,
        engine: str,
        unlists_bonded: bool = False,
        hybrid: bool = False,
        followed: bool = False,
    ) -> None:
        self.lmp, self.model, self.actions, self.mass_t = lmp, model, actions, mass_t
        self.unlists_bonded, self.hybrid, self.followed = unlists_bonded, hybrid, followed
        self.fields = tuple(field for field in checked() if field in fields and field != "pressure")
        self.bonds = model.elastic.bonds if model.elastic and "f" in self.fields else ()
        if self.bonds:
            bonds.define(lmp, any(isinstance(law, ShellBond) for law in self.bonds))
        self.listed = known(engine)
        self.explained: Explained = {}  # by earlier samples
        self.last: ParticleSample | None = None
        self.evaluated: dict[str, SampleEvaluation] = {}  # of the last one, once it is compared; see `effects`
        self.tilted = 0  # most particles of a 2D deck that do not lie in a plane with their neighbours
        self.columns: dict[str, slice] = {}
        end = 1
        for field in self.fields:
            if not FIELDS[field].array:
                self.columns[field] = slice(end, end := end + model.dimension ** QUANTITIES[field].rank)
        if self.columns:
            # One more column, as LAMMPS stores a single one as a vector; it must be the pressure: a compute that shows
            # stress/t without it ends in a segmentation fault (LAMMPS 22Jul2025).
            names = ["pressure", *(FIELDS[field].words() for field in self.columns)]
            lmp.command(f"compute {COMPUTE} all rheo/property/atom {' '.join(names)}")

    def take(
        self, n: int, x_nc: Array, setup: bool, acted: bool = True, shelled: Array | None = None
    ) -> ParticleSample:
        """Return the particles.

        Parameters
        ----------
        setup : whether this is the set-up of a run
        acted : see `taken`
        shelled : ids of the particles in bonds of fix rheo/oxidation in the step before; None: without that fix
        """
        fix, self.evaluated = self.model.fix, {}
        self.last = taken(self.lmp, self.model, self.actions, self.mass_t, n, x_nc, acted)
        summed = setup and fix.rho_sum and fix.interface_reconstruct
        self.last = replace(self.last, summed=summed, unlists_bonded=self.unlists_bonded)
        if shelled is not None:
            self.last = replace(self.last, shelled_n=np.isin(arrays.ids(self.lmp), shelled))
        if self.bonds:
            acting, whole_n = bonds.read(self.lmp, self.bonds, arrays.ids(self.lmp), self.hybrid)
            self.last = replace(self.last, bonds=acting, bonds_known_n=whole_n)
        return self.last

    def compare(self, tag_n: Array, shown: Mapping[str, Array]) -> JudgedSample:
        """Compare all fields of the latest sample with those that LAMMPS shows."""
        assert self.last is not None
        found = judged(self.last, self.fields, tag_n, shown, self.listed, self.explained, lists=self._lists)
        self.explained, self.evaluated = found.explained, {"": found.reference, **found.alone}
        self.tilted = max(self.tilted, int(found.reference.tilted().sum()))
        return found

    def explain_pressure(self, tag_n: Array, pressure_n: Array, record: FieldRecord) -> None:
        """Explain pressures outside their bounds, those of all types together; other fields follow from them."""
        assert self.last is not None
        found = judged(self.last, ("pressure",), tag_n, {"pressure": pressure_n}, self.listed, {})
        if entries := found.explained.get("pressure"):
            record.verdict, record.explained_by = "explained", [entry.id for entry in entries]

    def _lists(self, tag_n: Array) -> tuple[NeighbourList, ...]:
        """Return LAMMPS' neighbour list, particles numbered as in the sample; nothing on several ranks."""
        if arrays.rank_count(self.lmp) > 1 or self.lmp.find_pair_neighlist("rheo") < 0:
            return ()
        read, order_n = read_list(self.lmp), np.argsort(tag_n)
        id_s = read.pop("id_s")
        return (NeighbourList(order_n[np.searchsorted(tag_n[order_n], id_s)], **read),)

    def of_pairs(self, n: int) -> dict[str, Array]:
        """Return LAMMPS' fields that later fixes change."""
        arrays_of = {name: FIELDS[name] for name in ("f", "heatflow") if name in self.fields}
        d = self.model.dimension
        return {name: of.planar(arrays.atoms(self.lmp, of.array, n).copy(), d) for name, of in arrays_of.items()}

    def shown(self, n: int, of_pairs: Mapping[str, Array]) -> dict[str, Array]:
        """Return LAMMPS' fields, those that fixes change as they were before."""
        d = self.model.dimension
        shown: dict[str, Array] = {}
        for field in map(FIELDS.__getitem__, self.fields):
            if field.array:
                shown[field.name] = field.planar(arrays.atoms(self.lmp, field.array, n).copy(), d)
        if self.columns:
            count = max(columns.stop for columns in self.columns.values())
            table = arrays.compute(self.lmp, COMPUTE, count, n).copy()
            for name, columns in self.columns.items():
                shown[name] = table[:, columns].reshape(n, *(d,) * QUANTITIES[name].rank)
        return {**shown, **of_pairs}


def judged(
    sample: ParticleSample,
    fields: Sequence[str],
    tag_n: Array,
    shown: Mapping[str, Array],
    listed: Sequence[Finding],
    earlier: Explained,
    lists: Callable[[Array], tuple[NeighbourList, ...]] = lambda tag_n: (),
    printed: Printed | None = None,
) -> JudgedSample:
    """Compare fields of a sample with the reference, and explain those that lie outside their bounds.

    Particles for which neither side has a number are left out, and where there are any, those that they leave without a
    bound.

    Parameters
    ----------
    shown : LAMMPS' fields
    listed : findings of the engine
    earlier : what explained earlier samples
    lists : reads LAMMPS' neighbour list, given the ids; only where a field differs and a finding follows it
    printed : of a sample of a dump, where particles for which LAMMPS has no number are left out, too
    """
    evaluation = printed.evaluation if printed else SampleEvaluation
    errors = printed.errors if printed else {}
    reference = evaluation(sample, fields)
    rows_of = {}
    for field in fields:
        finite_n = _finite(shown[field])
        output = reference.output(field)
        numbered_n = finite_n | _finite(value(output))
        rows_n = reference.comparable(field) & numbered_n & (numbered_n.all() | _finite(error(output)))
        rows_n = rows_n & finite_n if printed else rows_n
        if rows_n.any():
            rows_of[field] = rows_n

    def sides(field: str, by: SampleEvaluation) -> tuple[Array, Array, Array]:
        of_reference, rows_n = by.output(field), rows_of[field]
        of_both = (shown[field], value(of_reference), error(of_reference))
        a, b, bound = (np.asarray(side, float)[rows_n] for side in of_both)
        return a, b, bound + errors[field][rows_n] if field in errors else bound

    comparisons = {
        field: compare_field(field, FIELDS[field].stage, tag_n[rows_n], *sides(field, reference), derivation=derived(0))
        for field, rows_n in rows_of.items()
    }
    before = frozenset(field for field, c in comparisons.items() if c.record.verdict == "differs")
    if not before:
        return JudgedSample(comparisons, reference, {}, earlier, {})

    alone: dict[str, SampleEvaluation] = {}

    def outside(entries: Sequence[Finding], stages: type[ArrayEvaluator], undefined: bool) -> Left:
        by = evaluation(sample, fields, stages)
        alone.update({e.id: by for e in entries if len(entries) == 1 and e.model_variant and not e.model_variant.fit})
        ratios = {field: _ratios(*sides(field, by), undefined) for field in rows_of}
        return Left(
            frozenset(field for field, ratio_n in ratios.items() if not np.all(ratio_n <= 1)),
            frozenset(field for field, ratio_n in ratios.items() if not ratio_n.size),
        )

    found = explain(sample, shown, listed, before, outside, earlier, lambda: lists(tag_n))
    for field, entries in found.explained.items():
        record = comparisons[field].record
        record.verdict, record.explained_by = "explained", [entry.id for entry in entries]
    for field in found.unpredictable:
        del comparisons[field]
    return JudgedSample(comparisons, reference, alone, earlier | found.explained, found.unpredictable)


def known(engine: str) -> list[Finding]:
    """Return the findings of an engine that a sample may show."""
    return [entry for entry in LEDGER if entry.model_variant is not None and entry.listed(engine)]


def taken(
    lmp: Any, model: Model, actions: Sequence[Action], mass_t: Array | None, n: int, x_nc: Array, acted: bool = True
) -> ParticleSample:
    """Return the particles and the box as they are now, copied; ``acted``: whether fixes have changed the forces."""
    d = model.dimension

    def read(name: str) -> Array:
        return arrays.atoms(lmp, name, n)

    state = State(
        x_nc=x_nc[:n, :d].copy(),
        v_nc=read("v")[:, :d].copy(),
        rho_n=read("rho").copy(),
        type_n=read("type").copy(),
        solid_n=read("rheo_status") & SOLID != 0,
        energy_n=read("esph").copy() if model.thermal is not None else None,
        mass_n=read("rmass").copy() if mass_t is None else None,
    )
    low, high, xy, yz, xz, periodic, _ = lmp.extract_box()
    tilt = (xy, xz, yz)[: d * (d - 1) // 2]
    ends = tuple(low[:d]), tuple(high[:d])
    box = Box(*ends, tuple(bool(flag) for flag in periodic[:d]), tilt if any(tilt) else ())
    mass_n = read("rmass").copy() if mass_t is None else mass_t[state.type_n]
    z_n = x_nc[:n, 2].copy() if d == 2 else None
    newton = bool(lmp.extract_setting("newton_pair")), bool(lmp.extract_setting("newton_bond"))
    acting = [(action, arrays.members(lmp, action.group, n)) for action in actions]
    ranks = arrays.rank_count(lmp)
    return ParticleSample(model, box, state, mass_n, acting, z_n=z_n, newton=newton, ranks=ranks, acted=acted)


def drop(lmp: Any) -> None:
    """Remove the compute, which refers to the fixes that existed when the run began."""
    bonds.drop(lmp)
    if lmp.has_id("compute", COMPUTE):
        lmp.command(f"uncompute {COMPUTE}")


def _finite(values_n: Array) -> Array:
    finite: Array = np.asarray(np.isfinite(components(np.asarray(values_n, float))).all(axis=1))
    return finite


def _ratios(lammps_n: Array, reference_n: Array, bound_n: Array, undefined: bool) -> Array:
    """Return differences over bounds, 0 where neither side is finite; if ``undefined`` only those that have a bound."""
    ratio_n: Array = excess(lammps_n, reference_n, bound_n)[1]
    ratio_n[~(np.isfinite(lammps_n) | np.isfinite(reference_n))] = 0.0
    return ratio_n[np.isfinite(bound_n)] if undefined else ratio_n
