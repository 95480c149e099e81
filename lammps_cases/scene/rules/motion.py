"""Rules of the forces of other fixes, of stresses and of time steps."""

from __future__ import annotations

from typing import Any

import numpy as np

from lammps_cases.scene.rules.rule import Evaluated, Rule, rules_of


def _acts(at: Evaluated, style: str, some: bool = False, part: bool = False) -> Any:
    """Return the particles that a fix of a style acts on; one of ``some`` types, with components left out."""
    acted_n = np.zeros(at.evaluator.n, bool)
    for force in at.sim.model.forces:
        types = force.types is not None or not some
        if force.style == style and types and (None in force.vector) >= part:
            acted_n |= force.acts_on(at.evaluator.type_n)
    return acted_n


def _of_some_types(at: Evaluated) -> Any:
    """Return the particles that a fix of some types leaves alone."""
    left_n = np.zeros(at.evaluator.n, bool)
    for force in at.sim.model.forces:
        left_n |= ~force.acts_on(at.evaluator.type_n)
    return left_n


def _set_in_turn(at: Evaluated) -> Any:
    """Return the particles on which setforce acts after or before other fixes."""
    acted_n, mixed_n = np.zeros(at.evaluator.n, bool), np.zeros(at.evaluator.n, bool)
    set_n = np.zeros(at.evaluator.n, bool)
    for force in at.sim.model.forces:
        acts_n = force.acts_on(at.evaluator.type_n)
        if force.style == "setforce":
            mixed_n |= acts_n & acted_n
            set_n |= acts_n
        else:
            mixed_n |= acts_n & set_n
            acted_n |= acts_n
    return mixed_n


def _every(at: Evaluated) -> Any:
    return np.full(at.evaluator.n, at.step > 0)


def _other_neighbours(at: Evaluated) -> Any:
    """Return the particles that have moved since the start relative to some neighbour."""
    x_nc = at.sim.evaluated.x_nc
    moved_nc = x_nc - at.start.x_nc
    return at.any_of_n(at.differs_p(moved_nc)) & (at.step > 0)


def _crossed(at: Evaluated) -> Any:
    """Return the particles that have left the box through a periodic boundary."""
    return at.sim.box.images(at.sim.state.x_nc).any(axis=1) & (at.step > 0)


def _deformed(at: Evaluated, remap: str | None = None) -> Any:
    """Return the particles, all or none, of a box that has grown: with positions, without them, or either."""
    deform = at.sim.model.deform
    grown = deform is not None and deform.changes and remap in (None, deform.remap)
    return np.full(at.evaluator.n, grown and at.step > 0)


def _meets_moving_images(at: Evaluated) -> Any:
    """Return the particles that meet images whose velocities are not the particles'."""
    if at.evaluator.image_velocity_cc is None:
        return np.zeros(at.evaluator.n, bool)
    moving_pc = at.sim.box.periods(at.evaluator.shift_pc) @ at.evaluator.image_velocity_cc
    return at.any_of_n(np.any(moving_pc, axis=1))


_force, _step = rules_of("f"), rules_of("pairs")
RULES = (
    _force(
        "gravity",
        "Gravity accelerates all particles equally.",
        lambda at: _acts(at, "gravity"),
        "formula.gravity-of-unit-mass",
    ),
    _force(
        "force-added",
        "fix addforce adds a force.",
        lambda at: _acts(at, "addforce"),
        "formula.added-force-lost",
    ),
    _force(
        "force-set",
        "fix setforce sets the force.",
        lambda at: _acts(at, "setforce"),
        "formula.set-force-added",
    ),
    _force(
        "force-set-partly",
        "fix setforce leaves components that are NULL.",
        lambda at: _acts(at, "setforce", part=True),
        "formula.set-force-whole",
    ),
    _force(
        "force-of-types",
        "Fixes act only on the particles of their groups.",
        _of_some_types,
        "formula.forces-on-all",
    ),
    _force(
        "force-order",
        "Fixes act in their order.",
        _set_in_turn,
        "formula.forces-reversed",
    ),
    Rule(
        "stress-viscous",
        "Viscous stresses follow from velocity gradients.",
        lambda at: at.sim.output("stress/v").any(axis=(1, 2)),
        needs=("stress/v",),
        faults=("formula.stress-half",),
    ),
    Rule(
        "stress-total",
        "Total stresses have the pressure on their diagonal.",
        lambda at: at.sim.output("stress/t").any(axis=(1, 2)),
        needs=("stress/t",),
        faults=("formula.stress-pressure-sign",),
    ),
    _step(
        "step-velocity",
        "Forces change velocities, half a step at a time.",
        _every,
        "formula.kick-missing",
    ),
    _step(
        "step-position",
        "Positions move with the velocities at half a step.",
        _every,
        "formula.drift-with-old-velocity",
    ),
    _step(
        "step-gradients",
        "The first half of the continuity equation takes gradients at half a step.",
        lambda at: _every(at) & (not at.sim.model.fix.rho_sum),
        "formula.gradients-late",
    ),
    _step(
        "step-neighbours",
        "Pairs and kernels are those of the current positions.",
        _other_neighbours,
        "formula.neighbours-stale",
    ),
    _step(
        "step-walls",
        "Densities of walls are reconstructed within steps.",
        lambda at: at.solid_n & at.any_of_n(at.mixed_p) & at.evaluator.walls & (at.step > 0),
        "formula.walls-stale",
    ),
    _step(
        "step-across",
        "Particles cross a periodic boundary.",
        _crossed,
    ),
    _step(
        "step-stretched",
        "Positions keep their fractions of a box that changes.",
        lambda at: np.full(at.evaluator.n, at.sim.box != at.box),
        "formula.stretched-alone",
    ),
    _step(
        "step-deformed",
        "Box edges grow at their rates, relative to their length when the run began, about their centres.",
        _deformed,
        "formula.deform-from-corner",
        "formula.deform-compound",
    ),
    _step(
        "step-sheared",
        "Box edges tilt at their rates, relative to the edge along which they go.",
        lambda at: _every(at) & at.sim.box.tilted & (at.sim.model.deform is not None),
        "formula.shear-of-the-other-edge",
    ),
    _step(
        "step-sheared-again",
        "A run starts with the tilt that the last one left.",
        lambda at: _every(at) & any(at.sim.begun.tilt) & (at.sim.model.deform is not None),
        "formula.shear-anew",
    ),
    _step(
        "images-moving",
        "Periodic images have their own velocities where the box changes and positions stay (remap v).",
        lambda at: _meets_moving_images(at),
        "formula.images-at-rest",
        "formula.images-sheared-alone",
    ),
    _step(
        "step-remapped",
        "Positions grow with the box before the next step begins.",
        lambda at: _deformed(at, remap="x"),
        "formula.deform-alone",
        "formula.deform-late",
    ),
    _step(
        "step-not-remapped",
        "Positions stay where they are in a box that grows.",
        lambda at: _deformed(at, remap="none"),
        "formula.deform-with-positions",
    ),
)
