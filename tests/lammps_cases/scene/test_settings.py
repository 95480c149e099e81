"""Settings of a scene: arguments of fixes, compared steps, boxes that must not vanish; lines of the manual."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from lammps_cases.scene.manual import EXAMPLES, ExampleSettings
from lammps_cases.scene.runs import Stop
from lammps_cases.scene.settings import (
    DeformSettings,
    Evolve,
    ForceSettings,
    PairSettings,
    RheoSettings,
    ShiftSettings,
    SurfaceDetectionSettings,
)
from lammps_cases.scene.values import SceneModel

DETECTION = {"style": "coordination", "limit": 20.0, "splash": 4}


@pytest.mark.parametrize(
    ("steps", "snapshots"), [(1, (0, 1)), (9, (0, 1, 9)), (100, (0, 1, 10, 100)), (250, (0, 1, 10, 100, 250))]
)
def test_steps_compared_by_default(steps: int, snapshots: tuple[int, ...]) -> None:
    assert Evolve(steps=steps, timestep=0.1).snapshots == snapshots
    assert Evolve(steps=steps, timestep=0.1, compare_at=(steps,)).snapshots == (steps,)


def test_stop_is_compared_and_begins_a_run() -> None:
    evolve = Evolve(steps=8, timestep=0.1, stops=(Stop(at=3), Stop(at=5)))
    assert (evolve.snapshots, evolve.halts) == ((0, 1, 3, 5, 8), (3, 5))
    assert [stop.at for stop in evolve.beginnings] == [3, 5]


def test_each_piece_of_a_run_begins_with_a_set_up() -> None:
    """LAMMPS counts pieces from the beginning of a run: after the stop at 5, from there."""
    evolve = Evolve(steps=9, timestep=0.1, every=2, stops=(Stop(at=5),), compare_at=(9,))
    assert [stop.at for stop in evolve.beginnings] == [2, 4, 5, 7]
    assert evolve.snapshots == (9,)


@pytest.mark.parametrize(
    ("wrong", "rule"),
    [
        ({"compare_at": (3, 1, 4)}, r"compare_at must increase and end with steps \(4\), found \[3, 1, 4\]"),
        ({"compare_at": (1, 1, 4)}, "compare_at must increase"),
        ({"compare_at": (1, 3)}, "end with steps"),
        ({"stops": (Stop(at=5),)}, r"stops must increase and lie within 0 to steps \(4\), found \[5\]"),
        ({"every": 2, "compare_at": (2, 4)}, r"read at the last step alone \(4\), found \[2, 4\]"),
        ({"every": 2, "compare_at": (4,), "deform": DeformSettings()}, "deform goes without every"),
        ({"deform": DeformSettings(y=-2.5)}, "must leave every run a box: 1 . rate steps timestep is 0 of an edge"),
        ({"steps": 0}, "greater than or equal to 1"),
        ({"timestep": 0.0}, "greater than 0"),
    ],
)
def test_impossible_steps_are_refused(wrong: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        Evolve(**{"steps": 4, "timestep": 0.1, **wrong})


def test_box_shrinks_separately_before_and_after_a_stop() -> None:
    """The longer of the two runs has 3 steps: 1 - 2.5 x 0.1 x 3 = 1/4 of an edge remains."""
    assert Evolve(steps=4, timestep=0.1, stops=(Stop(at=1),), deform=DeformSettings(y=-2.5)).deform is not None


def test_deformation_rates_by_axis() -> None:
    deform = DeformSettings(x=1.0, y=2.0, z=3.0, xy=4.0, xz=5.0, yz=6.0)
    assert (deform.rates, deform.shears, deform.remap) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), "x")


def test_shift_is_on_off_or_has_arguments() -> None:
    assert RheoSettings().shifting is None and RheoSettings(shift=False).shifting is None
    assert RheoSettings(shift=True).shifting == ShiftSettings(exclude=(), scale_cross_type=None)
    assert ShiftSettings.model_validate({"exclude": 2}).exclude == ("2",)
    assert ShiftSettings.model_validate({"exclude": ["1*2", 3]}).exclude == ("1*2", "3")


@pytest.mark.parametrize(
    ("model", "arguments", "rule"),
    [
        (RheoSettings, {"self_mass": True}, "self_mass is an argument of rho_sum, which is off"),
        (RheoSettings, {"zmin": -1}, "greater than or equal to 0"),
        (RheoSettings, {"cut": 0.0}, "greater than 0"),
        (RheoSettings, {"shift": 1}, "valid boolean"),
        (RheoSettings, {"kernel": "RK3"}, "'quintic', 'RK0', 'RK1' or 'RK2'"),
        (SurfaceDetectionSettings, DETECTION | {"limit": 20.5}, "a whole number, found 20.5"),
        (SurfaceDetectionSettings, DETECTION | {"splash": 4.0}, "valid integer"),
        (PairSettings, {"rho_damp": -0.1}, "greater than or equal to 0"),
        (ForceSettings, {"style": "gravity", "vector": [None, 1.0]}, "gravity needs a number for every component"),
        (ForceSettings, {"style": "drag", "vector": [1.0]}, "'gravity', 'addforce' or 'setforce'"),
        (ExampleSettings, {}, "exactly one of rheo, pressure"),
        (ExampleSettings, {"rheo": 1, "pressure": 1}, "exactly one of rheo, pressure"),
        (ExampleSettings, {"rheo": 4}, "less than or equal to 3"),
    ],
)
def test_invalid_arguments_are_refused(model: type[SceneModel], arguments: dict[str, Any], rule: str) -> None:
    with pytest.raises(ValidationError, match=rule):
        model.model_validate(arguments)


def test_unusual_arguments_are_accepted() -> None:
    assert SurfaceDetectionSettings.model_validate(DETECTION | {"style": "divergence", "limit": 0.5}).limit == 0.5
    assert ForceSettings(style="setforce", vector=(None, 1.0)).vector == (None, 1.0)
    assert RheoSettings(rho_sum=True, self_mass=True).self_mass


def test_line_of_the_manual_is_found_by_its_location() -> None:
    for number in (1, 2, 3):
        of_rheo, of_pressure = ExampleSettings(rheo=number), ExampleSettings(pressure=number)
        assert (of_rheo.line("rheo"), of_rheo.line("pressure")) == (EXAMPLES["rheo"][number - 1], None)
        assert (of_pressure.line("rheo"), of_pressure.line("pressure")) == (None, EXAMPLES["pressure"][number - 1])
