"""Scene to LAMMPS: the commands and arrays of a job, only those that the plan names.

Numbers are written as the shortest text that reads back as the same double (`repr`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence

from eos_ref.syntax.ranges import type_range
from lammps_cases.engine.interlude import Interlude
from lammps_cases.engine.reading import Compute
from lammps_cases.engine.session import Job, RunCommand
from lammps_cases.scene import ForceSettings, PowerLaw, Scene
from lammps_cases.scene.atoms import Atoms, kernel_cut
from lammps_cases.scene.fields import FIELDS, Field
from lammps_cases.scene.manual import with_broken_rule
from lammps_cases.scene.runs import Stop
from lammps_cases.scene.settings import Evolve, ShiftSettings, SurfaceDetectionSettings
from lammps_cases.setup.plan import Plan
from lammps_cases.setup.stops import Lines, interlude

ALWAYS_READ = ("type", "x", "v", "rho", "pressure")  # arrays of atoms
ARRAYS_OF = {"atomic": (), "rheo": ("rho",), "rheo/thermal": ("rho", "esph")}  # given ones, by atom style


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def job(scene: Scene, atoms: Atoms, plan: Plan, every_step: bool = False, lists: bool = False) -> Job:
    """Return the job of a scene: all commands and arrays for LAMMPS.

    Parameters
    ----------
    every_step : bool
        Read all arrays after the set-up and after every single step, not only at the steps compared.
    lists : bool
        Read the list of neighbours with them.
    """
    setup = with_broken_rule(_setup(scene, atoms, plan), scene.violate)
    (style,) = (line.split()[1] for line in setup if line.startswith("atom_style"))
    given = {"rho": atoms.rho_n, "esph": atoms.energy_n}
    per_atom = {name: given_n for name in ARRAYS_OF[style] if (given_n := given[name]) is not None}
    if scene.mass:
        per_atom["rmass"] = atoms.mass_n
    return Job(
        setup=setup,
        commands=with_broken_rule(_physics(scene, atoms, plan), scene.violate),
        runs=tuple(_runs(scene, every_step, lambda stop: _interlude(stop, scene, atoms, plan))),
        id_n=atoms.id_n,
        type_n=atoms.type_n,
        x_nc=atoms.x_nc,
        v_nc=atoms.v_nc,
        per_atom=per_atom,
        outputs={field.name: field.shape(scene.dimension) for field in _columns(scene)},
        atom_arrays=(*ALWAYS_READ, *_more_arrays(scene), *(["esph"] if "esph" in per_atom else [])),
        computes=tuple(Compute(f.compute_id, f.quantity.rank == 2, f.overall) for f in _computed(scene)),
        ranks=scene.engine.ranks,
        lists=lists,
    )


def _columns(scene: Scene) -> list[Field]:
    """Return the compared fields that the compute has."""
    return [FIELDS[name] for name in scene.compare if FIELDS[name].column]


def _more_arrays(scene: Scene) -> Iterable[str]:
    """Return the arrays of atoms that are compared, without those always read."""
    fields = (FIELDS[name] for name in scene.compare)
    return (field.array for field in fields if field.array and not field.column and field.array not in ALWAYS_READ)


def _computed(scene: Scene) -> list[Field]:
    """Return the compared fields with separate computes."""
    return [FIELDS[name] for name in scene.compare if FIELDS[name].compute]


def _runs(scene: Scene, every_step: bool, between: Callable[[Stop], Interlude]) -> Iterable[RunCommand | Interlude]:
    if not scene.whole_model:
        steps = scene.evolve.steps if scene.evolve else 0
        if steps:
            yield RunCommand(f"run {steps} post no", read=False)
        # After time steps, run 0 evaluates once more: the pressure that forces use then belongs to the final density.
        yield RunCommand("run 0 post no")
        return
    evolve = scene.evolve
    every = f" every {evolve.every} NULL" if evolve and evolve.every and not every_step else ""
    stops = {stop.at: stop for stop in (evolve.stops if every else evolve.beginnings)} if evolve else {}
    done, read = None, range(scene.snapshots[-1] + 1) if every_step else scene.snapshots
    for step in sorted({*read, *stops}):
        # Without pre no a run begins with an extra evaluation, which a continued run does not have.
        again = "" if done is None or every else "pre no "
        ends = _ends(evolve, done)
        yield RunCommand(f"run {step - (done or 0)} {again}post no{ends}{every}", step in read and step not in stops)
        if step in stops:
            yield between(stops[step])
            if not every or step == scene.snapshots[-1]:  # else only the next run has a set-up
                again = "pre no " * (stops[step].by == "continued")
                yield RunCommand(f"run 0 {again}post no{_ends(evolve, step)}", step in read)
        done = step


def _ends(evolve: Evolve | None, step: int | None) -> str:
    """Return the words that give the pieces of a run its beginning and end, between which fix deform interpolates.

    Of the run that has, or begins with, a step, None: of the first, before a stop at step 0 sets LAMMPS' count; a run
    that has no step moves nothing.
    """
    if not (evolve and evolve.deform):
        return ""
    begin = max((stop.at for stop in evolve.stops if stop.at <= (step or 0)), default=0)
    end = min((stop.at for stop in evolve.stops if stop.at > (step or 0)), default=evolve.steps)
    (start,) = (0,) if step is None else evolve.counted((begin,))
    return f" start {start} stop {start + end - begin}"


def _interlude(stop: Stop, scene: Scene, atoms: Atoms, plan: Plan) -> Interlude:
    model = (*_tiles(scene), *_model(scene, atoms, plan))
    neighbours = (*_neighbours(scene, atoms, plan), *_masses(scene))
    lines = Lines(tuple(_style(scene, atoms)), neighbours, model)
    return interlude(stop, scene, lines, atoms)


def _setup(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    yield from _style(scene, atoms)
    yield from _neighbours(scene, atoms, plan)
    edges = " ".join(_numbers(pair) for pair in zip(atoms.low_c, atoms.high_c, strict=True))
    yield f"region box prism {edges} {_numbers(atoms.tilt)}" if _leans(scene, atoms) else f"region box block {edges}"
    yield f"create_box {len(scene.types)} box"
    yield from _tiles(scene)
    yield from _masses(scene)


def _tiles(scene: Scene) -> Iterable[str]:
    """Yield the style of communication, which needs a box."""
    if scene.engine.communication == "tiled":
        yield "comm_style tiled"


def _leans(scene: Scene, atoms: Atoms) -> bool:
    """Return whether the edges of the box lean, at first or later."""
    deform = scene.evolve and scene.evolve.deform
    return any(atoms.tilt) or bool(deform and any(deform.shears))


def _masses(scene: Scene) -> Iterable[str]:
    """Yield the fix that keeps a mass for every particle; without ``ghost yes`` periodic images would have none."""
    if scene.mass:
        yield "fix masses all property/atom rmass ghost yes"


def _style(scene: Scene, atoms: Atoms) -> Iterable[str]:
    yield f"units {scene.units}"
    yield f"dimension {scene.dimension}"
    yield f"atom_style {'rheo/thermal' if scene.thermal else 'rheo'}"
    if not all(scene.engine.newton_flags):
        yield "newton " + " ".join("on" if flag else "off" for flag in scene.engine.newton_flags)
    yield "boundary " + " ".join("p" if periodic else scene.engine.boundary for periodic in atoms.periodic)
    if _leans(scene, atoms):
        yield "box tilt large"
    if scene.engine.processors:
        yield f"processors {' '.join(map(str, scene.engine.processors))}"
    if scene.engine.sort is not None:
        yield f"atom_modify sort {scene.engine.sort} 0.0"


def _neighbours(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    if plan.needs("pair rheo"):
        ghosts = scene.engine.ghosts
        yield "comm_modify vel yes" + (f" cutoff {ghosts * atoms.spacing!r}" if ghosts else "")
    # The default skin suits neither every unit system nor every spacing; without a pair style LAMMPS has no cutoff
    # for the size of its bins and stops at a box of some 100 spacings, unless the size is given.
    yield f"neighbor {scene.engine.skin * atoms.spacing!r} {scene.engine.search}"
    if (scene.engine.every, scene.engine.delay, scene.engine.check) != (1, 0, True):
        check = "yes" if scene.engine.check else "no"
        yield f"neigh_modify every {scene.engine.every} delay {scene.engine.delay} check {check}"
    if not plan.needs("pair rheo"):
        yield f"neigh_modify binsize {3.0 * atoms.spacing!r}"


def _physics(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    for t, atom_type in enumerate(scene.types, 1):
        yield f"mass {t} {atom_type.mass!r}"
    solid = [t for t, atom_type in enumerate(scene.types, 1) if atom_type.phase == "solid"]
    for t in solid:
        yield f"set type {t} rheo/status 1"
    yield from _model(scene, atoms, plan)


def _model(scene: Scene, atoms: Atoms, plan: Plan) -> Iterable[str]:
    cut = kernel_cut(scene, atoms.spacing)
    if plan.needs("pair rheo"):
        yield f"pair_style rheo {cut!r}{_pair_arguments(scene)}"
        yield "pair_coeff * *"
    if scene.evolve:
        yield f"timestep {scene.evolve.timestep!r}"
    yield from _fixes(scene, cut, plan)
    if columns := _columns(scene):
        yield f"compute q all rheo/property/atom {' '.join(field.words() for field in columns)}"
    yield from _virials(_computed(scene))
    yield from _balance(scene)


def _balance(scene: Scene) -> Iterable[str]:
    """Yield the commands that deal particles out to processes, before the first step and after every few."""
    if scene.engine.balance is None:
        return
    yield "balance 1.0 rcb"
    yield f"fix balance all balance {scene.engine.balance} 1.0 rcb"


def _virials(fields: Sequence[Field]) -> Iterable[str]:
    """Yield the computes of virials, and a thermo output of them: LAMMPS sums virials only in steps with one."""
    words = []
    for field in fields:
        yield f"compute {field.compute_id} all {field.compute}"
        shown = f"c_{field.compute_id}" + "[1]" * (field.quantity.rank > 0)
        if not field.overall:
            yield f"compute {field.compute_id}_sum all reduce sum {shown}"
            shown = f"c_{field.compute_id}_sum"
        words.append(shown)
    if words:
        yield f"thermo_style custom step {' '.join(words)}"


def _pair_arguments(scene: Scene) -> str:
    pair = scene.pair
    words = ""
    if pair.artificial_visc:
        words += f" artificial/visc {pair.artificial_visc!r}"
    if pair.rho_damp:
        words += f" rho/damp {pair.rho_damp!r}"
    return words + " harmonic/means" * pair.harmonic_means


def _rheo(scene: Scene, cut: float, thermal: bool) -> str:
    """Return the arguments of fix rheo with its keywords, in the order of the manual."""
    rheo = scene.rheo
    words = (
        f"rheo {cut!r} {rheo.kernel} {rheo.zmin}",
        "thermal" * thermal,
        "interface/reconstruct" * rheo.interface_reconstruct,
        _surface_detection(rheo.surface_detection),
        _shift(rheo.shifting),
        ("rho/sum" + " self/mass" * rheo.self_mass) * rheo.rho_sum,
        f"density {_numbers(scene.rho0)}" if scene.rho0 else "",
        f"speed/sound {_numbers(scene.cs)}" if scene.cs else "",
    )
    return " ".join(filter(None, words))


def _surface_detection(surface: SurfaceDetectionSettings | None) -> str:
    if surface is None:
        return ""
    # LAMMPS reads the limit of coordination as a whole number.
    limit = repr(surface.limit) if surface.style == "divergence" else str(int(surface.limit))
    return f"surface/detection {surface.style} {limit} {surface.splash}"


def _shift(shift: ShiftSettings | None) -> str:
    if shift is None:
        return ""
    exclude = f" exclude/type {' '.join(shift.exclude)}" if shift.exclude else ""
    return (
        "shift" + exclude + (f" scale/cross/type {_numbers(shift.scale_cross_type)}" if shift.scale_cross_type else "")
    )


def _pressure(scene: Scene) -> str:
    entries = ((law.types, law.style, law.value) for law in scene.pressure)
    words = (f"{types} {style}" + ("" if value is None else f" {value!r}") for types, style, value in entries)
    return f"rheo/pressure {' '.join(words)}"


def _per_type(values: Sequence[str | None]) -> list[tuple[str, str]]:
    """Return types and their value; adjacent types with the same value form a range, and None is left out."""
    entries, n, first = [], len(values), 1
    for value, group in itertools.groupby(values):
        last = first + len(list(group)) - 1
        if value is not None:
            entries.append((_range(first, last, n), value))
        first = last + 1
    return entries


def _range(first: int, last: int, n: int) -> str:
    """Return types in the shortest of the manual's forms: ``*``, ``n``, ``*n``, ``m*`` or ``m*n``."""
    if first == last and n > 1:
        return str(first)
    return f"{first if first > 1 else ''}*{last if last < n else ''}"


def _viscosity(scene: Scene) -> str:
    laws = [
        f"power {_numbers((law.eta, law.gd0, law.K, law.n))}" if isinstance(law, PowerLaw) else f"constant {law!r}"
        for law in (atom_type.viscosity for atom_type in scene.types)
    ]
    return " ".join(["rheo/viscosity", *(f"{types} {law}" for types, law in _per_type(laws))])


def _thermal(scene: Scene) -> str:
    keywords: dict[str, list[float] | list[float | None]] = {
        "conductivity": [t.conductivity for t in scene.types],
        "specific/heat": [t.specific_heat for t in scene.types],
        "Tfreeze": [t.T_freeze for t in scene.types],
        "latent/heat": [t.latent_heat for t in scene.types],
    }
    words = ["rheo/thermal"]
    for keyword, values in keywords.items():
        texts = [None if value is None else f"constant {value!r}" for value in values]
        words += [f"{keyword} {types} {text}" for types, text in _per_type(texts)]
    return " ".join(words)


def _forces(scene: Scene) -> Iterable[str]:
    groups: set[str] = set()
    for k, force in enumerate(scene.forces, 1):
        group = "all"
        if force.types is not None:
            types = [str(t) for t in type_range(force.types, len(scene.types))]
            group = "types_" + "_".join(types)
            if group not in groups:
                groups.add(group)
                yield f"group {group} type {' '.join(types)}"
        for n, action in enumerate(_actions(force), 1):
            yield f"fix force{k}_{n} {group} {action}"


def _actions(force: ForceSettings) -> Iterable[str]:
    vector_c = [*force.vector, *[0.0] * (3 - len(force.vector))]
    if force.style != "gravity":
        yield f"{force.style} " + " ".join("NULL" if v is None else repr(v) for v in vector_c)
        return
    # LAMMPS scales the direction to length 1; along one axis that rounds nothing, so one fix per axis.
    for axis, v in enumerate(vector_c):
        if v:
            direction = [str(int(math.copysign(1, v))) if a == axis else "0" for a in range(3)]
            yield f"gravity {abs(v)!r} vector {' '.join(direction)}"


def _fixes(scene: Scene, cut: float, plan: Plan) -> Iterable[str]:
    thermal, example = plan.needs("fix rheo/thermal"), scene.example
    yield (example and example.line("rheo")) or f"fix rheo all {_rheo(scene, cut, thermal)}"
    yield f"fix viscosity all {_viscosity(scene)}"
    yield (example and example.line("pressure")) or f"fix pressure all {_pressure(scene)}"
    if thermal:
        yield f"fix thermal all {_thermal(scene)}"
    if plan.needs("pair rheo"):
        yield from _forces(scene)
    if plan.needs("fix enforce2d"):
        yield "fix flat all enforce2d"
    if scene.evolve and (deform := scene.evolve.deform):
        rates = list(zip("xyz", deform.rates, strict=True))[: scene.dimension]
        rates += [(pair, rate) for pair, rate in zip(("xy", "xz", "yz"), deform.shears, strict=True) if rate]
        words = " ".join(f"{what} erate {rate!r}" for what, rate in rates)
        yield f"fix deform all deform 1 {words} remap {deform.remap}"
