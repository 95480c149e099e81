"""Inputs that the project refuses: the list (``inputs.yaml``), and what is said here to each."""

from __future__ import annotations

import functools
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from pydantic import TypeAdapter

from eos_ref import InputError, parse_fix_rheo, parse_fix_rheo_pressure, resolve
from eos_ref.model.parameters import Box, Model, PairRheo, State, Viscosity, check_state
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.scene import atoms, casefile
from lammps_cases.setup import reference_side

Base = Literal["one", "two", "warm", "open"]
_FILE = Path(__file__).with_name("inputs.yaml")


@dataclass(frozen=True)
class BadInput:
    """An input, and how to put it to LAMMPS.

    Attributes
    ----------
    id : the name of the refusal in words joined by hyphens
    area : what the input is about
    names : the manual's words for the quantity that is wrong; a clear error has one of them, or the offending word
    edits : texts replaced in the commands of the base; each stands in exactly one of them
    promise : what LAMMPS' manual says to it, if anything
    base : the harmless scene that is changed
    scene : keys of the scene that say the same here; without them, and without a check, the fixes edited are parsed
    add : commands in front of the others, when the particles exist
    drop : per-atom arrays that are not given, ``atoms`` for all particles
    """

    id: str
    area: str
    names: tuple[str, ...]
    edits: tuple[tuple[str, str], ...] = ()
    promise: str = ""
    base: Base = "one"
    scene: dict[str, Any] | None = None
    add: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()


@functools.cache
def _data() -> dict[str, Any]:
    data: dict[str, Any] = read_yaml(_FILE, "bad inputs")
    return data


@functools.cache
def bad_inputs() -> tuple[BadInput, ...]:
    """All inputs, in the order of the list."""
    return TypeAdapter(tuple[BadInput, ...]).validate_python(_data()["inputs"])


def not_for_lammps() -> dict[str, str]:
    """Refusals of a scene that cannot be put to LAMMPS, and why."""
    return dict(_data()["not_for_lammps"])


def base_scene(base: Base) -> dict[str, Any]:
    """Keys of a harmless scene: particles of unit volume and some disorder."""
    bases = _data()["bases"]
    merged: dict[str, Any] = casefile.merge(bases["one"], bases[base])
    return merged


def load_scene(base: Base, changes: Mapping[str, Any]) -> tuple[casefile.Case, atoms.Atoms]:
    """A changed scene as ``eos-ref run`` takes it: read from a file, its particles laid, its state checked.

    Raises
    ------
    InputError
    """
    content = casefile.merge(base_scene(base), changes)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "input.yaml"
        file.write_text(yaml.safe_dump({"name": "input", "about": "An input.", "scene": content}))
        case = casefile.load_file(file)[0]
    laid = atoms.build(case, case.scene.eos())
    reference_side.state(case.scene, laid)
    return case, laid


def edited(line: str, edits: tuple[tuple[str, str], ...]) -> str:
    """A command with the texts of an input replaced."""
    for old, new in edits:
        line = line.replace(old, new)
    return line


def refusal(bad: BadInput, commands: tuple[str, ...]) -> str:
    """What is said here to an input: its rule and value, without the place; empty if nothing is.

    Parameters
    ----------
    commands : tuple of str
        Those of the base, in LAMMPS' words.
    """
    try:
        if bad.scene is not None:
            load_scene(bad.base, bad.scene)
        elif bad.id in CHECKS:
            CHECKS[bad.id]()
        else:
            parse(bad, commands)
    except InputError as error:
        return str(InputError(error.what, error.rule, error.found))
    return ""


def parse(bad: BadInput, commands: tuple[str, ...]) -> None:
    """Read the fixes of an input as the reference does.

    Raises
    ------
    InputError
    """
    ntypes = len(base_scene(bad.base)["types"])
    lines = {" ".join(line.split()[:2]): edited(line, bad.edits) for line in commands}
    fix = parse_fix_rheo(lines["fix rheo"], ntypes)
    resolve(parse_fix_rheo_pressure(lines["fix pressure"]), ntypes, fix.rho0, fix.cs)


# --- what a scene cannot say


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
