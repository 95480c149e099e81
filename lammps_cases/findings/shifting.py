"""Findings about the shift of particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.numbers.columns import Axes, axes, dot, joined
from eos_ref.numbers.elementary import sqrt, where
from eos_ref.numbers.rounded import value
from lammps_cases.comparison.trajectory import Problem, wanted
from lammps_cases.findings.entry import AlarmDifference, Finding, Gap
from lammps_cases.findings.variants import Snapshot, Variant

if TYPE_CHECKING:
    from lammps_cases.scene import Scene


ROUNDING = 1e-9  # of a shift, below which nothing was taken out of it


class SupportTimesDistance(ArrayEvaluator):
    """The same-type support of scale/cross/type sums W r in place of W."""

    def same_type_support(self, other: Any) -> Any:
        """Sum of W r over neighbours of the same type."""
        return self.total(where(other, 0.0, self.w * self.r))


def asks_for_support(problem: Problem) -> bool:
    """Return whether shifting needs support by particles of the same type."""
    shift = problem.model.fix.shift
    if shift is None or shift.scale_cross_type is None or shift.weighs_distance:
        return False
    return shift.scale_cross_type[2] > 0


class NormalOfLastPair(ArrayEvaluator):
    """The normal of scale/cross/type is, for every particle, the direction of one and the same pair.

    ``pair`` holds the indices of the pair; which one it is follows from LAMMPS' order of neighbours. ``apart`` holds
    the displacement from the second to the first when the pair was found, which tells images of the second.
    """

    pair: tuple[int, int] = (-1, -1)
    apart: tuple[float, ...] = ()

    def cross_type_normal(self, gradient: Axes) -> Axes:
        """Direction of the pair, in its present place; 0 as long as no pair is known."""
        if self.pair == (-1, -1):
            return [np.zeros(self.n) for _ in self.x]
        here = np.flatnonzero((self.i == self.pair[0]) & (self.j == self.pair[1]))
        if not here.size:  # it has left the cutoff: which pair is the last one now is not known
            return [np.full(self.n, np.nan) for _ in self.x]
        far_k = sum(
            ((value(x_p)[here] - c) ** 2 for x_p, c in zip(self.x, self.apart, strict=True)), np.zeros(len(here))
        )
        p = int(here[np.argmin(far_k)])
        x = [x_p[p : p + 1] for x_p in self.x]
        size = sqrt(dot(x, x))
        same = np.zeros(self.n, int)
        return [(x_a / size)[same] for x_a in x]


def scales_across_types(problem: Problem) -> bool:
    """Return whether shifts are scaled along the normal between types, by a kernel whose gradient has one direction."""
    shift = problem.model.fix.shift
    return (
        not problem.model.corrects_gradients
        and shift is not None
        and shift.scale_cross_type is not None
        and shift.scale_cross_type[0] != 1
    )


def last_pair(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any] | None:
    """Find the pair whose direction LAMMPS took out of the shift of the particle that changed most."""
    if "shift/v" not in snapshot:
        return None
    first = problem.steps[0]
    fields = ("shift/v", *(wanted(problem) if first else ()))
    sim = Simulation(problem.model, problem.box, problem.state, fields, stages)
    with np.errstate(invalid="ignore"):
        sim.run(first, problem.timestep)
    plain = sim.evaluator
    assert isinstance(plain, ArrayEvaluator)
    unscaled_nc = value(joined(plain.raw_shift(axes(sim.state.v_nc), sim.state.rho_n)))
    moves_n = np.any(snapshot["shift/v"] != 0, axis=1, keepdims=True)
    change_nc = np.where(moves_n, unscaled_nc - snapshot["shift/v"], 0.0)
    change_nc[np.abs(change_nc) < ROUNDING * np.abs(unscaled_nc).max(initial=0.0)] = 0.0
    n_c = change_nc[np.argmax((change_nc**2).sum(axis=1))]
    if not plain.i.size:
        return None
    if not n_c.any():  # nothing was taken out of any shift, so that no direction has to be known
        return {}
    x_pc = value(joined(plain.x))
    along_p = np.abs(x_pc @ n_c) / np.linalg.norm(x_pc, axis=1)
    p = int(np.argmax(along_p))
    return {"pair": (int(plain.i[p]), int(plain.j[p])), "apart": tuple(x_pc[p].tolist())}


def _several_directions(scene: Scene) -> bool:
    shift = scene.rheo.shifting
    scaled = shift is not None and shift.scale_cross_type is not None and shift.scale_cross_type[0] != 1
    ranks = scene.engine.ranks > 1 or (scene.twin is not None and scene.twin.ranks is not None)
    return scaled and (ranks or scene.rheo.kernel in ("RK1", "RK2") or scene.snapshots[0] > 0)


CROSS_TYPE_SUPPORT = Finding(
    id="cross-type-support",
    number=22,
    title="shift scale/cross/type sums W r for the same-type support",
    severity="medium",
    effect="The threshold wmin turns the shift off at other particles than documented",
    documented="fix rheo, scale/cross/type: W_same = sum W_ij delta_ij over particles of the same type.",
    observed="The sum that is compared with wmin is sum W_ij r_ij delta_ij.",
    argument="The sum has one length more than W: at twice the spacing, everything else scaled and wmin as W, shifting "
    "goes on and off at other particles. W r is largest at 0.24 times the cutoff: of two neighbours nearer than "
    "that, the nearer one counts less, although it supports more.",
    workaround="Multiply wmin by the mean distance of neighbours weighted by W: on a lattice with a cutoff of 3 "
    "spacings 0.38 times the cutoff in 2D and 0.42 times in 3D. Particles close to the threshold may still differ.",
    scene="two types in disorder, wmin of half the full support",
    model_variant=Variant(asks_for_support, SupportTimesDistance),
    replaces=("same_type_support",),
)


CROSS_TYPE_NORMAL = Finding(
    id="cross-type-normal",
    number=23,
    title="shift scale/cross/type uses one direction for all interfaces",
    severity="high",
    effect="Particles at an interface of two fluids are shifted in a wrong direction, or not scaled",
    documented="fix rheo, scale/cross/type: a color function estimates the local interfacial normal; shifting "
    "along it is scaled by shiftscale.",
    observed="The direction that is scaled is the same for all particles: that of the pair that LAMMPS' loop "
    "over neighbours ended with. Where all volumes are the same, single particles are not scaled, or in another "
    "direction. With RK1 and RK2, whose pairs have two gradients, and on several ranks directions differ between "
    "particles. No variant reproduces these three.",
    argument="A flat interface normal to x and one normal to y lose the same component of the shift. Relabelling "
    "the atoms turns the direction, although nothing physical has changed; so may another skin or number of "
    "ranks.",
    workaround="Use 2026.7.4 or newer, or exclude/type, which is not affected.",
    scene="two types in disorder, shiftscale 0",
    model_variant=Variant(scales_across_types, NormalOfLastPair, fit=last_pair),
    replaces=("cross_type_normal",),
    gaps=(
        Gap(
            _several_directions,
            "directions differ between particles with RK1 and RK2, and on several ranks; and which pair it is follows "
            "from the shifts of the set-up alone",
        ),
    ),
    expected_in_alarms=(
        AlarmDifference(
            ("ranks",),
            lambda problem: problem.rheo.shifting is not None and problem.rheo.shifting.scale_cross_type is not None,
            "on several ranks every particle has a mixture of directions of its own, which no variant reproduces",
        ),
    ),
)

ENTRIES = (CROSS_TYPE_SUPPORT, CROSS_TYPE_NORMAL)
