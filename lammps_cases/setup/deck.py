"""A job as LAMMPS' own files: commands, and a data file whose numbers read back as the same doubles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from lammps_cases.engine.session import Job


def until_first_run(job: Job, data: str, single: int = 0) -> tuple[list[str], str]:
    """Return a job's commands up to the first run, and the content of its data file.

    Parameters
    ----------
    data : str
        Name of the data file.
    single : int
        Particles, at most, that are created one by one; the data file is then empty.
    """
    (style,) = (line.split()[1] for line in job.setup if line.startswith("atom_style"))
    lines = [*job.setup]
    lines.insert(next(k for k, line in enumerate(lines) if line.startswith("region box")), "atom_modify map yes")
    if len(job.id_n) <= single:
        return [*lines, *_single(job, style), *job.commands], ""
    kept = [line for line in lines if not line.startswith(("region box", "create_box"))]
    return [*kept, f"read_data {data}", *_masses(job), *job.commands], data_file(job)


def _single(job: Job, style: str) -> Iterable[str]:
    """Yield the commands that create particles one by one; their ids follow from the order."""
    place_n = np.argsort(job.id_n)
    for n in place_n:
        x = " ".join(repr(float(x)) for x in job.x_nc[n])
        yield f"create_atoms {job.type_n[n]} single {x} units box"
    every = {}
    for n in place_n:
        named = (*_SET[style], ("rmass", "mass"))
        words = [f"{name} {float(job.per_atom[key][n])!r}" for key, name in named if key in job.per_atom]
        if job.v_nc is not None:
            words += [f"{name} {float(v)!r}" for name, v in zip(("vx", "vy", "vz"), job.v_nc[n], strict=True) if v]
        every[job.id_n[n]] = " ".join(words)
    same = len(set(every.values())) == 1
    for atom, given in {"all": next(iter(every.values()))}.items() if same else every.items():
        if given:
            yield f"set {'group' if same else 'atom'} {atom} {given}"


_SET = {"atomic": (), "rheo": (("rho", "rheo/rho"),), "rheo/thermal": (("rho", "rheo/rho"), ("esph", "sph/e"))}


def _masses(job: Job) -> Iterable[str]:
    """Yield the commands that give particles individual masses, which data files of their atom styles lack."""
    for atom, mass in zip(job.id_n, job.per_atom.get("rmass", ()), strict=False):
        yield f"set atom {atom} mass {float(mass)!r}"


def data_file(job: Job, mass_t: Sequence[float] = (), solid_n: Sequence[int] = ()) -> str:
    """Return the data file: masses of types, if they are given, atoms, with their status (0, fluid), and velocities."""
    (style,) = (line.split()[1] for line in job.setup if line.startswith("atom_style"))
    (box,) = (line.split()[3:] for line in job.setup if line.startswith("region box"))
    (types,) = (line.split()[1] for line in job.setup if line.startswith("create_box"))
    lines = ["particles of the deck", "", f"{len(job.id_n)} atoms", f"{types} atom types", ""]
    lines += [f"{box[2 * a]} {box[2 * a + 1]} {axis}lo {axis}hi" for a, axis in enumerate("xyz")]
    if len(box) == 9:
        lines.append(f"{' '.join(box[6:])} xy xz yz")
    if mass_t:
        lines += ["", "Masses", "", *(f"{t} {mass!r}" for t, mass in enumerate(mass_t, 1))]
    lines += ["", f"Atoms # {style}", ""]
    zeros = np.zeros(len(job.id_n))
    for n, x_c in enumerate(job.x_nc):
        values = [*(job.per_atom.get(key, zeros)[n] for key, _ in _SET[style]), *x_c]
        status = [str(solid_n[n] if solid_n else 0)] * (style != "atomic")
        lines.append(" ".join([f"{job.id_n[n]} {job.type_n[n]}", *status, *(repr(float(v)) for v in values)]))
    if job.v_nc is not None:
        lines += ["", "Velocities", ""]
        lines += [" ".join([str(i), *(repr(float(v)) for v in v_c)]) for i, v_c in zip(job.id_n, job.v_nc, strict=True)]
    return "\n".join(lines) + "\n"
