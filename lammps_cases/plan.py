"""What a scene needs modelled, on both sides, and what it does not.

The plan follows from the fields that the scene compares. `lammps_cases.commands` and `lammps_cases.evaluate` build only
what it names.
"""

from __future__ import annotations

from dataclasses import dataclass

from lammps_cases.scene import Scene


@dataclass(frozen=True)
class Item:
    """One quantity, list or fix: whether it is needed, and why."""

    name: str
    needed: bool
    why: str


@dataclass(frozen=True)
class Plan:
    """What is modelled: items of the reference and of LAMMPS."""

    reference: tuple[Item, ...]
    lammps: tuple[Item, ...]

    def needs(self, name: str) -> bool:
        """Whether the reference or LAMMPS needs an item."""
        return any(item.needed for item in (*self.reference, *self.lammps) if item.name == name)


def plan(scene: Scene) -> Plan:
    """Derive the plan of a scene."""
    moves = scene.evolve is not None
    sums = scene.rho_sum
    ideal = any(law.style == "ideal/gas" for law in scene.pressure)
    engine_density = "LAMMPS' own density is fed to the reference law, so nothing else can be blamed on the law"
    reference = (
        Item("pressure", True, "the field compared"),
        Item(
            "density",
            not (moves or sums),
            engine_density if moves or sums else "input of every law, given by the scene",
        ),
        Item("energy", ideal, "input of ideal/gas" if ideal else "no law of this scene depends on it"),
        Item("positions", False, "no law depends on them"),
        Item("neighbour list", False, "no compared field is a sum over neighbours"),
        Item("kernel", False, "no compared field is a sum over neighbours"),
        Item(
            "forces",
            False,
            "not compared; LAMMPS' own density is used after its time steps" if moves else "not compared",
        ),
    )
    neighbours = scene.interacts
    reason = "density is summed over neighbours" if sums else "particles move" if moves else "neighbours are compared"
    heats = scene.thermal and (moves or scene.whole_model)
    lammps = (
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
    return Plan(reference, lammps)
