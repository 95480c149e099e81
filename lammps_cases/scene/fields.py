"""The fields that a scene can compare: LAMMPS' output for each quantity of the model, and how it is judged.

Rank, dimension and inputs of a field are defined in `eos_ref.model.quantities`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from eos_ref.model.quantities import QUANTITIES, Quantity

Stage = Literal[
    "integration",
    "neighbours",
    "walls",
    "gradients",
    "surfaces",
    "shifting",
    "viscosity",
    "eos",
    "thermal",
    "pair",
    "virial",
    "stress",
    "density",
]
STATE = "input to the check, not a result"
VIRIAL = "LAMMPS computes virials only on steps for which they were requested in advance"


@dataclass(frozen=True)
class Field:
    """LAMMPS' output for a quantity.

    Attributes
    ----------
    name : of the quantity
    stage : of a time step, which is blamed for a difference
    column : of compute rheo/property/atom; empty without one
    array : of the atom style, or of its properties; empty without one
    compute : another compute that shows it, by its style and arguments; empty without one
    overall : whether that compute has one number or tensor for all atoms, which each of them gets
    unaudited : why no audit can check it; None if the audit has the same array under another name
    of_solids : whether it exists only for solids, and is 0 for fluid; LAMMPS' phases are read with it
    """

    name: str
    stage: Stage
    column: str = ""
    array: str = ""
    unaudited: str | None = ""
    of_solids: bool = False
    compute: str = ""
    overall: bool = False

    @property
    def quantity(self) -> Quantity:
        """Return its record in the reference."""
        return QUANTITIES[self.name]

    @property
    def key(self) -> str:
        """Return the name of its array among those read after a job: that of the compute ``q`` if it has one."""
        return f"q.{self.name}" if self.column else self.array or self.compute_id

    @property
    def compute_id(self) -> str:
        """Return the id of its own compute, also the name of its array."""
        return f"own_{self.name.replace('/', '_')}"

    def words(self) -> str:
        """Return its words in the compute's command; ``NAME/*`` expands to components, in 2D to those in the plane."""
        return self.column + "/*" * (self.quantity.rank > 0) + " phase" * self.of_solids

    def shape(self, dimension: int) -> tuple[int, ...]:
        """Return the shape of its columns for one atom."""
        return (2,) if self.of_solids else (dimension,) * self.quantity.rank

    def of(self, arrays: Mapping[str, Any], dimension: int) -> Any:
        """Return its values from the arrays of a job, vectors with as many axes as dimensions."""
        array = arrays[self.key]
        return array[:, 0] * array[:, 1] if self.of_solids else self.planar(array, dimension)

    def planar(self, array: Any, dimension: int) -> Any:
        """Return an array with as many axes as dimensions; LAMMPS' vectors of atoms have three."""
        return array[(slice(None), *(slice(dimension),) * self.quantity.rank)]

    def placed(self, values: Any, array: Any) -> Any:
        """Return the values in the shape of LAMMPS' array: the inverse of `of`."""
        if self.of_solids:
            solid_n = values != 0
            return np.stack([np.where(solid_n, values, array[:, 0]), solid_n], axis=1)
        full = np.zeros(array.shape)
        full[tuple(map(slice, values.shape))] = values
        return full


def _column(name: str, stage: Stage, array: str = "", unaudited: str = "") -> Field:
    return Field(name, stage, name, array, unaudited)


# In the order in which a step computes them, by which a difference is blamed; after the first step the state is final
# at the end, except positions and phases, which an evaluation starts from, and densities of walls, which it computes.
FIELDS: dict[str, Field] = {
    field.name: field
    for field in (
        Field("x", "integration", array="x", unaudited=STATE),
        _column("phase", "integration", unaudited=f"{STATE}; melting and freezing depend on history"),
        _column("coordination", "neighbours"),
        _column("chi", "walls"),
        Field(
            "rho_wall",
            "walls",
            "rho",
            unaudited="LAMMPS does not expose the previous step's accelerations",
            of_solids=True,
        ),
        _column("grad/v", "gradients"),
        _column("surface", "surfaces"),
        _column("surface/divr", "surfaces"),
        _column("surface/n", "surfaces"),
        _column("surface/r", "surfaces"),
        _column("shift/v", "shifting"),
        _column("viscosity", "viscosity", "viscosity"),
        Field("pressure_used", "eos", array="pressure", unaudited=None),
        _column("pressure", "eos", "pressure"),
        _column("conductivity", "thermal", "conductivity"),
        _column("cv", "thermal"),
        _column("temperature", "thermal", "temperature"),
        _column("heatflow", "pair", "heatflow"),
        Field("drho", "pair", array="drho"),
        Field("f", "pair", array="f"),
        Field("stress/atom", "virial", unaudited=VIRIAL, compute="stress/atom NULL virial"),
        Field("virial", "virial", unaudited=VIRIAL, compute="pressure NULL virial", overall=True),
        Field("press", "virial", unaudited=VIRIAL, compute="pressure thermo_temp", overall=True),
        _column("stress/v", "stress"),
        _column("stress/t", "stress"),
        Field("v", "integration", array="v", unaudited=STATE),
        _column("rho", "density", "rho"),
        _column("energy", "integration", "esph", STATE),
        _column("status", "surfaces", unaudited="its bits are undocumented; see surface and phase"),
    )
}


def place(name: str) -> int:
    """Return the place of a field in the order of a step; beyond the last for other names."""
    return list(FIELDS).index(name) if name in FIELDS else len(FIELDS)


def in_step_order(names: Iterable[str]) -> list[str]:
    """Return the fields in the order of a step, followed by other names."""
    return sorted(names, key=lambda name: (place(name), name))


if TYPE_CHECKING:
    FieldName = str
else:
    FieldName = Literal[tuple(FIELDS)]  # the names that a scene may use
