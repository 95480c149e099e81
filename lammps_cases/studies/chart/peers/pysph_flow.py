"""One of PySPH's own examples, run to the end: its fluid particles at some times, and the seconds of one core.

``PYTHON lammps_cases/studies/chart/peers/pysph_flow.py EXAMPLE SCHEME N TIME...`` runs under a Python that has
PySPH (pip install pysph) and needs nothing of this package. Options except the resolution are the example's own. The
last line that it prints is one JSON document: particles, steps, seconds of processor time that the steps took, and for
every time the fluid's x, y, u, v. Lengths are in units of the edge of the box, the height of the column or the diameter
of the drop, speeds in those of the fastest vortex, of the lid, of the root of gravity times height, or of the diameter
times the rate of strain.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from typing import Any, NamedTuple

TANK = 2.75, 1.2  # length and height of the tank over the height of the column
LAYERS = 4  # of the tank's walls, as in the example


class PeerFlow(NamedTuple):
    """An application, its options, its units of length and speed, and its origin in its own lengths."""

    app: Any
    options: list[str]
    edge: float
    speed: float
    origin: float = 0.0


def taylor_green(n: int) -> PeerFlow:
    """Return vortices at Re 100, on a disordered lattice; u = sin(kx) cos(ky) from a quarter of the edge on."""
    from pysph.examples.taylor_green import TaylorGreen

    return PeerFlow(TaylorGreen(), ["--nx", str(n), "--perturb", "0.2"], 1.0, 1.0, 0.25)


def cavity(n: int) -> PeerFlow:
    """Return a cavity at Re 100."""
    from pysph.examples.cavity import LidDrivenCavity

    return PeerFlow(LidDrivenCavity(), ["--nx", str(n)], 1.0, 1.0)


def dam_break(n: int) -> PeerFlow:
    """Return a column n particles high.

    The example gives particles the mass and smoothing length of its own spacing whatever ``--dx``, its column has
    a surplus row, and its tank is shorter than the experiment's: here particles are laid, each in its own cell.
    """
    import numpy as np
    from pysph.base.utils import get_particle_array
    from pysph.examples import dam_break_2d as dam

    class DryBed(dam.DamBreak2D):  # type: ignore[misc]
        def create_particles(self) -> list[Any]:
            length, height = (round(size * n) for size in TANK)
            i, j = (k.ravel() for k in np.mgrid[-LAYERS : length + LAYERS, -LAYERS:height])
            wall = (i < 0) | (i >= length) | (j < 0)
            wet = ~wall & (i < round(n * dam.fluid_column_width / dam.fluid_column_height)) & (j < n)
            same = {"h": self.h, "m": self.dx**2 * dam.ro, "rho": dam.ro}
            arrays = [
                get_particle_array(name=name, x=(i[chosen] + 0.5) * self.dx, y=(j[chosen] + 0.5) * self.dx, **same)
                for name, chosen in (("fluid", wet), ("boundary", wall))
            ]
            self.scheme.setup_properties(arrays)
            return arrays

    height = dam.fluid_column_height
    return PeerFlow(DryBed(), ["--dx", repr(height / n)], height, (dam.g * height) ** 0.5)


def elliptical_drop(n: int) -> PeerFlow:
    """Return a drop n spacings across, stretched along x; the example's is stretched along y, on another lattice."""
    import numpy as np
    from pysph.base.utils import get_particle_array
    from pysph.examples.elliptical_drop import EllipticalDrop

    rate, half = 100.0, n // 2 + 1

    class Turned(EllipticalDrop):  # type: ignore[misc]
        def create_particles(self) -> list[Any]:
            j, i = (k.ravel() + 0.5 for k in np.mgrid[-half:half, -half:half])
            wet = i**2 + j**2 < n**2 / 4
            x, y = i[wet] * self.dx, j[wet] * self.dx
            same = {"h": self.hdx * self.dx, "m": self.dx**2 * self.ro, "rho": self.ro}
            array = get_particle_array(name="fluid", x=x, y=y, u=rate * x, v=-rate * y, **same)
            self.scheme.setup_properties([array])
            return [array]

    return PeerFlow(Turned(), ["--nx", str(n // 2)], 2.0, 2 * rate)


def main(example: PeerFlow, scheme: str, times: list[float]) -> None:
    """Run an example to the last of some times."""
    from pysph.solver.utils import load

    app, options, edge, speed, origin = example
    times = [t * edge / speed for t in times]
    with tempfile.TemporaryDirectory() as folder:
        run = f"--scheme {scheme} --no-openmp --tf {times[-1]!r} --pfreq 1000000000 --directory".split()
        app.setup([*options, *run, folder])
        app.solver.set_output_at_times(times)
        begin = time.process_time()
        app.solve()
        seconds = time.process_time() - begin
        read = [(data["solver_data"]["t"], data["arrays"]["fluid"]) for data in map(load, app.output_files)]
    shots = []
    for wanted in times:
        t, fluid = min(read, key=lambda one: abs(one[0] - wanted))
        x, y, u, v = fluid.get("x", "y", "u", "v")
        arrays = {"x": (x - origin) / edge, "y": (y - origin) / edge, "u": u / speed, "v": v / speed}
        shots.append({"time": t * speed / edge, **{name: array.tolist() for name, array in arrays.items()}})
    particles = sum(array.get_number_of_particles(real=True) for array in app.particles)
    print(json.dumps({"particles": particles, "steps": app.solver.count, "seconds": seconds, "shots": shots}))


EXAMPLES = {
    "taylor_green": taylor_green,
    "cavity": cavity,
    "dam_break_2d": dam_break,
    "elliptical_drop": elliptical_drop,
}

if __name__ == "__main__":
    main(EXAMPLES[sys.argv[1]](int(sys.argv[3])), sys.argv[2], [float(t) for t in sys.argv[4:]])
