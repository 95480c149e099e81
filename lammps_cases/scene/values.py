"""The common base and the building blocks of a scene's models: numbers, type ranges, files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Annotated

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema


class BrokenRule(ValueError):
    """A rule that a part of a scene breaks, as raised by a validator.

    Parameters
    ----------
    rule : what is valid
    at : keys of the part that the rule concerns, relative to the model that checks it
    found : the value, if the rule does not include it
    """

    def __init__(self, rule: str, *at: str, found: object = None) -> None:
        self.rule, self.at, self.found = rule, at, found
        super().__init__(rule if found is None else f"{rule}, found {found}")


def _finite(value: float) -> float:
    if not math.isfinite(value):
        raise BrokenRule("must be a finite number", found=value)
    return value


def _inside(path: str) -> str:
    parts = PurePosixPath(path)
    if parts.is_absolute() or ".." in parts.parts or "\\" in path:
        raise BrokenRule("must be a file in the scene's own folder or below", found=repr(path))
    return path


def _range(types: object) -> object:
    text = str(types) if type(types) is int else types
    # Nothing that LAMMPS could take for another word or command.
    if not (isinstance(text, str) and re.fullmatch("[0-9*-]{1,24}", text)):
        raise BrokenRule("must be a range of types: *, n, *n, n* or m*n")
    return text


# A number is a number: neither true nor "1.5" is accepted.
Finite = Annotated[float, Field(strict=True), AfterValidator(_finite)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Vector = Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3)]
# YAML reads a single type as a number.
RANGE_SCHEMA = {"type": ["string", "integer"]}
TypeRange = Annotated[
    str,
    BeforeValidator(_range),
    WithJsonSchema(RANGE_SCHEMA),
]
LocalFile = Annotated[str, AfterValidator(_inside)]


class SceneModel(BaseModel):
    """Part of a scene: immutable, without unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def models(base: type[SceneModel] = SceneModel) -> Iterator[type[SceneModel]]:
    """Return all models of the file format."""
    for model in base.__subclasses__():
        yield model
        yield from models(model)
