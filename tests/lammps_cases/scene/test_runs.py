"""Engine settings, twins and expected refusals of a scene, and which of them may be combined."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from lammps_cases.scene.runs import EngineSettings, Expect, Rebuild, TwinSettings

BAD: list[tuple[type, dict[str, Any], str]] = [
    (Rebuild, {"every": 2, "delay": 3}, "delay must be 0 or a multiple of every, found 3 and 2"),
    (Rebuild, {"every": 0}, "greater than or equal to 1"),
    (EngineSettings, {"every": 2, "delay": 3}, "delay must be 0 or a multiple of every"),
    (EngineSettings, {"processors": [2, 1, 1]}, r"processors must be as many as ranks \(1\)"),
    (EngineSettings, {"balance": 5}, "balance .* needs communication tiled, found brick"),
    (EngineSettings, {"time_limit": 3601}, "less than or equal to 3600"),
    (TwinSettings, {}, "needs exactly one of translate, boost, .*found 0"),
    (TwinSettings, {"relabel": True, "split": True}, "found relabel split"),
    (TwinSettings, {"rescale": 3.0}, "power of two other than 1, found 3.0"),
    (TwinSettings, {"rescale": 1.0}, "power of two other than 1, found 1.0"),
    (TwinSettings, {"rescale": 2.0**21}, r"within 2\^-20 to 2\^20"),
    (TwinSettings, {"tilt": [0]}, "other than 0 for some edge"),
    (Expect, {"refused": "ERROR: : a b"}, "words that only this refusal has"),
]


@pytest.mark.parametrize(("model", "content", "rule"), BAD)
def test_incompatible_settings_are_refused(model: Any, content: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        model.model_validate(content)


@pytest.mark.parametrize("content", [{"processors": [2, 1, 1], "ranks": 2}, {"balance": 5, "communication": "tiled"}])
def test_compatible_settings_are_accepted(content: dict[str, Any]) -> None:
    assert EngineSettings.model_validate(content)


def test_newton_of_bonds_defaults_to_that_of_pairs() -> None:
    flags = [
        EngineSettings(newton=pair, newton_bond=bond).newton_flags for pair in (True, False) for bond in (None, True)
    ]
    assert flags == [(True, True), (True, True), (False, False), (False, True)]


@pytest.mark.parametrize(("key", "value"), [("rescale", 0.25), ("newton", False), ("tilt", [1, 0, 0]), ("ranks", 2)])
def test_kind_of_a_twin_is_its_key(key: str, value: Any) -> None:
    assert TwinSettings.model_validate({key: value}).kind == key
