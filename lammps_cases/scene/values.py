"""What the models of a scene are made of: numbers, type ranges, files; and their common base."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints, WithJsonSchema


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise ValueError(f"must be a finite number, found {value!r}")
    return value


def _inside(path: str) -> str:
    parts = PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or "\\" in path:
        raise ValueError(f"must be a file in the scene's own folder or below, found {path!r}")
    return path


# A number is a number: neither true nor "1.5" is taken for one.
Finite = Annotated[float, Field(strict=True), AfterValidator(_finite)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Vector = Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3)]
# YAML reads a single type as a number.
RANGE_SCHEMA = {"type": ["string", "integer"]}
TypeRange = Annotated[
    str,
    BeforeValidator(lambda types: str(types) if type(types) is int else types),
    StringConstraints(pattern=r"^[0-9*-]{1,24}$"),  # nothing that LAMMPS could take for another word or command
    WithJsonSchema(RANGE_SCHEMA),
]
LocalFile = Annotated[str, AfterValidator(_inside)]


class SceneModel(BaseModel):
    """Part of a scene: immutable, and without keys that it does not know."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def models(base: type[SceneModel] = SceneModel) -> Iterator[type[SceneModel]]:
    """Return all models of the file format."""
    for model in base.__subclasses__():
        yield model
        yield from models(model)
