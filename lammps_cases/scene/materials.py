"""What the particles of a scene are: atom types and equations of state."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from eos_ref import EOS
from eos_ref.eos.registry import LAWS, PARAMETER, Style
from eos_ref.syntax.fixes import PressureEntry
from lammps_cases.scene.values import BrokenRule, Finite, NonNegative, Positive, SceneModel, TypeRange, Vector


class PowerLaw(SceneModel):
    """Arguments of fix rheo/viscosity power."""

    eta: NonNegative
    gd0: Positive
    K: NonNegative
    n: Finite


# A mapping is a power law; the tags hold spaces, which keeps them out of the place named in messages.
ViscosityLaw = Annotated[
    Annotated[NonNegative, Tag("a number")] | Annotated[PowerLaw, Tag("power law")],
    Discriminator(lambda law: "power law" if isinstance(law, dict | PowerLaw) else "a number"),
]


class AtomType(SceneModel):
    """One atom type: mass, phase, and per-type values of the RHEO fixes (rho0 and cs: default 1)."""

    mass: Positive
    rho0: Positive | None = None
    cs: Positive | None = None
    phase: Literal["fluid", "solid"] = Field("fluid", description="of all its particles, at the beginning")
    viscosity: ViscosityLaw = Field(0.1, description="constant, or eta, gd0, K, n of a power law")
    conductivity: NonNegative = Field(0.1, description="of particles that carry energy")
    specific_heat: Positive = Field(1.0, description="of particles that carry energy")
    latent_heat: NonNegative | None = Field(None, description="energy per unit mass; needs T_freeze")
    T_freeze: Finite | None = None
    velocity: Vector | None = Field(None, description="initial velocity, instead of velocity.uniform: a moving wall")

    @model_validator(mode="after")
    def _freezes(self) -> AtomType:
        if self.latent_heat is not None and self.T_freeze is None:
            raise BrokenRule("latent_heat needs T_freeze", "latent_heat")
        return self

    @property
    def thermal(self) -> bool:
        """Return whether a thermal property is given."""
        return bool({"conductivity", "specific_heat", "latent_heat", "T_freeze"} & self.model_fields_set)


def entries(law: EOS) -> list[dict[str, Any]]:
    """Return the entries of fix rheo/pressure, as a scene has them, that give all types one law."""
    argument = {} if law.law.parameter is None else {law.law.parameter: law.parameter}
    background = [{"types": "*", "style": "background", "P_b": law.background}] if law.background else []
    return [{"types": "*", "style": law.style, **argument}, *background]


class LawSettings(SceneModel):
    """One entry of fix rheo/pressure: a type range, a style and its argument."""

    types: TypeRange = Field(description="*, n, *n, m* or m*n, as in the manual")
    style: Style | Literal["background"]
    A3: Finite | None = None
    gamma: Finite | None = None
    P_b: Finite | None = None

    @model_validator(mode="after")
    def _one_argument(self) -> LawSettings:
        wanted = PARAMETER.get(self.style)
        for name in dict.fromkeys(PARAMETER.values()):
            given = getattr(self, name) is not None
            if given != (name == wanted):
                raise BrokenRule(f"{self.style} {'needs' if name == wanted else 'does not take'} {name}", name)
        return self

    @property
    def value(self) -> float | None:
        """Return the style's argument."""
        name = PARAMETER.get(self.style)
        return None if name is None else getattr(self, name)

    @property
    def needs_energy(self) -> bool:
        """Return whether the law depends on the internal energy."""
        return self.style != "background" and LAWS[self.style].needs_energy

    @property
    def entry(self) -> PressureEntry:
        """Return the entry as the reference takes it."""
        return PressureEntry(self.types, self.style, self.value)
