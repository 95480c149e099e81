"""Scene to LAMMPS: the commands and arrays of a job, and nothing that the plan does not name.

Numbers are written as the shortest text that reads back as the same double (`repr`).
"""

from __future__ import annotations

from collections.abc import Iterable

from lammps_cases.atoms import Atoms, kernel_cut
from lammps_cases.engine import Job
from lammps_cases.plan import Plan
from lammps_cases.scene import Scene


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def job(scene: Scene, atoms: Atoms, plan: Plan) -> Job:
    """Everything LAMMPS is told for a scene."""
    per_atom = {}
    if atoms.rho_n is not None:
        per_atom["rho"] = atoms.rho_n
    if atoms.energy_n is not None and _atom_style(scene) == "rheo/thermal":
        per_atom["esph"] = atoms.energy_n
    if scene.violate == "atom-style-atomic":
        per_atom = {}
    steps = scene.evolve.steps if scene.evolve else 0
    return Job(
        setup=tuple(_setup(scene, atoms, plan)),
        commands=tuple(_physics(scene, atoms, plan)),
        # After time steps, run 0 evaluates once more: the pressure that forces use then belongs to the final density.
        runs=(f"run {steps} post no", "run 0 post no") if steps else ("run 0 post no",),
        id_n=atoms.id_n,
        type_n=atoms.type_n,
        x_nc=atoms.x_nc,
        v_nc=atoms.v_nc,
        per_atom=per_atom,
        outputs=scene.compare,
        atom_arrays=("type", "x", "rho", "pressure", *(["esph"] if "esph" in per_atom else [])),
    )


def _atom_style(scene: Scene) -> str:
    if scene.violate == "atom-style-atomic":
        return "atomic"
    return "rheo/thermal" if scene.thermal and scene.violate != "atom-style-rheo" else "rheo"


def _setup(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    yield f"units {scene.units}"
    yield f"dimension {scene.dimension}"
    yield f"atom_style {_atom_style(scene)}"
    if not scene.engine.newton:
        yield "newton off"
    yield "boundary " + " ".join("p" if periodic else "f" for periodic in atoms.periodic)
    if plan.needs("pair rheo"):
        yield "comm_modify vel yes"
    # The default skin suits neither every unit system nor every spacing; without a pair style LAMMPS has no cutoff
    # to size its bins by and stops at a box of some 100 spacings, unless it is told.
    yield f"neighbor {0.3 * atoms.spacing!r} bin"
    if not plan.needs("pair rheo"):
        yield f"neigh_modify binsize {3.0 * atoms.spacing!r}"
    edges = zip(atoms.low_c, atoms.high_c, strict=True)
    yield "region box block " + " ".join(_numbers(pair) for pair in edges)
    yield f"create_box {len(scene.types)} box"


def _physics(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    for t, atom_type in enumerate(scene.types, 1):
        yield f"mass {t} {atom_type.mass!r}"
    cut = kernel_cut(scene, atoms.spacing)
    if plan.needs("pair rheo"):
        yield f"pair_style rheo {cut!r}"
        yield "pair_coeff * *"
    if scene.evolve:
        yield f"timestep {scene.evolve.timestep!r}"
    yield from _fixes(scene, cut, plan)
    if scene.violate != "no-fix-pressure":
        yield f"compute q all rheo/property/atom {' '.join(scene.compare)}"


def _fixes(scene: Scene, cut: float, plan: Plan) -> Iterable[str]:
    violate = scene.violate
    rheo = f"rheo {cut!r} {scene.engine.kernel} {scene.engine.zmin}"
    if plan.needs("fix rheo/thermal") or violate == "no-fix-thermal":
        rheo += " thermal"
    if scene.rho_sum:
        rheo += " rho/sum"
    if scene.rho0:
        rheo += f" density {_numbers(scene.rho0)}"
    if scene.cs:
        rheo += f" speed/sound {_numbers(scene.cs)}"
    pressure = "rheo/pressure " + " ".join(
        f"{law.types} {law.style}" + (f" {law.value!r}" if law.value is not None else "") for law in scene.pressure
    )
    if violate == "unknown-pressure-style":
        pressure = pressure.replace(scene.pressure[0].style, "taitwater", 1)
    if violate == "missing-argument":
        pressure = pressure.rsplit(" ", 1)[0]
    if violate in ("pressure-group", "rheo-group"):
        yield "group some id 1"
    rheo_fix = f"fix rheo {'some' if violate == 'rheo-group' else 'all'} {rheo}"
    pressure_fix = f"fix pressure {'some' if violate == 'pressure-group' else 'all'} {pressure}"
    if violate == "pressure-before-rheo":
        yield pressure_fix
    if violate != "no-fix-rheo":
        yield rheo_fix
    if violate == "rheo-twice":
        yield rheo_fix.replace("fix rheo", "fix rheo2", 1)
    if violate != "no-fix-viscosity":
        yield f"fix viscosity all rheo/viscosity * constant {scene.engine.viscosity!r}"
    if violate not in ("no-fix-pressure", "no-fix-pressure-read", "pressure-before-rheo"):
        yield pressure_fix
    if violate == "pressure-twice":
        yield pressure_fix.replace("fix pressure", "fix pressure2", 1)
    if plan.needs("fix rheo/thermal") and violate != "no-fix-thermal":
        yield "fix thermal all rheo/thermal conductivity * constant 0.1 specific/heat * constant 1.0"
    if plan.needs("fix enforce2d"):
        yield "fix flat all enforce2d"
