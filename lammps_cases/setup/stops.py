"""Input of LAMMPS between two runs: the commands of every route that `lammps_cases.scene.runs` names."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from eos_ref.syntax.ranges import type_range
from lammps_cases.engine.interlude import FOLDER, Interlude, InterludeAction
from lammps_cases.scene import Scene
from lammps_cases.scene.atoms import Atoms
from lammps_cases.scene.runs import Displacement, Stop, upper_corners

# Another scene: another dimension, atom style, number of types and cutoff, with all keywords of fix rheo. Its kernel is
# the quintic one: at walls, reproducing kernels with few neighbours depend on uninitialised memory.
OTHER_SCENE = """
units lj
dimension 3
atom_style rheo/thermal
newton off
boundary f p p
comm_modify vel yes
region box block 0 8 0 8 0 8
create_box 3 box
create_atoms 1 single 3.0 4.0 4.0 units box
create_atoms 2 single 4.1 4.2 4.0 units box
create_atoms 3 single 4.0 5.1 4.3 units box
mass * 2.5
set group all rheo/rho 1.9 sph/e 3.0
set type 3 rheo/status 1
pair_style rheo 2.5 artificial/visc 0.7 rho/damp 0.3 harmonic/means
pair_coeff * *
timestep 0.001
fix rheo all rheo 2.5 quintic 0 thermal interface/reconstruct surface/detection coordination 5 1 shift &
  density 1.5 1.4 1.3 speed/sound 3.0 4.0 5.0
fix viscosity all rheo/viscosity * power 0.3 0.2 0.1 0.5
fix pressure all rheo/pressure * tait/general 3.5 * background 0.4
fix thermal all rheo/thermal conductivity * constant 0.3 specific/heat * constant 0.8
fix push all addforce 1.0 2.0 3.0
run 2 post no
"""
REFUSED = (
    "set group all rheo/status 7",
    "fix pressure2 all rheo/pressure 1 no_such_style",
    "unfix no_such_fix",
    "run -1",
)


@dataclass(frozen=True)
class Lines:
    """The commands of a scene by purpose.

    Attributes
    ----------
    style : units, atom style, newton, boundary: kept in a restart file
    neighbours : communication and neighbour lists, which are set again after a file is read
    model : style of communication, pair style, time step, fixes and compute
    """

    style: tuple[str, ...]
    neighbours: tuple[str, ...]
    model: tuple[str, ...]


def interlude(stop: Stop, scene: Scene, lines: Lines, atoms: Atoms) -> Interlude:
    """Return the input of LAMMPS at a stop before the next run."""
    actions = [*_route(stop, scene, lines, atoms), *_settings(stop, scene, atoms)]
    moves = stop.displace is not None or stop.stretch is not None
    return Interlude(tuple(actions), moves, sets_up=stop.by != "continued")


def _settings(stop: Stop, scene: Scene, atoms: Atoms) -> Iterable[InterludeAction]:
    """Yield the changes of a stop in addition to its route."""
    assert scene.evolve is not None
    timesteps = [one.timestep for one in scene.evolve.stops if one.at <= stop.at and one.timestep is not None]
    if timesteps and stop.by != "dt/reset":  # also that of an earlier stop: a route may have set the model's
        yield InterludeAction(f"timestep {timesteps[-1]!r}")
    if stop.count is not None:
        yield InterludeAction(f"reset_timestep {stop.count}")
    if stop.stretch:
        yield _stretched(stop, scene, atoms)
    if stop.displace:
        yield from _displaced(stop, stop.displace, scene)


def _stretched(stop: Stop, scene: Scene, atoms: Atoms) -> InterludeAction:
    assert scene.evolve is not None
    low_c = atoms.low_c.tolist()
    high_c = upper_corners(scene.evolve.stops, low_c, atoms.high_c.tolist())[stop.at]
    ends = [f"{axis} final {low!r} {high!r}" for axis, low, high in zip("xyz", low_c, high_c, strict=True)]
    return InterludeAction(f"change_box all {' '.join(ends[: scene.dimension])} remap units box")


def _displaced(stop: Stop, move: Displacement, scene: Scene) -> Iterable[InterludeAction]:
    vector = " ".join(map(repr, move.vector))
    if move.types is None:
        yield InterludeAction(f"displace_atoms all move {vector} units box")
        return
    group = f"displaced_{stop.at}"  # separate: group adds to an existing group
    yield InterludeAction(f"group {group} type {' '.join(map(str, type_range(move.types, len(scene.types))))}")
    yield InterludeAction(f"displace_atoms {group} move {vector} units box")


def _given(lines: Iterable[str]) -> list[InterludeAction]:
    return [InterludeAction(line) for line in lines]


def _route(stop: Stop, scene: Scene, lines: Lines, atoms: Atoms) -> list[InterludeAction]:
    restart = [InterludeAction(f"write_restart {FOLDER}/restart.{stop.at}"), InterludeAction("clear")]
    read = [InterludeAction(f"read_restart {FOLDER}/restart.{stop.at}"), *_given((*lines.neighbours, *lines.model))]
    match stop.by:
        case "run" | "continued":
            return []
        case "dt/reset":
            # A step in which anything moves farther than 1e-30 is too long: LAMMPS takes its shortest step.
            assert stop.timestep is not None
            least, most = stop.timestep, math.nextafter(stop.timestep, math.inf)
            return _given([f"fix reset all dt/reset 1 {least!r} {most!r} 1e-30 units box"])
        case "restart":
            return [*restart, *read]
        case "other scene":
            return [
                *restart,
                *_given(OTHER_SCENE.replace("&\n", "").strip().split("\n")),
                InterludeAction("clear"),
                *read,
            ]
        case "data" | "data nofix":
            data = f"{FOLDER}/data.{stop.at}"
            assert scene.evolve is not None
            (count,) = scene.evolve.counted((stop.at,))
            again = [*lines.style, *lines.neighbours, f"read_data {data}", *lines.model, f"reset_timestep {count}"]
            return [
                InterludeAction(f"write_data {data}{stop.by.removeprefix('data')}"),
                InterludeAction("clear"),
                *_given(again),
            ]
        case "by hand":
            file = f"{FOLDER}/hand.{stop.at}"
            assert scene.evolve is not None
            (count,) = scene.evolve.counted((stop.at,))
            again = [*lines.style, *lines.neighbours, f"read_data {file}", *lines.model, f"reset_timestep {count}"]
            return [*_by_hand(file, scene, atoms), InterludeAction("clear"), *_given(again)]
        case "replaced":
            (rheo,) = (line for line in lines.model if line.startswith("fix rheo "))
            other = InterludeAction("run 0 post no", evaluates=True)
            return [InterludeAction(_of_others(rheo, len(scene.types))), other, InterludeAction(rheo)]
        case "redefined":
            return [*_undefined(lines.model), InterludeAction("pair_style none"), *_given(lines.model)]
        case "refused command":
            return [InterludeAction(command, "refused") for command in REFUSED]
        case "minimize":
            return [InterludeAction("minimize 0.0 0.0 0 0", evaluates=True)]
        case "replicated":
            return [InterludeAction("replicate 1 1 1")]
        case "set":
            return [InterludeAction(_set(scene), "for each atom", len(atoms))]
        case "recreated":
            groups = [line for line in lines.model if line.startswith("group ")]  # new atoms belong to no group
            return [*_recreated(scene, len(atoms), stop.count_recreated_atoms(len(atoms))), *_given(groups)]


def _by_hand(file: str, scene: Scene, atoms: Atoms) -> Iterable[InterludeAction]:
    """Yield commands that write a data file line by line: box, masses, and all values of each atom, with all digits."""
    edges = zip("xyz", atoms.low_c.tolist(), atoms.high_c.tolist(), strict=True)
    head = ["by hand", "", f"{len(atoms)} atoms", f"{len(scene.types)} atom types", ""]
    head += [f"{low!r} {high!r} {axis}lo {axis}hi" for axis, low, high in edges]
    head += ["", "Masses", "", *(f"{t} {of.mass!r}" for t, of in enumerate(scene.types, 1))]
    z = "{z}" if scene.dimension == 3 else "0.0"  # as where atoms are created
    energy = " {esph}" if scene.thermal else ""
    sections = {
        "Atoms": f"{{id}} {{type}} {{phase}} {{rho}}{energy} {{x}} {{y}} {z}",
        "Velocities": "{id} {vx} {vy} {vz}",
    }
    yield from (InterludeAction(f'print "{line}" append {file} screen no') for line in head)
    for section, line in sections.items():
        yield from (InterludeAction(f'print "{word}" append {file} screen no') for word in ("", section, ""))
        yield InterludeAction(f'print "{line}" append {file} screen no', "for each atom", len(atoms))


def _of_others(rheo: str, types: int) -> str:
    """Return the line of fix rheo with other equilibrium densities and speeds of sound."""
    words = rheo.split()
    for keyword, factor in (("density", 1.25), ("speed/sound", 0.5)):
        begin = words.index(keyword) + 1
        words[begin : begin + types] = [repr(factor * float(word)) for word in words[begin : begin + types]]
    return " ".join(words)


def _undefined(model: Iterable[str]) -> Iterable[InterludeAction]:
    """Yield commands that remove the compute and the fixes, last defined first."""
    for words in reversed([line.split() for line in model]):
        if words[0] in ("fix", "compute"):
            yield InterludeAction(f"un{words[0]} {words[1]}")


def _set(scene: Scene) -> str:
    """Return the command that gives an atom every value that it has."""
    energy = " sph/e {esph}" if scene.thermal else ""
    where = " ".join(f"{axis} {{{axis}}} v{axis} {{v{axis}}}" for axis in "xyz"[: scene.dimension])
    return f"set atom {{id}} type {{type}} {where} rheo/rho {{rho}} rheo/status {{phase}}{energy}"


def _recreated(scene: Scene, natoms: int, last: int) -> Iterable[InterludeAction]:
    yield InterludeAction(f"group recreated id > {natoms - last}")
    yield InterludeAction("delete_atoms group recreated compress no")
    z = "{z}" if scene.dimension == 3 else "0.0"  # a stretched box rounds coordinates that must be 0
    yield InterludeAction(f"create_atoms {{type}} single {{x}} {{y}} {z} units box", "for each atom", last)
    yield InterludeAction(_set(scene), "for each atom", last)
