"""Decks of users and what an audit reports on each; every deck is run once by real LAMMPS."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from lammps_cases.audit.options import AuditOptions, AuditResult
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.claims.probes.probe import edited
from lammps_cases.cli.audit import audit_command, field_table
from lammps_cases.records import deck_wording
from lammps_cases.report import findings
from lammps_cases.report.statements import known_bugs
from tests.support.audited_decks import DECKS, FIXES, MELT, case_of, fluid_deck, inlined
from tests.support.pages import unpacked

pytestmark = pytest.mark.lammps

BUG, STALE, HOT = "force-per-volume", "stale-gradient-below-zmin", "heat-is-temperature-rate"
BONDED = "special-bonds-remove-pairs"
PASSING = frozenset({"exact", "pass"})

# --- a block of fluid, with words changed

Edits = dict[str, str]
BLOCK = (DECKS / "in.block").read_text()
FIX = "quintic 0 density"
OPEN = {"boundary     p p p": "boundary     f f p"}
ROOM = OPEN | {
    "box block 0 10 0 10": "box block -5 15 -5 15",
    "create_atoms 1 box": "region fluid block 0 10 0 10 -0.5 0.5\ncreate_atoms 1 region fluid",
}
LATTICE = {
    "displace_atoms all random 0.1 0.1 0 4711 units box\n": "",
    "velocity     all create 0.0005 8123 loop geom\n": "",
}
THERMAL = {"atom_style   rheo": "atom_style   rheo/thermal", FIX: "quintic 0 thermal density"}
WARM = {"velocity ": "variable e atom 1+0.5*sin(PI*x/5)\nset group all sph/e v_e\nvelocity "}
CONDUCTS = "fix 5 all rheo/thermal conductivity * constant {} specific/heat * constant 1.0\nrun          "
MASSES = "mass * 1.0\nfix m all property/atom rmass ghost yes\nset group all mass 1.0\nset type 2 mass 1.3"
# The bug multiplies heat flows by 1/(m cv) = 16: from some step on energies overflow.
OVERFLOWING = (
    THERMAL
    | {"velocity ": WARM["velocity "].replace("x/5", "x/1.25"), "lattice      sq 1.0": "lattice sq 16.0"}
    | {"mass         * 1.0": "mass * 0.0625", "box block 0 10 0 10": "box block 0 2.5 0 2.5"}
    | {"region       right block 5 10": "region right block 1 2.5", "random 0.1 0.1": "random 0.02 0.02"}
    | {"pair_style   rheo 3.0 artificial/visc 1.0": "pair_style rheo 0.75", "rheo 3.0 quintic": "rheo 0.75 quintic"}
    | {"4 all enforce2d": "4 all setforce 0 0 0"}
)
HEAT_DIVERGES = {
    "verdict": "error", "broke": {"kind": "runaway", "column": "energy"}, "outlook": {"findings": [HOT]},
}  # fmt: skip

# --- water over a floor, and a column of it

BASIN = (DECKS / "in.basin").read_text()
STATUS = {"set             group floor rheo/status 1\n": ""}
COLUMN = (DECKS / "in.column").read_text()
# Particles of unit volume, where no known finding of this LAMMPS makes a difference to forces at rest.
UNIT = (
    COLUMN.replace("sq 100.0", "sq 1.0")
    .replace("0 12 0 14 -0.1 0.1", "0 12 0 14 -0.5 0.5")
    .replace("* 0.01\n", "* 1.0\n", 1)
    .replace("rheo 0.3 ", "rheo 3.0 ")
    .replace("timestep        0.001", "timestep        0.01")
    .replace("* constant 0.01", "* constant 0.5")
)
FIXED = UNIT.replace("boundary        p s p", "boundary        p f p")


# --- particles whose volume is not 1, in several units

CUBE = """units           {units}
dimension       3
atom_style      rheo
comm_modify     vel yes
{before}lattice         sc {lattice}
region          box block 0 5 0 5 0 5
create_box      1 box
create_atoms    1 box
displace_atoms  all random 0.2 0.2 0.2 135414 units box
set             group all rheo/rho 0.3
mass            1 18
{masses}velocity        all set 0.001 0.0 0.0
timestep        1e-6
pair_style      rheo 10.0
pair_coeff      * *
fix             1 all rheo 10.0 quintic 0 density 0.28 speed/sound 0.01 {sums}
fix             2 all rheo/viscosity * constant 0.01
fix             3 all rheo/pressure * linear
run             2
"""
TWO_MASSES = "set atom * mass 18\nset atom 7 mass {}\n"


def cube(units: str = "lj", sums: str = "", masses: str = "", before: str = "") -> str:
    lattice = 4.0**-3 if units == "lj" else 4.0  # a density there
    return CUBE.format(units=units, lattice=lattice, sums=sums, masses=masses, before=before)


GHOSTS = "fix m all property/atom rmass{}\n"

# --- pairs with bonds: everything that sums over neighbours, in motion, and two particles that are two bonds apart

BONDS = "".join(
    f"{line}\n"
    for line in edited(
        "bonded",
        (
            ("hybrid rheo bond", "hybrid rheo/thermal bond"),
            ("extra/bond/per/atom 1 extra/special/per/atom 2", "extra/bond/per/atom 2 extra/special/per/atom 4"),
            ("bond 1 1 2", "bond 1 1 2\ncreate_bonds single/bond 1 2 3"),
            ("set atom 1 vx 0.3", "set atom 1 vx 0.3\nset atom * sph/e 1.0\nset atom 1 sph/e 1.5"),
            ("visc 1.0", "visc 1.0 rho/damp 0.1"),
            ("quintic 0", "quintic 0 thermal shift"),
            ("fix 4 all", "fix 5 all rheo/thermal conductivity * constant 0.2 specific/heat * constant 0.9\nfix 4 all"),
            ("run 0", "timestep 0.01\nrun 20"),
        ),
    )
)
WEIGHTS = "lj 0 1 1 coul 0 1 1"
HARMONIC = {"bond_style zero nocoeff": "bond_style harmonic", "bond_coeff *": "bond_coeff * 1.0 1.0"}
# --- a body of springs that another one runs into, between walls that add forces of their own; and a drop with a shell

BODIES = """dimension 2
units lj
atom_style hybrid rheo bond
boundary p m p
comm_modify vel yes
newton off
region box block 0 12 0 9 -0.1 0.1 units box
create_box 2 box bond/types 2 extra/bond/per/atom 12 extra/special/per/atom 50
lattice sq 1.0
region left block 0 4.9 2 6.9 -0.1 0.1
region right block 5 8.9 2 6.9 -0.1 0.1
create_atoms 1 box
mass * 1.0
set group all rheo/rho 1.0
group left region left
group right region right
group bodies union left right
group fluid subtract all bodies
set group right type 2
set group bodies rheo/status 1
displace_atoms all random 0.05 0.05 0 2467 units box
velocity all create 0.001 83
velocity all set NULL NULL 0
velocity left set 0.2 0 0 sum yes
timestep 0.02
pair_style hybrid/overlay rheo 3.0 artificial/visc 1.0 rheo/solid
pair_coeff * * rheo
pair_coeff 1 1 rheo/solid 1.0 1.2 0.5
pair_coeff 1 2 rheo/solid 1.5 1.1 0.3
special_bonds lj 0 1 1 coul 0 1 1
create_bonds many left left 1 0 1.6
create_bonds many right right 1 0 1.6
special_bonds lj 0 1 1 coul 1 1 1
bond_style bpm/spring
bond_coeff * 1.0 0.08 0.3
fix 1 all rheo 3.0 quintic 0
fix 2 all rheo/viscosity * constant 0.1
fix 3 all rheo/pressure * linear
fix 4 all wall/harmonic ylo EDGE 1.0 1.0 1.0 yhi EDGE 1.0 1.0 1.0
fix 5 all enforce2d
run 20
"""
SHELL = {
    "quintic 0": "quintic 0 shift surface/detection coordination 25 4",
    "timestep 0.02": "neigh_modify delay 0 check no\ntimestep 0.02",
    "fix 4": "fix 6 fluid rheo/oxidation 1.3 2 0.5\nfix 4",
    "boundary p": "boundary s",
    "create_atoms 1 box": "region some block 0.1 11.1 1 7.1 -0.1 0.1\ncreate_atoms 1 region some",
}
BULK = {
    "dimension 2": "dimension 3",
    "lattice sq": "lattice sc",
    "-0.1 0.1 units box": "0 6 units box",
    "left block 0 4.9 2 6.9 -0.1 0.1": "left block 0 4.9 2 6.9 1 3.9",
    "right block 5 8.9 2 6.9 -0.1 0.1": "right block 5 8.9 2 6.9 1 3.9",
    "0.05 0.05 0 2467": "0.05 0.05 0.05 2467",
    "velocity all set NULL NULL 0\n": "",
    "fix 5 all enforce2d\n": "",
    "per/atom 12 extra/special/per/atom 50": "per/atom 40 extra/special/per/atom 200",
}
HYBRID = {
    "bond_style bpm/spring": "bond_style hybrid bpm/spring rheo/shell t/form 0.1",
    "bond_coeff * 1.0 0.08 0.3": "bond_coeff 1 bpm/spring 1.0 0.08 0.3\nbond_coeff 2 rheo/shell 0.5 0.3 0.2",
}
SHELLED = {
    "half": set(),
    "by": {"f": {BUG, "shell-softens"}, "shift/v": {"shells-shift"}},
    "acting_on": frozenset({"shell-softens", "shells-shift"}),
}
OF_PAIRS = frozenset({"coordination", "grad/v", "stress/v", "stress/t", "drho", "heatflow", "shift/v", "f"})
RHO = "set             group all rheo/rho 1.0"
LINEAR = "fix 3 all rheo/pressure * linear\n"

# A deck and its changes; then parts of the record as in `document` below: a text is the beginning of the one found, a
# list has all entries, a set all names, a frozenset some of them.
ROWS: dict[str, tuple[str, Edits, dict[str, Any]]] = {
    # effects that follow from LAMMPS' neighbour lists
    "pairs across boundaries": (BLOCK, {"units        lj": "newton off on\nunits lj"}, {
        "by": {"grad/v": {"boundary-pairs-twice"}, "f": {"boundary-pairs-twice", BUG}},
        "acting_on": frozenset({"boundary-pairs-twice"})}),
    "interface of two fluids": (BLOCK, {FIX: "RK1 8 shift scale/cross/type 0.05 0.02 0.5 density"}, {
        "by": {"shift/v": {"cross-type-support", "cross-type-normal"}, "f": {BUG}},
        "acting_on": frozenset({"cross-type-support", "cross-type-normal"})}),
    "particles of two masses": (BLOCK, {"mass         * 1.0": MASSES}, {
        "by": {"f": {"mass-of-first", BUG}}, "acting_on": frozenset({"mass-of-first"})}),
    # memory that LAMMPS does not set: only a trusted deck gets the variables of glibc
    "stale memory of zeros": (BLOCK, {FIX: "RK1 60 density"}, {
        "memory": 0, "acting_on": {STALE}, "compared": {"coordination", "viscosity", "pressure", "drho"},
        "inside": {"coordination", "viscosity", "pressure", "drho"},
        "unchecked": dict.fromkeys(("f", "grad/v", "stress/v", "stress/t"),
                                   "not predictable in steps 0 to 20, because of the known bug stale-")}),
    "stop by stale memory": (BLOCK, ROOM | {FIX: "RK1 20 density"}, {  # eight bytes of 127 are the double 1.4e306
        "memory": 127, "verdict": "refused", "outlook": {"cause": "findings", "findings": [STALE]}}),
    "velocities of images": (
        BLOCK, {"box block 0 10 0 10 -0.5 0.5": "box prism 0 10 0 10 -0.5 0.5 0 0 0", FIX: "quintic 0 shift density",
                "run          20": "fix 5 all deform 1 xy erate 0.01 remap v\nrun 20"}, {
        "why": {"gives images other velocities (remap v)": {"grad/v", "shift/v", "f", "stress/v", "stress/t"}}}),
    # findings that act by the definitions of a deck though no field compared shows them
    "volumes at rest": (BLOCK, LATTICE | {"mass         * 1.0": "mass * 0.2"}, {
        "acts": {BUG: "forces of pairs are 5 times what they should be"}}),
    "volumes of one type": (BLOCK, LATTICE | {"mass         * 1.0": "mass 1 1.0\nmass 2 0.5"}, {
        "acts": {BUG: "forces of pairs are 2 times what they should be for type 2"}}),
    "gas": (BLOCK, THERMAL | WARM | {"* linear": "* ideal/gas 1.4", "run          ": CONDUCTS.format(0.0)}, {
        "acts": {"gas-without-work": "Sound in an ideal gas is too slow by a factor of sqrt(gamma)"}}),
    "summed solids": (
        BLOCK, LATTICE | {FIX: "quintic 0 rho/sum density",
                          "timestep ": "set type 2 rheo/status 1\nfix 0 all setforce 0 0 0\ntimestep "}, {
        "acts": {"solids-summed": "Solids do not keep the density they were given"}}),
    "order zero": (BLOCK, LATTICE | {FIX: "RK0 0 density"}, {
        "acts": {"kernel-corrects-gradients-only": "RK0 corrects nothing"}}),
    "nothing": (BLOCK, LATTICE, {"verdict": "exact", "acts": {}, "acting_on": set(), "warnings": []}),
    # states that break
    "heat in 40 steps": (BLOCK, OVERFLOWING | {"run          20": CONDUCTS.format(0.1) + "40"}, HEAT_DIVERGES),
    "heat in 700 steps": (BLOCK, OVERFLOWING | {"run          20": CONDUCTS.format(0.1) + "700"}, HEAT_DIVERGES),
    **{f"density of {rho}": (BLOCK, {"velocity ": f"set atom 7 rheo/rho {rho}\nvelocity "}, {
        "verdict": verdict, "broke": {"column": "rho", "atom": 7, "step": 0, "given": True}, "message": (
            f"unstable as set up: run 1 begins with rho = {rho} of atom 7")})
       for rho, verdict in ((-0.5, "error"), (0.0, "refused"))},
    "deposited at the default density": (
        BLOCK, ROOM | LATTICE | {"density 1.0 1.0": "density 0.05 0.05", "mass         * 1.0": "mass * 0.05",
                                 "rheo/rho 1.0": "rheo/rho 0.05", "run          20":
                                 "region top block 0 5 12 14 -0.1 0.1\nfix 5 all deposit 1 1 9 7 region top\nrun 20"}, {
        "verdict": None, "broke": None, "warns": ["type 1: rho is 20 times rho0 = 0.05"]}),
    "coinciding particles": (  # neither code defines forces there, so there is no difference between them
        BLOCK, LATTICE | {"set          group": "create_atoms 1 single 3.0 4.0 0.0\nset          group"}, {
        "verdict": "error", "broke": {"kind": "not a number", "step": 0, "both": True},
        "outlook": {"because": "atoms 44 and 101 lie at the same place"}}),
    "coinciding solids": (  # pairs of solids have no forces, wherever they lie
        BLOCK, LATTICE | {"set          group": "create_atoms 2 single 7.0 4.0 0.0\nset          group",
                          "timestep ": "set type 2 rheo/status 1\nfix 0 all setforce 0 0 0\ntimestep ",
                          "run          20": "run 0"}, {
        "verdict": None, "warns": ["lie at the same place"], "compared": frozenset({"f"})}),
    **{f"particles lost, {how}": (
        BLOCK, OPEN | LATTICE | {"timestep ": f"velocity all set 0.5 0 0\nthermo_modify lost {how}\ntimestep ",
                                 "run          20": "run 60"}, {
        "verdict": None, "lost": {"lost": 10, "of": 100, "ignored": True}}) for how in ("ignore", "warn")},
    # questionable set-ups, by the sample in which they are worst
    "a column across the boundary": (BLOCK, LATTICE | {"box block 0 10 ": "box block 0 10.3 "}, {
        "verdict": None, "warns": ["atoms 1 and 11 are 0.3 apart across a boundary, 0.3 of the spacing 0.999 (10 pairs "
                                   "closer than 0.5 of it)"]}),
    "a fluid that falls": (BLOCK, LATTICE | {"run          20": "fix 5 all addforce 0.1 0 0\nrun 120"}, {
        "verdict": None, "warns": ["type 1: speed of sound 1 is 1.67 times the largest speed of its fluid, 0.597"]}),
    "masses of a summed fluid": (
        BLOCK, LATTICE | {FIX: "quintic 0 rho/sum density", "mass         * 1.0": "mass * 0.75"}, {
        "verdict": None, "warns": ["type 1: m = 0.75 is 0.75 times rho0 V"]}),
    "weight by addforce": (BLOCK, ROOM | LATTICE | {"run          20": "fix 5 all addforce 0.0 -0.02 0.0\nrun 10"}, {
        "verdict": None, "warns": ["speed of sound 1 is 2.24 times sqrt(g h) = 0.447 (g = 0.02, fluid of height 10)"]}),
    "particles that are added": (
        BLOCK, LATTICE | {"density 1.0 1.0": "density 5.0 5.0", "mass         * 1.0": "mass * 5.0",
                          "rheo/rho 1.0": "rheo/rho 5.0",
                          "run          20": "run 10\ncreate_atoms 1 single 2.5 2.5 0.0\nrun 10"}, {
        "verdict": None, "warns": ["type 1: rho is 0.2 times rho0 = 5 (1, atom 101; 1 of 51 fluid particles are "]}),
    # one wrong word
    "basin": (BASIN, {}, {"verdict": None, "fields": "all", "warnings": []}),
    "density of the basin": (BASIN, {RHO: RHO.replace("1.0", "1.2")}, {
        "own": ["type 1: speed of sound 1 is 4.58 times ", "type 1: rho is 1.2 times rho0 = 1 (median of 72 fluid "]}),
    "mass of the basin": (BASIN, {"mass            * 1.0": "mass * 1.5"}, {
        "own": ["type 1: m = 1.5 is 1.5 times rho0 V = 0.9999"]}),
    # masses that fit a density far from rho0 are not reported in addition
    "density and mass of the basin": (
        BASIN, {RHO: RHO.replace("1.0", "1.5"), "mass            * 1.0": "mass * 1.5"}, {
        "own": ["type 1: speed of sound 1 is 2.39 times ", "type 1: rho is 1.5 times rho0 = 1 "]}),
    "fast water": (BASIN, {"timestep ": "velocity water set 0.2 0 0\ntimestep "}, {
        "own": ["type 1: speed of sound 1 is 4.97 times the largest speed of its fluid, 0.201: "]}),
    "heavy water": (BASIN, {"gravity 1e-4": "gravity 2e-2"}, {  # nine rows: the extent between the outer ones is 8
        "own": ["speed of sound 1 is 2.5 times sqrt(g h) = 0.4 (g = 0.02, fluid of height 8): its weight will "]}),
    "gravity along a period": (BASIN, {"vector 0 -1 0": "vector 1 0 0", "gravity 1e-4": "gravity 2e-2"}, {"own": []}),
    "floor of fluid, reconstructed": (BASIN, STATUS, {
        "own": ["fix setforce 0 holds 32 particles of type 2 that are fluid",
                "fix rheo has interface/reconstruct, but none of 104 particles is solid"]}),
    "floor of fluid": (BASIN, STATUS | {" interface/reconstruct": ""}, {
        "own": ["fix setforce 0 holds 32 particles of type 2 that are fluid"]}),
    # a setforce within a region is not followed; the lowest rows have no moving fluid next to them
    "floor held in a region": (
        BASIN, STATUS | {" interface/reconstruct": "", "setforce 0 0 0": "setforce 0 0 0 region floor"}, {
        "verdict": None, "fields": ("coordination",),
        "warnings": ["24 fluid particles of type 2 are at rest in step 20 as in the sample before, although "]}),
    "suffix": (BASIN, {"units ": "suffix omp\nunits "}, {
        "own": ["suffix omp: this LAMMPS has no rheo/omp; RHEO's styles run without it"]}),
    "range with a hyphen": (BASIN, {"rheo/pressure * linear": "rheo/pressure * linear 1-2 background 0.01"}, {
        "fields": ("pressure",), "seen": ["hyphen-range-accepted"], "inside": {"pressure"},
        "laws": [{"background": 0.01}, {"background": 0.0}], "without offset": [
            "fix 3 (rheo/pressure): '1-2' is not a valid type range: LAMMPS reads it as '1' only (known bug "]}),
    "hyphen that is refused": (BASIN, {"rheo/pressure * linear": "rheo/pressure 1-2 linear"}, {
        "verdict": "refused",
        "warnings": ["fix 3 (rheo/pressure): '1-2' is not a valid type range: LAMMPS reads it as '1' only "]}),
    # documented input that LAMMPS refuses, and the same error of a mistake
    **{f"refused by {names}": (BLOCK, edits, {"verdict": "refused", "bugs": names}) for names, edits in (
        ({"self-mass-missing"}, {FIX: "quintic 0 rho/sum self/mass density"}),
        ({"exclude-takes-one-range"}, {FIX: "quintic 0 shift exclude/type 1 2 density"}),
        ({"reconstruct-refuses-cubic"}, {FIX: "quintic 0 interface/reconstruct density", "* linear": "* cubic 1.0"}),
        ({"example-surface-detection"}, {"density 1.0 1.0 speed/sound 1.0 1.0": "surface/detection coordination 40"}),
        ({"example-rhosum"}, {FIX: "quintic 0 rhosum density"}),
        ({"pressure-takes-one-range"}, {"* linear": "1,2 linear"}),
        ({"respa-refused"}, {"run          20": "run_style respa 2 2 pair 1\nrun 20"}),
        ({"data-file-of-walls"}, {
            FIX: "quintic 0 interface/reconstruct density",
            "run          20": "run 0\nwrite_data walls.data\nclear\natom_style rheo\nread_data walls.data"}),
        (set(), {"fix          2 all rheo/viscosity * constant 0.1\n": ""}),
        (set(), {FIX: "quintic 0 shift exclude/type 3 density"}))},
    **{f"killed by {name}": (
        BLOCK, {"run          20": f"compute c all rheo/property/atom {shown}\ndump 1 all custom 5 d id c_c\nrun 20"}, {
        "verdict": "crashed", "bugs": {name}, "died": "SIGSEGV"})
       for name, shown in (("stress-without-pressure-segfault", "stress/t/xx"),
                           ("nbond-shell-segfault", "nbond/shell"))},
    # units and masses
    "units lj": (cube(), {}, {"bugs": {BUG}, "state": "KNOWN BUGS", "codes": (0, 1)}),
    "units real": (cube("real"), {}, {
        "bugs": {BUG, "units-unconverted", "density-by-force-factor"}, "state": "KNOWN BUGS", "codes": (0, 1),
        "unchecked": {"f": "in units"}}),  # forces are not compared
    "units metal": (cube("metal", "rho/sum"), {}, {
        "bugs": {BUG, "units-unconverted"}, "state": "KNOWN BUGS", "codes": (0, 1), "unchecked": {"f": "in units"}}),
    "unequal masses": (cube(masses=TWO_MASSES.format(36), before=GHOSTS.format(" ghost yes")), {}, {
        "by": {"f": {"mass-of-first", BUG}}, "bugs": {"mass-of-first", BUG}, "silent": "ghost"}),
    "equal masses": (cube(masses=TWO_MASSES.format(18), before=GHOSTS.format(" ghost yes")), {}, {
        "by": {"f": {BUG}}, "bugs": {BUG}, "silent": "ghost"}),
    "images without masses": (cube(masses=TWO_MASSES.format(36), before=GHOSTS.format("")), {}, {
        "verdict": None, "warns": ["without 'ghost yes'"]}),
    # bonds
    "pairs removed by special_bonds": (BONDS, {}, {
        "compared": OF_PAIRS, "half": set(), "explains": {BONDED: OF_PAIRS}, "acting_on": frozenset({BONDED})}),
    **{f"weights {weights}": (BONDS, {WEIGHTS: weights}, {
        "verdict": None, "compared": OF_PAIRS, "half": set(), "absent": {BONDED}, "inside": {"coordination", "grad/v"}})
       for weights in ("lj 0 1 1 coul 1 1 1", "lj 1 1 1 coul 0 1 1", "lj 0.5 1 1 coul 0.5 1 1")},
    "harmonic bonds": (BONDS, HARMONIC | {WEIGHTS: "lj 0 1 1 coul 1 1 1"}, {
        "verdict": None, "compared": OF_PAIRS - {"f"}, "why": {"bond": {"f"}},
        "unchecked": {"f": "bond_style harmonic adds to it"}}),
    **{f"elastic bodies{how}": (BODIES, edits, {
        "verdict": None, "compared": frozenset({"f", "drho"}), "half": set(), "by": {"f": {BUG}}})
       for how, edits in {"": {}, ", newton on": {"newton off": "newton on off"},
                          ", sharp": {"bpm/spring": "bpm/spring smooth no normalize yes break no"},
                          ", 3D": BULK}.items()},
    "shells and bodies": (BODIES, SHELL | HYBRID, SHELLED),
    "shells": (BODIES, SHELL | {
        "create_bonds many left left 1 0 1.6": "", "create_bonds many right right 1 0 1.6": "",
        "set group bodies rheo/status 1": "", "fix 6 fluid": "fix 6 all", "bpm/spring": "rheo/shell t/form 0.1"},
        SHELLED),
    # what makes a run diverge
    "column": (COLUMN, {}, {
        "verdict": "refused", "outlook": {"cause": "findings", "findings": [BUG]},
        "message": f"unstable because of the known bug {BUG}: continued from step",
        "effects": {"f": "f is 100 times what it should be"},
        "warns": ["run 1: from step 10 on particles are much faster than sound: fields were not checked there"]}),
    "column with a force that is not followed": (  # what the reference would do without it explains nothing
        COLUMN, {"run             100": "fix             7 water spring/self 0.1\nrun             100"}, {
        "verdict": "refused", "compared": frozenset({"f"}), "outlook": None}),
    "column of unit volumes": (UNIT, {}, {"verdict": None, "outlook": None}),
    "column with a long time step": (FIXED, {"timestep        0.01": "timestep        0.4"}, {
        "verdict": "refused", "outlook": {"cause": "time step", "findings": []},
        "message": "unstable because of the time step: time step is 16 times",
        "says": "the reference also diverges after "}),
    "column of a soft fluid": (FIXED, {"* linear": "* linear * background 3e5"}, {
        "verdict": "refused", "outlook": {"cause": "set-up", "findings": []},
        "message": "unstable as set up: speed of sound is 3.33 times sqrt(g h)",
        "says": "the reference also diverges after "}),
    "column that flies": (FIXED, {"gravity 1.0 vector 0 -1 0": "gravity 40.0 vector 0 1 0"}, {
        "verdict": "refused", "outlook": {"cause": "not understood", "findings": []}, "message": "not understood",
        "says": "continued from step "}),
    "column out of balance": (
        COLUMN, {"set             group all rheo/rho 1.0\n": "set             group all rheo/rho 1.01\n",
                 "boundary        p s p": "boundary        p f p"}, {
        "verdict": "refused", "by": {"f": {BUG}}}),
    # the total f cannot be compared, as an unknown force adds to it; that of the finding is density over mass
    "finding hidden by other forces": (
        COLUMN, {"set             group all rheo/rho 1.0\n":
                 "displace_atoms  all random 0.01 0.01 0 135414 units box\nset group all rheo/rho 1.01\n",
                 "rheo 0.3 artificial/visc 0.5": "hybrid/overlay rheo 0.3 artificial/visc 0.5 soft 0.1",
                 "pair_coeff      * *": "pair_coeff * * rheo\npair_coeff * * soft 1.0",
                 "run             100": "run             0"}, {
        "verdict": None, "effects": {"f": "f is 101 times what it should be"}}),
    # densities
    "density never set": ("\n".join(inlined("in.never_set")), {}, {
        "verdict": None,
        "of type 1": ["type 1: m = 1.3 is 0.0013 times rho0 V", "type 1: rho was never set: all 32 fluid atoms"],
        "warns": ["rho0 = 1000"]}),
    "offset": ("\n".join(inlined("in.offset")), {}, {
        "verdict": None, "warns": ["type 1: fixed pressure offset", "(5 of it is the background",
                                   "type 2: rho is 1.66 times rho0 = 0.8 ", "a pressure of 0.659 rho0 c^2"]}),
    "constant distance from rho0": (
        fluid_deck(f"mass * 1\nset group all rheo/rho 1.05\n{FIXES}{LINEAR}run 1\n"), {}, {
        "verdict": None, "fields": ("pressure",),
        "warns": ["type 1: rho0 = 1 was never reached: ", "type 2: rho0 = 1 was never reached: "]}),
    # runs without a set-up
    **{f"{name} without a set-up": (BLOCK, {"run          20": f"run 10\n{command}\nrun 20 pre no"}, {
        "verdict": None, "warns": [f"run 2: 'pre no' leaves out the set-up that {name} before it needs"],
        "unchecked": dict.fromkeys(("pressure", "grad/v", "f"), f"the run has no set-up (pre no), which {name} ")})
       for name, command in {"mass": "mass * 1.2", "pair_style": "pair_style rheo 3.0\npair_coeff * *",
                             "change_box": "change_box all x scale 1.2 remap"}.items()},
    "velocities without a set-up": (BLOCK, {"run          20": "run 10\nvelocity all set 0.01 0 0\nrun 20 pre no"}, {
        "verdict": None, "half": set(), "compared": frozenset({"pressure", "grad/v", "f"})}),
    # runs that have no pressure
    "run of another system": (
        f"{MELT}clear\n{fluid_deck(f'set group all rheo/rho 1.0{chr(10)}{FIXES}{LINEAR}run 5{chr(10)}')}", {}, {
        "verdict": None, "runs": {2},
        "warns": ["run 1: no fix rheo/pressure was defined, nothing was checked"]}),
    "minimization": (  # it invokes the callback as a run does
        fluid_deck(f"set group all rheo/rho 1.1\n{FIXES}{LINEAR}run 20\nminimize 1e-5 1e-5 50 50\nrun 20\n"), {}, {
        "verdict": "exact", "fields": ("pressure",), "runs": {1, 2}}),
}  # fmt: skip


@pytest.fixture(scope="module")
def audited(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], AuditResult]:
    """Audit a deck, once."""

    @cache
    def audit(name: str) -> AuditResult:
        text, edits, expected = ROWS[name]
        for old, new in edits.items():
            assert text.count(old) == 1, old
            text = text.replace(old, new)
        deck = tmp_path_factory.mktemp("deck") / "in.deck"
        deck.write_text(text)
        fields = expected.get("fields", ("pressure",) if "own" in expected else None)
        given = {} if fields is None else {"fields": fields}
        with pytest.MonkeyPatch.context() as patch:
            if "memory" in expected:  # filled with this byte, also what the cache of threads would return
                patch.setenv("MALLOC_PERTURB_", str(255 - expected["memory"]))
                patch.setenv("GLIBC_TUNABLES", "glibc.malloc.tcache_count=0")
            return audit_deck(deck, AuditOptions.of(trust="memory" in expected, **given))

    return audit


def document(result: AuditResult) -> dict[str, Any]:
    """The record of an audit, with views of it that are short to write."""
    case, strict = case_of(result), result.record.model_copy(update={"fail_on": "high"})
    by = {field.field: {*field.explained_by} for field in case.fields}
    outcome = findings.outcome(result.record)
    return case.model_dump() | {
        "by": by,
        "explains": {name: {field for field, names in by.items() if name in names} for name in case.explained_by},
        "seen": case.explained_by,
        "bugs": {*known_bugs(case)},
        "acts": {of.finding: of.does for of in case.acting},
        "acting_on": {of.finding for of in case.acting},
        "compared": {field.field for field in case.fields},
        "half": {*by} & {*case.unchecked},  # of some runs or steps only
        "effects": {of.field: deck_wording.effect(of) for of in case.effects if of.finding == BUG},
        "own": [line for line in case.warnings if "tension at which" not in line],
        "without offset": [line for line in case.warnings if "offset" not in line],
        "of type 1": [line for line in case.warnings if line.startswith("type 1")],
        "state": outcome.headline.state,
        "codes": (outcome.exit_code, findings.outcome(strict).exit_code),
        "runs": {check.run for check in case.checks},
    }


def fits(found: Any, expected: Any) -> bool:
    """Whether a part of a document is as expected."""
    match expected:
        case Mapping():
            return all(name in found and fits(found[name], part) for name, part in expected.items())
        case list():
            return len(found) == len(expected) and all(map(fits, found, expected))
        case str():
            return str(found).startswith(expected)
        case frozenset():
            return expected <= {*found}
        case _:
            return bool(found == expected)


SEPARATE = {"verdict", "fields", "memory", "inside", "warns", "silent", "absent", "why", "says"}


@pytest.mark.parametrize("name", ROWS)
def test_audit_of_a_deck(name: str, audited: Callable[[str], AuditResult]) -> None:
    result, expected = audited(name), ROWS[name][2]
    case, found = case_of(result), document(result)
    assert not any(field.verdict == "differs" for field in case.fields), case.message
    verdict = expected.get("verdict", None if "own" in expected else "explained")
    assert verdict in (None, case.verdict) and (verdict is not None or case.verdict != "differs"), case.message
    for key in expected.keys() - SEPARATE:
        assert fits(found[key], expected[key]), (key, found[key])
    inside = expected.get("inside", set())
    assert {field.verdict for field in case.fields if field.field in inside} <= PASSING
    assert inside <= found["compared"]
    for part in expected.get("warns", ()):
        assert any(part in line for line in case.warnings), (part, case.warnings)
    assert not any(expected["silent"] in line for line in case.warnings if "silent" in expected)
    assert not expected.get("absent", set()) & {*case.explained_by, *found["acts"]}
    for text, fields in expected.get("why", {}).items():
        assert {name for name, why in case.unchecked.items() if text in why} == fields
    assert expected.get("says", "") in case.message


def test_finding_that_makes_a_deck_unstable_is_the_next_command(audited: Callable[[str], AuditResult]) -> None:
    result = audited("column")
    case = case_of(result)
    assert findings.outcome(result.record).next_command == f"eos-ref findings {BUG}"
    without = result.record.model_copy(update={"cases": [case.model_copy(update={"outlook": None})]})
    unexplained = findings.outcome(without)
    assert unexplained.next_command == "" and not any(line.startswith("next") for line in unexplained.closing())
    assert field_table(case)[0].startswith("field") and field_table(case.model_copy(update={"fields": []})) == []


def test_arrays_are_of_the_finding_that_loses_atoms(audited: Callable[[str], AuditResult]) -> None:
    """At the end no atom is left whose force is wrong."""
    result = audited("column out of balance")
    shown = {check.step: check.natoms for check in case_of(result).checks if check.verdict == "explained"}
    assert int(result.arrays["step"]) == min(shown)
    assert len(result.arrays["id"]) == shown[min(shown)] > case_of(result).natoms


def test_finding_hidden_by_other_forces_concerns_most_particles(audited: Callable[[str], AuditResult]) -> None:
    case = case_of(audited("finding hidden by other forces"))
    (of,) = [of for of in case.effects if (of.finding, of.field) == (BUG, "f")]
    assert of.particles > 100
    assert any(line.startswith("f with all that adds to it: pair_style soft") for line in case.not_checked)


def test_run_before_a_minimization_is_sampled(audited: Callable[[str], AuditResult]) -> None:
    checks = case_of(audited("minimization")).checks
    assert [check.step for check in checks if (check.run, check.type) == (1, 1)] == [0, 10, 20]


def run_command(*words: object) -> tuple[int, str]:
    result = CliRunner().invoke(audit_command, [*map(str, words)], standalone_mode=False)
    assert isinstance(result.return_value, int), result.output
    return result.return_value, result.stdout


def test_suffix_of_the_command_line(tmp_path: Path) -> None:
    words: Sequence[object] = ("-sf", "kk", "--fields", "pressure", "--out", tmp_path)
    code, out = run_command(DECKS / "in.basin", *words)
    assert code == 0
    assert "\nwarning: suffix kk: this LAMMPS has no rheo/kk; RHEO's styles run without it\n" in out
    assert "-sf kk" in (tmp_path / "run.json").read_text()
    assert "this LAMMPS has no rheo/kk" in unpacked((tmp_path / "report.html").read_text())
