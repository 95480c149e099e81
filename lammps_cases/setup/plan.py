"""Plan of a scene: the quantities, lists and fixes that each side needs for the compared fields, and why.

`lammps_cases.setup.commands` gives LAMMPS only what the plan needs. For the reference the plan only informs the
reader: the evaluation follows from the same table, `eos_ref.model.quantities`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from eos_ref.model import quantities
from lammps_cases.scene import Scene
from lammps_cases.setup import reference_side


@dataclass(frozen=True)
class Item:
    """One quantity, list or fix: whether it is needed, and why."""

    name: str
    needed: bool
    why: str


@dataclass(frozen=True)
class Plan:
    """Items of the reference and of LAMMPS."""

    reference: tuple[Item, ...]
    lammps: tuple[Item, ...]

    def needs(self, name: str) -> bool:
        """Return whether the reference or LAMMPS needs an item."""
        return any(item.needed for item in (*self.reference, *self.lammps) if item.name == name)


# Names that LAMMPS lacks or that differ there.
_WORDS = {
    "pairs": "neighbour list",
    "kernel": "kernel values",
    "correction": "reproducing kernel",
    "chi": "walls (chi, wall density)",
    "surface": "surface detection",
    "f": "forces",
}


def plan(scene: Scene) -> Plan:
    """Derive the plan of a scene."""
    of_model = scene.whole_model and not scene.expect
    return Plan(tuple(_model_items(scene) if of_model else _law_items(scene)), tuple(_lammps_items(scene)))


def _model_items(scene: Scene) -> Iterable[Item]:
    """Yield the quantities of the particle model: compared, needed by another one, needed to step, or left out."""
    model = reference_side.with_cut(scene, scene.rheo.cut or 1.0)
    words = _WORDS | {"rho": "density, summed" if scene.rho_sum else "density, given"}
    compared = {name for field in scene.compare for name in quantities.evaluated_for(model, field)}
    stepping = quantities.needed_to_step(model) if scene.evolve else ()
    needed = quantities.required(model, (*scene.compare, *stepping))
    inputs = {user: quantities.QUANTITIES[user].needs(model) for user in needed}
    for name in quantities.order():
        users = [words.get(user, user) for user, of in inputs.items() if name in of]
        reasons = ["compared"] * (name in compared) + ["steps need it"] * (name in stepping)
        reasons += [f"for {', '.join(users)}"] * bool(users)
        yield Item(words.get(name, name), name in needed, "; ".join(reasons) or "nothing compared depends on it")
    steps = f"{scene.evolve.steps} steps, compared at {', '.join(map(str, scene.snapshots))}" if scene.evolve else ""
    yield Item("time steps", bool(steps), steps or "one evaluation of the state given")


def _law_items(scene: Scene) -> Iterable[Item]:
    """Yield the items that an equation of state needs."""
    moves = scene.evolve is not None
    sums = scene.rho_sum
    gases = dict.fromkeys(law.style for law in scene.pressure if law.needs_energy)
    engine_density = "LAMMPS' own density is fed to the reference law, so nothing else can be blamed on the law"
    yield Item("pressure", True, "the field compared")
    yield Item(
        "density",
        not (moves or sums),
        engine_density if moves or sums else "input of every law, given by the scene",
    )
    yield Item("energy", bool(gases), f"input of {', '.join(gases)}" if gases else "no law of this scene depends on it")
    yield Item("positions", False, "no law depends on them")
    yield Item("neighbour list", False, "no compared field is a sum over neighbours")
    yield Item("kernel", False, "no compared field is a sum over neighbours")
    yield Item(
        "forces",
        False,
        "not compared; LAMMPS' own density is used after its time steps" if moves else "not compared",
    )


def _lammps_items(scene: Scene) -> Iterable[Item]:
    """Yield the fixes and settings of LAMMPS, each with its reason."""
    moves, sums = scene.evolve is not None, scene.rho_sum
    neighbours = scene.interacts
    reason = "density is summed over neighbours" if sums else "particles move" if moves else "neighbours are compared"
    heats = scene.thermal and (moves or scene.whole_model)
    yield from (
        Item("fix rheo", True, "defines rho0 and cs"),
        Item("fix rheo/pressure", True, "fills the pressure that forces use, and evaluates the one that is output"),
        Item("fix rheo/viscosity", True, "LAMMPS does not run without it"),
        Item(
            "pair rheo",
            neighbours,
            reason if neighbours else "run 0 needs no neighbours; without it LAMMPS lists none",
        ),
        Item(
            "fix rheo/thermal",
            heats,
            "energy evolves" if heats else "energy is constant in run 0" if scene.thermal else "no energy",
        ),
        Item(
            "fix enforce2d",
            moves and scene.dimension == 2,
            "keeps z at 0 while particles move" if moves else "nothing moves in run 0",
        ),
        Item("rheo/thermal atoms", scene.thermal, "particles carry energy" if scene.thermal else "no energy"),
        Item(
            "time steps",
            moves,
            f"{scene.evolve.steps} steps" if scene.evolve else "the law acts on given densities",
        ),
    )
