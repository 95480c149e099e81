"""Times of PySPH's own Taylor-Green example: weakly compressible SPH, quintic spline, one core.

``PYTHON lammps_cases/studies/chart/peers/pysph_taylor_green.py NX STEPS`` runs under a Python that has PySPH
(pip install pysph; it compiles its equations with the system's compiler) and needs nothing of this package. The last
line that it prints is one JSON document: particles and seconds per step.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time


def main(nx: int, steps: int) -> None:
    """Time steps of the example; the first ones warm up."""
    from pysph.examples.taylor_green import TaylorGreen

    seconds: list[float] = []

    class Timed(TaylorGreen):  # type: ignore[misc]
        def pre_step(self, solver: object) -> None:
            seconds.append(time.perf_counter())

    warm = 3
    with tempfile.TemporaryDirectory() as folder:
        example = Timed(fname=f"{folder}/taylor_green")
        arguments = ["--nx", str(nx), "--perturb", "0.1", "--scheme", "wcsph", "--no-openmp", "--pfreq", "1000000"]
        example.run([*arguments, "--max-steps", str(warm + steps + 1), "--directory", folder, "--disable-output"])
        particles = sum(array.get_number_of_particles(real=True) for array in example.particles)
    per_step = [after - before for before, after in zip(seconds[warm:], seconds[warm + 1 :], strict=False)]
    print(json.dumps({"particles": particles, "seconds": per_step}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
