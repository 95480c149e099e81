"""Error messages of this project for inputs that it refuses."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from eos_ref import InputError, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State, check_state
from lammps_cases.claims.probes.probe import Probe, commands, load_scene


def refusal(bad: Probe, scene: Mapping[str, Any] | None) -> str:
    """Return the rule that refuses an input, and its value, without the place; empty if nothing does.

    Parameters
    ----------
    scene : mapping, optional
        Keys of the equivalent scene; without them, and without a check, the fixes are parsed.
    """
    try:
        if scene is not None:
            load_scene(bad.base, scene)
        elif bad.id in CHECKS:
            CHECKS[bad.id]()
        else:
            parse(bad)
    except InputError as error:
        return str(InputError(error.what, error.rule, error.found))
    return ""


def parse(bad: Probe) -> None:
    """Read the fixes of an input as the reference does.

    Raises
    ------
    InputError
    """
    lines = {" ".join(line.split()[:2]): line for line in commands(bad.input)}
    ntypes = sum(name.startswith("mass") for name in lines)
    fix = parse_fix_rheo(lines["fix rheo"], ntypes)
    resolve(parse_fix_rheo_pressure(lines["fix pressure"]), ntypes, fix.rho0, fix.cs)


# --- inputs that no scene can express


def _model(types: int = 1, viscosities: int | None = None, thermal: bool = False) -> Model:
    fix = parse_fix_rheo("fix rheo all rheo 3.0 quintic 0" + " thermal" * thermal)
    law = resolve(parse_fix_rheo_pressure("fix pressure all rheo/pressure * linear"), types)
    viscosity = Viscosity("constant", 0.1)
    return Model(2, fix, (1.2,) * types, law, PairRheo(3.0), (viscosity,) * (viscosities or types))


def _state(**first: tuple[float, float]) -> None:
    """Check two particles of which the first has other values."""
    state = State(np.array([[1.0, 1.0], [3.0, 3.0]]), np.zeros((2, 2)), np.ones(2), np.ones(2, int), np.zeros(2, bool))
    for name, value in first.items():
        getattr(state, name)[0] = value
    check_state(_model(), Box((0.0, 0.0), (8.0, 8.0), (False, True)), state)


CHECKS: dict[str, Callable[[], object]] = {
    "thermal-without-fix-thermal": lambda: _model(thermal=True),
    "viscosity-of-unknown-style": lambda: Viscosity("newtonian", 0.1),  # type: ignore[arg-type]
    "viscosity-of-one-type-of-two": lambda: _model(types=2, viscosities=1),
    "artificial-viscosity-nan": lambda: PairRheo(3.0, math.nan),
    "rho-damp-infinite": lambda: PairRheo(3.0, 0.0, math.inf),
    "position-nan": lambda: _state(x_nc=(math.nan, 1.0)),
    "outside-of-an-open-box": lambda: _state(x_nc=(-5.0, 1.0)),
    "particles-on-one-spot": lambda: _state(x_nc=(3.0, 3.0)),
    "velocity-nan": lambda: _state(v_nc=(math.nan, 0.0)),
    "region-inside-out": lambda: Box((8.0, 0.0), (0.0, 8.0), (True, True)),
    "box-infinite": lambda: Box((0.0, 0.0), (math.inf, 8.0), (True, True)),
}
