"""A cell as a LAMMPS input deck of its own, which needs nothing but LAMMPS.

Numbers are written as the shortest text that reads back as the same double (`repr`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from eos_ref import InputError
from eos_ref.eos.table import FloatArray
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.setup.commands import job
from lammps_cases.setup.plan import plan
from lammps_cases.studies.flows.flow import Start

# Keyword of LAMMPS' command set for each per-atom array of a job.
_SET = {"rho": "rheo/rho", "esph": "sph/e"}


def deck(start: Start, note: Sequence[str] = (), every: int = 10) -> str:
    """Return the deck that runs what the engine runs for a start, bit for bit, with thermo output and a dump.

    Parameters
    ----------
    note : sequence of str
        Comments at the top.
    every : int
        Steps between two lines of thermo output, and two frames of the dump.

    Raises
    ------
    InputError
        A start that no deck can express: ids other than 1 to N, or a number that is not finite.
    """
    deck_job = job(start.case.scene, start.atoms, plan(start.case.scene))
    _check(deck_job)
    lines = [
        *(f"# {_plain(line)}" for line in note),
        *deck_job.setup,
        "",
        *_atoms(deck_job),
        "",
        *deck_job.commands,
        "",
        *_output(deck_job, every),
        "",
        *(stretch.command for stretch in deck_job.runs if isinstance(stretch, RunCommand)),
    ]
    return "\n".join(lines) + "\n"


def _plain(line: str) -> str:
    # LAMMPS joins a line that ends with & to the next one, in comments too, and to those within """.
    return " ".join(line.split()).translate({ord(c): None for c in '&"'}).encode("ascii", "replace").decode()


def _check(deck_job: Job) -> None:
    if not np.array_equal(deck_job.id_n, np.arange(1, len(deck_job.id_n) + 1)):
        raise InputError(
            "ids", "must be 1 to N in a deck: LAMMPS numbers the atoms that it creates", int(deck_job.id_n[0])
        )
    for name, values in {"x": deck_job.x_nc, "v": deck_job.v_nc, **deck_job.per_atom}.items():
        if values is not None and not np.isfinite(values).all():
            raise InputError(name, "must be finite in a deck: LAMMPS reads no other number", "inf or nan")


def _atoms(deck_job: Job) -> Iterable[str]:
    """Yield atoms in the order of their ids, and their properties; those that all share are set once."""
    for t, (x, y, z) in zip(deck_job.type_n.tolist(), deck_job.x_nc.tolist(), strict=True):
        # With remap an atom on the upper face of a periodic box is not left out.
        yield f"create_atoms {t} single {x!r} {y!r} {z!r} remap yes"
    given: dict[str, FloatArray] = {}
    if deck_job.v_nc is not None:
        given |= {f"v{axis}": deck_job.v_nc[:, k] for k, axis in enumerate("xyz")}
    given |= {_SET[name]: np.asarray(values_n, float) for name, values_n in deck_job.per_atom.items()}
    # A zero with a sign is set atom by atom.
    shared = {
        name
        for name, values_n in given.items()
        if np.unique(values_n).size == 1 and not (np.signbit(values_n) & (values_n == 0.0)).any()
    }
    for name in sorted(shared):
        if given[name][0] != 0.0 or not name.startswith("v"):
            yield f"set group all {name} {float(given[name][0])!r}"
    own = {name: values_n.tolist() for name, values_n in given.items() if name not in shared}
    for k in range(len(deck_job.id_n) if own else 0):
        yield f"set atom {k + 1} " + " ".join(f"{name} {values[k]!r}" for name, values in own.items())


def _output(deck_job: Job, every: int) -> Iterable[str]:
    """Yield thermo output and a dump: positions, velocities, density, what compute q of the job gives."""
    yield f"thermo {every}"
    yield "thermo_style custom step atoms ke"
    columns = ["id", "type", "x", "y", "z", "vx", "vy", "vz"]
    names: dict[str, str] = {}
    if "rho" in deck_job.atom_arrays and "rho" not in deck_job.outputs:
        yield "compute density all rheo/property/atom rho"
        names["c_density"] = "rho"
    single = sum(math.prod(shape) for shape in deck_job.outputs.values()) == 1
    place = 0
    for name, shape in deck_job.outputs.items():
        for k in range(math.prod(shape)):
            place += 1
            label = name if math.prod(shape) == 1 else f"{name}[{k + 1}]"
            names["c_q" if single else f"c_q[{place}]"] = label
    yield f"dump frames all custom {every} frames.dump {' '.join([*columns, *names])}"
    # As many digits as make a double.
    yield "dump_modify frames sort id format float %.17g " + " ".join(
        f"colname {column} {label}" for column, label in names.items()
    )
