"""Value types of the models of a scene: finite numbers, ranges of types, files next to the scene."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from lammps_cases.scene import Scene
from lammps_cases.scene.values import Finite, LocalFile, NonNegative, Positive, SceneModel, TypeRange, Vector, models

BAD: list[tuple[Any, Any]] = [
    *((Finite, value) for value in (True, "1.5", None, float("inf"), float("nan"))),
    *((Positive, value) for value in (0, -1.5)),
    (NonNegative, -1e-300),
    *((Vector, value) for value in ([1.0], [1.0] * 4, [1.0, float("nan")])),
    *((TypeRange, value) for value in (True, 1.5, "", "1 2", "1; shell", "a*", "1" * 25)),
    *((LocalFile, value) for value in ("/etc/passwd", "../a.xyz", "a/../../b", "a\\b")),
]
GOOD: list[tuple[Any, Any, Any]] = [
    (Finite, -3, -3.0),
    (Positive, 5e-324, 5e-324),
    (NonNegative, 0, 0.0),
    (Vector, [1, 2.5], (1.0, 2.5)),
    *((TypeRange, text, text) for text in ("*", "2", "*2", "2*", "1*3")),
    (TypeRange, 2, "2"),
    (LocalFile, "data/a.xyz", "data/a.xyz"),
]


@pytest.mark.parametrize(("kind", "value"), BAD)
def test_invalid_values_are_refused(kind: Any, value: Any) -> None:
    with pytest.raises(ValidationError):
        TypeAdapter(kind).validate_python(value)


@pytest.mark.parametrize(("kind", "value", "taken"), GOOD)
def test_valid_values_are_accepted(kind: Any, value: Any, taken: Any) -> None:
    assert TypeAdapter(kind).validate_python(value) == taken


def test_models_are_immutable_forbid_extra_keys_and_are_all_listed() -> None:
    class Part(SceneModel):
        a: int = 1

    class Below(Part):
        b: int = 2

    with pytest.raises(ValidationError, match="frozen"):
        Part().a = 2
    with pytest.raises(ValidationError, match="Extra inputs"):
        Below.model_validate({"c": 3})
    assert [*models(Part)] == [Below] and {Scene, Part, Below} <= {*models()}
