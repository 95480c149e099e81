"""Scenes in which a finding's variant is known not to reproduce LAMMPS: a difference is reported as that limit."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from lammps_cases.records.yaml_files import yaml_text

FLUID = {"mass": 1.31, "rho0": 1.27, "cs": 6.1, "viscosity": 0.17}
WALLS: dict[str, Any] = {
    "dimension": 2,
    "types": [FLUID, {"mass": 0.62, "rho0": 0.81, "cs": 9.3, "viscosity": 0.29, "phase": "solid"}],
    "positions": {
        **{"lattice": "sq", "spacing": 0.9, "cells": [8, 8], "disorder": 0.15},
        "regions": [{"type": 1, "low": [0, 0], "high": [1, 1]}, {"type": 2, "low": [0, 0], "high": [1, 0.42]}],
    },
    "pressure": [{"types": "*", "style": "linear"}],
    "rheo": {"interface_reconstruct": True},
    "rho": {"ratio": [0.97, 1.04]},
    "velocity": {"random": 0.3},
    "evolve": {"steps": 4, "timestep": 0.004, "stops": [{"at": 1, "by": "minimize"}, {"at": 3}]},
    "compare": ["rho_wall", "grad/v", "f", "x"],
}


@pytest.mark.lammps
@pytest.mark.parametrize(("kernel", "limit"), [("RK2", ["walls-begin-with-pressure"]), ("quintic", [])])
def test_minimisation_next_to_walls(kernel: str, limit: list[str], tmp_path: Path) -> None:
    """With a kernel that corrects gradients, wall forces after it differ from those of the variant.

    Memory that LAMMPS reads uninitialised is filled with zeros, in new processes.
    """
    scene = WALLS | {"rheo": WALLS["rheo"] | {"kernel": kernel}}
    (tmp_path / "mine.yaml").write_text(yaml_text({"name": "mine", "about": "walls", "scene": scene}))
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--cases", "mine.yaml", "--out", "out"]
    zeros = {"MALLOC_PERTURB_": "255", "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
    done = subprocess.run(command, env=os.environ | zeros, cwd=tmp_path, capture_output=True, text=True, check=False)
    code, out = done.returncode, done.stdout
    run = json.loads((tmp_path / "out" / "run.json").read_text())
    (case,) = run["cases"]
    assert (case["verdict"], case["limits"], code) == ("differs" if limit else "explained", limit, int(bool(limit)))
    assert ("a known limit of walls-begin-with-pressure" in case["message"]) == bool(limit)
    assert run["triage"] is None and "no hypothesis" not in out  # the cause is known
    assert "walls-begin-with-pressure" not in case["unseen"]
