"""A scene: everything that defines one case, as validated data. Without raw LAMMPS text it is safe from strangers.

The models are the file format: `lammps_cases/scene/scene.schema.json` (for editors) is generated from them. Quantities
are in the scene's LAMMPS units; energies are per unit mass.
"""

from lammps_cases.scene.case import Scene, check_name
from lammps_cases.scene.particles import (
    AtomType,
    FromData,
    FromDump,
    FromFile,
    FromXYZ,
    Lattice,
    LawSettings,
    Listed,
    PowerLaw,
    Values,
)
from lammps_cases.scene.runs import TwinSettings
from lammps_cases.scene.settings import ForceSettings, RheoSettings
from lammps_cases.scene.values import models

__all__ = [
    "AtomType",
    "ForceSettings",
    "FromData",
    "FromDump",
    "FromFile",
    "FromXYZ",
    "Lattice",
    "LawSettings",
    "Listed",
    "PowerLaw",
    "RheoSettings",
    "Scene",
    "TwinSettings",
    "Values",
    "check_name",
    "models",
]
