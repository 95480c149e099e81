"""The pictures of flows in docs/gallery.md and docs/index.md: ``python -m tests.workshop.pictures [NAME...]``."""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from lammps_cases.engine import apart, installations
from lammps_cases.engine.session import open_lammps

ROOT = Path(__file__).parents[2]
DECKS = ROOT / "docs" / "decks"
# picture: its panels, each with deck, colour, label, engine, steps
OLDER = "pypi:2025.7.22.1.0"
FLOWS = {
    "tank": [("in.tank", "pressure", "Pa", "env", 3), ("in.tank", "pressure", "Pa", OLDER, 2000)],
    "dam": [("in.dam", "speed", "", "env", 4000)],
    "vortices": [("in.taylor_green", "speed", "", "env", 1000)],
    "channel": [("in.channel", "speed", "", "env", 3000)],
    "couette": [("in.couette", "speed", "", "env", 3000)],
    "heat": [("in.heat", "temperature", "", "env", 500)],
}


def particles(deck: str, what: str, engine: str, steps: int) -> Any:
    """Return positions, types and the values of a field after so many steps of a deck."""
    lammps = open_lammps(installations.resolve(engine).site)
    field = "" if what == "speed" else f"compute picture all rheo/property/atom {what}\n"
    before, _, _ = (DECKS / deck).read_text(encoding="utf-8").rpartition("\nrun ")
    lammps.commands_string(f"{before}\n{field}thermo_modify lost ignore\nrun {steps}\n")
    own = slice(lammps.extract_global("nlocal"))  # behind them are periodic images
    x, v, kind = (lammps.numpy.extract_atom(name)[own].copy() for name in ("x", "v", "type"))
    speed = np.linalg.norm(v, axis=1)
    return x, kind, speed if what == "speed" else lammps.numpy.extract_compute("picture", 1, 1)[own].copy()


def draw(name: str, folder: Path) -> None:
    """Draw particles coloured by a field; walls are grey."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from PIL import Image

    found = [apart.call(particles, *panel[:2], *panel[3:], time_limit=1800) for panel in FLOWS[name]]
    x, _, value = found[-1]  # of all panels: the same axes and colours
    width, height = np.ptp(x[:, 0]), np.ptp(x[:, 1])
    side = 250 * max(width, height) ** -1 * np.sqrt(width * height / len(x))  # of a particle, in points
    size = (4 * len(found), 0.4 + 3.6 * min(1.0, height / width + 0.1))
    figure, panels = pyplot.subplots(1, len(found), squeeze=False, figsize=size, dpi=90, layout="constrained")
    for axes, (x_nc, kind, value_n), panel in zip(panels[0], found, FLOWS[name], strict=True):
        _, what, unit, engine, steps = panel
        fluid = kind == 1
        axes.scatter(*x_nc[~fluid, :2].T, s=0.7 * side**2, c="0.6", linewidths=0)
        shown = axes.scatter(*x_nc[fluid, :2].T, s=0.7 * side**2, c=value_n[fluid], linewidths=0)
        shown.set_clim(0, value[found[-1][1] == 1].max())
        axes.set(aspect="equal", xlim=(x[:, 0].min(), x[:, 0].max()), ylim=(x[:, 1].min(), x[:, 1].max()))
        axes.set_title(f"LAMMPS {_version(engine)}, step {steps}" if len(found) > 1 else "", fontsize=10)
        figure.colorbar(shown, label=f"{what} ({unit})" if unit else what, shrink=0.8)
    path = folder / f"flow-{name}.png"
    figure.savefig(path)
    pyplot.close(figure)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)


def _version(engine: str) -> str:
    return version("lammps") if engine == "env" else engine.removeprefix("pypi:")


if __name__ == "__main__":
    for each in sys.argv[1:] or FLOWS:
        draw(each, ROOT / "reports")
