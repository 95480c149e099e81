r"""The benchmarks of the paper behind RHEO: what their flows share, and what is published about them.

Palermo, Wolf, Clemmer & O'Connor, Phys. Fluids 36, 113337 (2024). The numbers called published are those of the
authors' repository of benchmarks (github.com/EricPalermo/rheo_benchmarks, May 2023), for a package before its release.

Lengths of the paper are L = 10; here the spacing is 1 and N the number of particles along L, unless a benchmark says
otherwise. Velocities and densities are the paper's, so that times grow with N as lengths do.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.kernels.styles import KernelStyle
from lammps_cases.records.files import DATA
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.flows.flow import Options

LENGTH = 10.0  # L
SOURCE = "Palermo et al., Phys. Fluids 36, 113337 (2024); data of the authors' repository, 2023"
NAMES: dict[KernelStyle, str] = {
    "quintic": "Quintic",
    "RK0": "RK0",
    "RK1": "RK1",
    "RK2": "RK2",
}  # of the data's columns
ORDINARY = (20, 40, 50)  # of the paper's resolutions, in every run; the finer ones with --full
FINE = (100, 200)
DISORDER = 0.1  # spacings


@cache
def rows_of(name: str) -> tuple[Mapping[str, str], ...]:
    """Return the lines of ``data/flows/paper/NAME.csv``."""
    lines = (DATA / "flows" / "paper" / f"{name}.csv").read_text(encoding="utf-8").splitlines()
    return tuple(csv.DictReader(line for line in lines if not line.startswith("#")))


def errors_of(benchmark: str, kernel: KernelStyle, variant: str, length: float = LENGTH) -> dict[int, float]:
    """Return the published errors of a benchmark by N."""
    return {
        round(length / float(row["spacing"])): float(row["error"])
        for row in rows_of("errors_per_resolution")
        if (row["benchmark"], row["kernel"], row["variant"]) == (benchmark, NAMES[kernel], variant)
    }


def points_of(name: str, x: str, y: str, **of: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return two columns of the lines with some words, in the order of x."""
    chosen = [row for row in rows_of(name) if all(row[key] == word for key, word in of.items())]
    pairs = sorted((float(row[x]), float(row[y])) for row in chosen)
    return tuple(pair[0] for pair in pairs), tuple(pair[1] for pair in pairs)


def lattice(*axes: Any) -> FloatArray:
    """Return the points of a lattice from the coordinates along each axis, the first one running fastest."""
    mesh = np.meshgrid(*axes[::-1], indexing="ij")
    return np.stack([part.ravel() for part in mesh[::-1]], axis=1).astype(float)


def disordered(x_nc: FloatArray, name: str, moved_n: Any = None) -> FloatArray:
    """Return positions displaced along every axis by up to a tenth of a spacing, those of ``moved_n`` or all."""
    by_nc = np.random.default_rng(seed(name)).uniform(-DISORDER, DISORDER, x_nc.shape)
    return x_nc + (by_nc if moved_n is None else np.where(moved_n[:, None], by_nc, 0.0))


def pair_terms(options: Options, sound: float, damping: float = 0.1) -> dict[str, Any]:
    """Return the paper's pair terms: artificial viscosity 1, density damping over cutoff and sound speed."""
    return {"artificial_visc": 1.0, "rho_damp": damping * options.cut * sound}


def step_length(options: Options, sound: float) -> float:
    """Return the paper's time step, 0.1 h / 3 c with h the cutoff."""
    return 0.1 * options.cut / (3 * sound)
