"""The common base and the building blocks of a scene's models: numbers, type ranges, files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal, TypeVar, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    WithJsonSchema,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from eos_ref.model.quantities import named


class BrokenRule(ValueError):
    """A rule that a part of a scene breaks, as raised by a validator.

    Parameters
    ----------
    rule : what is valid
    at : keys of the part that the rule concerns, relative to the model that checks it
    found : the value, if the rule does not include it
    """

    def __init__(self, rule: str, *at: str | int, found: object = None) -> None:
        self.rule, self.at, self.found = rule, at, found
        super().__init__(rule if found is None else f"{rule}, found {found}")


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
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]


@dataclass(frozen=True)
class Per:
    """What a list has one member for, as metadata of its type.

    Attributes
    ----------
    of : axis of the scene, or type
    members : in words
    """

    of: Literal["axis", "type"]
    members: str


PER_AXIS, PER_TYPE = Per("axis", "components"), Per("type", "values")
Vector = Annotated[tuple[Finite, ...], Field(min_length=2, max_length=3), PER_AXIS]
# YAML reads a single type as a number.
RANGE_SCHEMA = {"type": ["string", "integer"]}
TypeRange = Annotated[
    str,
    BeforeValidator(_range),
    WithJsonSchema(RANGE_SCHEMA),
]
LocalFile = Annotated[str, AfterValidator(_inside)]


Powers = tuple[tuple[str, float], ...]  # quantities of the model or the input, each to a power
Path = tuple[str | int, ...]  # keys and indices, from the scene down


class Dim:
    """What the numbers of a key are, as metadata of its type: dimension and unit follow.

    Parameters
    ----------
    of : quantities of `eos_ref.model.quantities` (``number``: without unit): one for all numbers of the key, or one for
        each of its members; what depends on other keys is a function of the part of the scene and the whole scene
    about : what that function says, in words
    implied : the number that a key left out stands for, if it depends on the units
    """

    def __init__(self, *of: str | Callable[[Any, Any], Powers], about: str = "", implied: float | None = None) -> None:
        self._of, self.implied = of, implied
        self.about = about or self._words()

    def _words(self) -> str:
        units = [f"unit of {named(of).about}" for of in self._of if isinstance(of, str) and of != "number"]
        return ", ".join(units)

    def powers(self, model: Any, scene: Any, member: int = 0) -> Powers:
        """Return what a number is: the product of these."""
        of = self._of[min(member, len(self._of) - 1)]
        return ((of, 1.0),) if isinstance(of, str) else of(model, scene)


NUMBER = Dim("number")
OF_HOLDER = Dim(about="unit of the key above")  # what holds the part of the scene has the quantity


class SceneModel(BaseModel):
    """Part of a scene: immutable, without unknown keys; every number says what it is, by a `Dim`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        for key, field in cls.model_fields.items():
            numeric = float in _within(field.annotation)
            assert not numeric or cls.dim(key), f"{cls.__name__}.{key} holds numbers: its type needs a Dim"

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        schema = handler(core)
        for key, of_key in handler.resolve_ref_schema(schema).get("properties", {}).items():
            dim = cls.dim(key)
            if words := "; ".join(filter(None, (of_key.get("description"), dim.about if dim else ""))):
                of_key["description"] = words
        return schema

    @classmethod
    def dim(cls, key: str) -> Dim | None:
        """Return what the numbers of a key are; None for a key without numbers."""
        return next((each for each in cls.model_fields[key].metadata if isinstance(each, Dim)), None)


def _within(annotation: Any) -> Iterator[Any]:
    """Yield a type, its parts, and their metadata."""
    yield annotation
    for part in get_args(annotation):
        yield from _within(part)


Model = TypeVar("Model", bound=SceneModel)
Change = Callable[[Path, float, Powers], float]


def changed(scene: Model, change: Change) -> Model:
    """Return a scene with every number changed.

    The keys that count as given stay the same, except those that imply a number which changes.

    Parameters
    ----------
    change : new value of a number, of its place, value, and what it is
    """

    def of_model(model: SceneModel, path: Path, holder: Dim | None) -> Any:
        new = {}
        for key in type(model).model_fields:
            value, dim = getattr(model, key), model.dim(key)
            implied = dim.implied if dim and value is None else None
            made = of_value(
                value if implied is None else implied, (*path, key), holder if dim is OF_HOLDER else dim, model
            )
            new[key] = value if implied is not None and made == implied else made
        return type(model).model_construct(set(model.model_fields_set), **new)

    def of_value(value: Any, path: Path, dim: Dim | None, model: SceneModel, member: int = 0) -> Any:
        if isinstance(value, SceneModel):
            return of_model(value, path, dim)
        if isinstance(value, tuple):
            return tuple(of_value(each, (*path, k), dim, model, k) for k, each in enumerate(value))
        return change(path, value, dim.powers(model, scene, member)) if dim and isinstance(value, float) else value

    made: Model = of_model(scene, (), None)
    return made


def numbers(scene: SceneModel) -> list[tuple[Path, float, Powers]]:
    """Return the place and value of every number of a scene, and what it is."""
    found: list[tuple[Path, float, Powers]] = []

    def note(path: Path, value: float, powers: Powers) -> float:
        found.append((path, value, powers))
        return value

    changed(scene, note)
    return found


def lists(part: SceneModel, path: Path = ()) -> Iterator[tuple[Path, Per, tuple[Any, ...]]]:
    """Yield the place of every list with one member for each axis or type, what it has them for, and the list."""
    for key, value in part:
        per = _per(type(part), key)
        yield from _lists(value, (*path, key), per)


def _lists(value: Any, path: Path, per: Per | None) -> Iterator[tuple[Path, Per, tuple[Any, ...]]]:
    if isinstance(value, SceneModel):
        yield from lists(value, path)
    elif isinstance(value, tuple) and value and isinstance(value[0], tuple | SceneModel):
        for k, each in enumerate(value):
            yield from _lists(each, (*path, k), per)
    elif isinstance(value, tuple) and per:
        yield path, per, value


@cache
def _per(model: type[SceneModel], key: str) -> Per | None:
    field = model.model_fields[key]
    return next((each for each in (*field.metadata, *_within(field.annotation)) if isinstance(each, Per)), None)


def models(base: type[SceneModel] = SceneModel) -> Iterator[type[SceneModel]]:
    """Return all models of the file format."""
    for model in base.__subclasses__():
        yield model
        yield from models(model)
