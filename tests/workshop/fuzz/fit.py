"""Adjust a drawn scene: a time step within its limits, lists that miss no neighbour, enough room."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.consistent import consistent_model, consistent_state
from eos_ref.model.parameters import Model
from eos_ref.model.state import State
from eos_ref.model.units import UNITS
from lammps_cases.run.prepared_case import PreparedCase
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.setup import reference_side
from lammps_cases.studies.stability.kinds import moment_matrices
from lammps_cases.studies.stability.limits import numbers
from tests.workshop.fuzz.drawing import Content, rounded

Prepare = Callable[[Content], PreparedCase]
BUILDS = ("every", "delay")  # settings by which lists may be older than the last step
DEFAULT_SKIN = 0.3
CONDITION = 1e6  # of a moment matrix; its square times 2^-52 bounds the relative error of a gradient


@dataclass(frozen=True)
class Fit:
    """What is drawn for fitting: the share of the largest time step, a kernel if the scene's has no gradients,

    and whether zmin stays above the neighbours of some particles.
    """

    share: float
    kernel: str = "quintic"
    zmin: bool = True


def fitted(content: Content, fit: Fit, prepare: Prepare) -> tuple[Content, PreparedCase]:
    """Return a content whose kernel, time step, margins and rebuilding of lists suit its scene, and its case.

    Raises
    ------
    InputError, ValidationError
        It is not a valid scene.
    """
    ready = prepare(content)
    if ready.case.scene.interacts and not _has_gradients(ready):
        content = content | {"rheo": content["rheo"] | {"kernel": fit.kernel}}
        ready = prepare(content)
    content = _without_lost_walls(content, ready)
    content = content if fit.zmin else _with_enough_neighbours(content, ready)
    if "evolve" not in content:
        return content, prepare(content)
    limit, speed, sound = _limits(ready)
    lacking = min(_lacking(*side) for side in ready.sides)
    step = rounded(lacking * limit * fit.share, 2)
    content = content | {"evolve": _with_time_step(content["evolve"], step, lacking)}
    boost = max(map(abs, content.get("twin", {}).get("boost", [0.0])))
    travel = content["evolve"]["steps"] * step * (3 * speed + boost + 0.2 * sound)
    content = _without_old_lists(_with_room(content, travel), travel)
    return content, prepare(content)


def _with_time_step(evolve: Content, step: float, lacking: float) -> Content:
    """Return time steps of a length, halved after stops that change it.

    Forces between images that move with the box lack factors as well (`_lacking`), so that these move more slowly.
    """
    stops = [stop | ({"timestep": rounded(step / 2)} if "timestep" in stop else {}) for stop in evolve.get("stops", ())]
    made = evolve | {"timestep": step} | ({"stops": stops} if stops else {})
    if shares := evolve.get("deform"):  # until here, of what the edges grow by in all steps
        time = step * evolve["steps"] / (lacking if shares.get("remap") == "v" else 1.0)
        made["deform"] = {key: rounded(of / time) if key != "remap" else of for key, of in shares.items()}
    return made


def _problem(scene: Scene, atoms: Atoms) -> tuple[Model, State]:
    """Return model and state of a scene in consistent numbers."""
    units = UNITS[scene.units]
    model, state = reference_side.model(scene, atoms, ""), reference_side.state(scene, atoms)
    return consistent_model(model, units), consistent_state(state, units)


def _evaluated(ready: PreparedCase) -> tuple[ArrayEvaluator, State]:
    """Return the evaluator of a scene at its particles, and their state."""
    model, state = _problem(ready.case.scene, ready.atoms)
    box = reference_side.box(ready.case.scene, ready.atoms)
    evaluator = ArrayEvaluator(model, box, state.type_n, state.solid_n)
    evaluator.move(state.x_nc)
    return evaluator, state


def _has_gradients(ready: PreparedCase) -> bool:
    """Return whether a reproducing kernel has gradients at all particles: otherwise the reference defines none."""
    evaluator, state = _evaluated(ready)
    if not evaluator.model.corrects_gradients:
        return True
    m_nbb, definite_n, used_n = moment_matrices(evaluator, state.rho_n)
    return bool(definite_n[used_n].all()) and bool((np.linalg.cond(m_nbb[used_n]) < CONDITION).all())


def _with_enough_neighbours(content: Content, ready: PreparedCase) -> Content:
    """Return a content whose reproducing kernel is used by all particles; otherwise few values are defined."""
    rheo, (evaluator, _) = ready.case.scene.rheo, _evaluated(ready)
    if not (ready.case.scene.whole_model and evaluator.model.corrects_gradients and rheo.zmin):
        return content
    fewest = int(np.asarray(evaluator.coordination_n).min())
    return content | {"rheo": content["rheo"] | {"zmin": min(rheo.zmin, fewest)}}


def _limits(ready: PreparedCase) -> tuple[float, float, float]:
    """Return the largest time step by sound, viscosity and heat, and the largest speeds of particles and of sound."""
    model, state = _problem(ready.case.scene, ready.atoms)
    speed = float(np.abs(state.v_nc).max(initial=0.0))
    limits = numbers(model, state, 1.0)
    sound = max(limits.c, float(model.cs.max()))
    return 1 / max(limits.fraction, 4 * sound / limits.h), speed, sound


def _lacking(scene: Scene, atoms: Atoms) -> float:
    """Return the product of the factors that findings may lack, each 1 where the lack makes nothing larger.

    Findings may lack factors of the volume or the heat capacity of a particle, or of its units, in a force or a flow of
    heat, divide that by the density, or take temperatures for those of a unit of mass; background pressures that are
    not converted accelerate as forces of their number do: time steps are short enough for them too, and in the numbers
    of a twin as well.
    """
    model, state = _problem(scene, atoms)
    mass_n, rho_n = atoms.mass_n, state.rho_n
    volume = _smallest_volume(scene, atoms)
    factors = [1 / rho_n]
    if heats := [each.specific_heat for each in model.thermal or ()]:
        factors += [mass_n * np.array(heats)[state.type_n - 1], rho_n, 1 / mass_n, rho_n / mass_n]
    flow = min(float(factor_n.min()) for factor_n in factors)
    units = UNITS[scene.units]
    pressed = units.of("pressure") / units.of("f") if any(law.P_b for law in scene.pressure) else 1.0
    return min(1.0, volume) * min(1.0, flow) * min(1.0, pressed) / max(1.0, units.energy)


def _smallest_volume(scene: Scene, atoms: Atoms) -> float:
    return float((atoms.mass_n / _problem(scene, atoms)[1].rho_n).min())


def _without_lost_walls(content: Content, ready: PreparedCase) -> Content:
    """Return a content without a twin in whose units forces that lack a volume leave densities of walls without digits.

    Walls use accelerations independent of the time step: for volumes below the rounding of 1 they exceed the correct
    ones by more than all digits of a density.
    """
    units = content.get("twin", {}).get("units") and ready.case.scene.rheo.interface_reconstruct
    if not units or min(_smallest_volume(*side) for side in ready.sides) > EPS:
        return content
    return {key: value for key, value in content.items() if key != "twin"}


def _with_room(content: Content, travel: float) -> Content:
    """Return a content whose particles stay in the box along axes that are not periodic."""
    positions: Content = dict(content["positions"])
    if all(positions.get("periodic") or [True]):
        return content
    if "lattice" in positions:
        least = travel / positions["spacing"] + 0.6
        positions["margin"] = max(positions.get("margin", 1.0), rounded(least))
    else:
        positions["low"] = [rounded(low - travel, 6) for low in positions["low"]]
        positions["high"] = [rounded(high + travel, 6) for high in positions["high"]]
    return content | {"positions": positions}


def _without_old_lists(content: Content, travel: float) -> Content:
    """Return a content without settings by which lists could miss a neighbour, which would not be LAMMPS' fault."""
    spacing = content["positions"].get("spacing", 1.0)
    engine, twin = content.get("engine", {}), content.get("twin", {})
    skin = min(engine.get("skin", DEFAULT_SKIN), twin.get("skin", np.inf))
    if 2 * travel <= skin * spacing and "deform" not in content.get("evolve", {}):
        return content

    def safe(settings: Content) -> Content:
        return {key: value for key, value in settings.items() if key not in BUILDS}

    changed: dict[str, Any] = {"engine": safe(engine)} if engine else {}
    if "rebuild" in twin:
        changed["twin"] = {"rebuild": safe(twin["rebuild"])}
    return content | changed
