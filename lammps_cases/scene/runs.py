"""How LAMMPS takes a scene, once or twice, and what it must say."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from eos_ref.model.units import UnitStyle
from lammps_cases.scene.values import BrokenRule, Finite, Positive, SceneModel, Vector

Boundary = Literal["f", "s", "m", "fs", "sf", "fm", "mf", "sm", "ms"]


class Rebuild(SceneModel):
    """When neighbour lists are built anew."""

    every: int = Field(1, ge=1, strict=True)
    delay: int = Field(0, ge=0, strict=True)
    check: bool = True

    @model_validator(mode="after")
    def _multiple(self) -> Rebuild:
        if self.delay % self.every:
            raise BrokenRule("delay must be 0 or a multiple of every", "delay", found=f"{self.delay} and {self.every}")
        return self


class EngineSettings(Rebuild):
    """Settings of LAMMPS that do not change what is documented to come out."""

    newton: bool = True
    newton_bond: bool | None = Field(None, description="newton of bonds; default: that of pairs")
    skin: Positive = Field(0.3, description="of neighbour lists, in spacings")
    ghosts: Positive | None = Field(
        None,
        description="distance from a process at which it has images and others' particles, in spacings",
    )
    ranks: Literal[1, 2] = 1
    processors: tuple[int, int, int] | None = Field(None, description="how processes share the box; default: LAMMPS'")
    communication: Literal["brick", "tiled"] = "brick"
    balance: Annotated[int, Field(ge=1, strict=True)] | None = Field(
        None,
        description="steps after which particles are distributed again to processes, which is done before the first",
    )
    sort: Annotated[int, Field(ge=0, strict=True)] | None = Field(
        None, description="steps after which particles are sorted in memory; 0: never"
    )
    search: Literal["bin", "nsq", "multi"] = Field("bin", description="how lists of neighbours are built")
    boundary: Boundary = Field(
        "f", description="of faces that are not periodic: both alike, or the lower and the upper one"
    )
    time_limit: Annotated[Finite, Field(gt=0, le=3600)] = Field(60.0, description="seconds")

    @model_validator(mode="after")
    def _shared(self) -> EngineSettings:
        if self.processors is not None and math.prod(self.processors) != self.ranks:
            raise BrokenRule(
                f"processors must be as many as ranks ({self.ranks})", "processors", found=list(self.processors)
            )
        if self.balance is not None and self.communication != "tiled":  # the style shift rounds positions
            raise BrokenRule("balance (style rcb) needs communication tiled", "balance", found=self.communication)
        return self

    @property
    def newton_flags(self) -> tuple[bool, bool]:
        """Return newton of pairs and of bonds."""
        return self.newton, self.newton if self.newton_bond is None else self.newton_bond


Edges = Annotated[int, Field(ge=-8, le=8, strict=True)]


class TwinSettings(SceneModel):
    """A second run of LAMMPS, its own first one the reference: exactly one of the keys; see `lammps_cases.setup`."""

    translate: Vector | None = Field(None, description="displacement of all particles, wrapped in periodic axes")
    boost: Vector | None = Field(None, description="velocity added to all particles, walls included")
    relabel: Literal[True] | None = Field(None, description="ids assigned again at random (seeded)")
    rescale: Positive | None = Field(None, description="lengths times a power of two; densities and velocities stay")
    units: UnitStyle | None = Field(None, description="everything measured in another system of units")
    newton: Annotated[bool, Field(strict=True)] | None = Field(None, description="the other setting")
    skin: Positive | None = Field(None, description="another skin, in spacings")
    rebuild: Rebuild | None = Field(None, description="neighbour lists built at other steps")
    split: Literal[True] | None = Field(None, description="one run against two, the second with pre no")
    ranks: Literal[2] | None = Field(None, description="two processes against one")
    tilt: tuple[Edges] | tuple[Edges, Edges, Edges] | None = Field(
        None, description="by how many whole edges the box is tilted further: xy in 2D; xy, xz and yz in 3D"
    )

    @model_validator(mode="after")
    def _exactly_one(self) -> TwinSettings:
        given = [key for key in type(self).model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            raise BrokenRule(f"needs exactly one of {', '.join(type(self).model_fields)}", found=" ".join(given) or 0)
        if self.rescale is not None and not 2.0**-20 <= self.rescale <= 2.0**20:
            raise BrokenRule("rescale must lie within 2^-20 to 2^20", "rescale", found=self.rescale)
        if self.rescale is not None and (math.frexp(self.rescale)[0] != 0.5 or self.rescale == 1):
            raise BrokenRule("rescale must be a power of two other than 1", "rescale", found=self.rescale)
        if self.tilt is not None and not any(self.tilt):
            raise BrokenRule("tilt must be other than 0 for some edge", "tilt", found=list(self.tilt))
        return self

    @property
    def kind(self) -> str:
        """Return the key given."""
        return next(key for key in type(self).model_fields if getattr(self, key) is not None)


class Expect(SceneModel):
    """How LAMMPS must refuse the scene."""

    refused: str = Field(min_length=8, description="text that LAMMPS' error message must contain")

    @model_validator(mode="after")
    def _specific(self) -> Expect:
        if len(self.refused.replace("ERROR", "").strip(" :")) < 8:
            raise BrokenRule("refused must hold words that only this refusal has", "refused", found=repr(self.refused))
        return self
