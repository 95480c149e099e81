"""A scene as LAMMPS' test programs take one: the commands of a YAML file, an input template, a data file.

``test_pair_style`` reads the template, sets the pair style, gives the commands of ``post_commands`` and compares forces
and virials; ``test_fix_timestep`` reads the template and a file of coefficients and compares positions and velocities
after eight steps. Source: manual, Developer_unittest, and what the programs print.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import Literal

from eos_ref.syntax.manual import MANUALS
from lammps_cases.bugs.deck import data_file
from lammps_cases.engine.session import Job
from lammps_cases.records.files import DATA
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.atoms import Atoms, build
from lammps_cases.scene.casefile import Case
from lammps_cases.setup import commands
from lammps_cases.setup.plan import plan

SCENES = [DATA / "upstream" / f"{of}.yaml" for of in ("compute", "density", "fix", "pair", "walls")]
TEMPLATE, COEFFICIENTS = "in.rheo", "coeffs.rheo"
WRITE_DATA = "write_data_pair"  # the variable of test_pair_style behind its ``write_data FILE pair``; ii by default
MODES = ("sumsq", "min", "max")  # of a column over all particles; sums of conserved fields are rounding alone
Program = Literal["test_pair_style", "test_fix_timestep"]
PREFIX: dict[Program, str] = {"test_pair_style": "atomic-pair-rheo_", "test_fix_timestep": "fix-timestep-rheo_"}
# What the template leaves to a test, and its value unless the test gives another one.
VARIABLES = {
    "newton_pair": "on",
    "newton_bond": "${newton_pair}",
    "units": "lj",
    "dimension": "2",
    "boundary": "p p p",
    "atom_style": "rheo",
    "input_dir": ".",
    "data_file": "${input_dir}/data.rheo",
    "pair_style": "zero 3.0",
}


@dataclass(frozen=True)
class ForceTest:
    """A test: the case that it is made of, its particles, and the commands of its YAML file.

    Attributes
    ----------
    job : what LAMMPS is given of the scene elsewhere, from which the commands are taken
    data_name : the data file, which tests of the same particles share
    """

    case: Case
    atoms: Atoms
    job: Job
    data_name: str

    @property
    def scene(self) -> Scene:
        """Return the scene."""
        return self.case.scene

    @property
    def program(self) -> Program:
        """Return the test program that takes it: that of the fields compared."""
        return "test_pair_style" if "f" in self.scene.compare else "test_fix_timestep"

    @property
    def name(self) -> str:
        """Return the name of its file, without the ending."""
        return PREFIX[self.program] + self.case.name.partition(".")[2].replace("-", "_").replace(".", "_")

    @property
    def variables(self) -> dict[str, str]:
        """Return the variables of the template that it gives another value."""
        given = {words[0]: " ".join(words[1:]) for words in map(str.split, self.job.setup)}
        own = {name: given[name] for name in ("units", "dimension", "boundary", "atom_style")}
        own["data_file"] = "${input_dir}/" + self.data_name
        return {name: text for name, text in own.items() if VARIABLES[name] != text}

    @property
    def pre_commands(self) -> tuple[str, ...]:
        """Return the commands before the template is read.

        A variable of ``test_pair_style`` ends its write_data: with nofix LAMMPS reads reconstructed walls back.
        """
        walls = self.program == "test_pair_style" and self.scene.rheo.interface_reconstruct
        given = {**self.variables, **({WRITE_DATA: "ii nofix"} if walls else {})}
        return tuple(f"variable {name} index {_quoted(text)}" for name, text in given.items())

    @property
    def pair(self) -> str:
        """Return the arguments of the pair style."""
        return next(line.partition(" ")[2] for line in self.job.commands if line.startswith("pair_style"))

    @property
    def post_commands(self) -> tuple[str, ...]:
        """Return the commands before a run: what a restart file does not keep, the time step, the fixes."""
        neighbours = [line for line in self.job.setup if line.startswith(("comm_modify", "neighbor"))]
        left_out = ["mass ", "set "]  # these are in the data file
        if self.program == "test_pair_style":  # which has keys of its own for the pair style
            lines = [line for line in self.job.commands if not line.startswith((*left_out, "pair_"))]
            return (*neighbours, *lines)
        lines = [line for line in self.job.commands if not line.startswith((*left_out, "timestep"))]
        return (*neighbours, *(line.replace(f"fix {self.tested} ", "fix test ") for line in lines), *self.reductions)

    @property
    def tested(self) -> str:
        """Return the id, elsewhere, of the fix that is tested: the first word of the case's label."""
        return self.case.name.partition(".")[2].partition("-")[0]

    @property
    def columns(self) -> int:
        """Return how many columns of compute rheo/property/atom are compared."""
        return sum(math.prod(shape) for shape in self.job.outputs.values())

    @property
    def reductions(self) -> tuple[str, ...]:
        """Return the commands by which a fix, the one tested, has a global vector of the columns of the compute."""
        if not self.columns:
            return ()
        columns = " ".join(f"c_q[{k}]" for k in range(1, self.columns + 1)) if self.columns > 1 else "c_q"
        reduced = (f"compute {mode} all reduce {mode} {columns}" for mode in MODES)
        values = " ".join(f"c_{mode}[*]" for mode in MODES) if self.columns > 1 else " ".join(f"c_{m}" for m in MODES)
        return (*reduced, f"fix test all ave/time 1 1 1 {values}")

    @property
    def prerequisites(self) -> tuple[str, ...]:
        """Return the styles that it needs, each with its kind."""
        (style,) = (line.split()[1] for line in self.job.setup if line.startswith("atom_style"))
        fixes = [line.split()[3] for line in self.post_commands if line.startswith("fix ")]
        computes = [line.split()[3] for line in self.post_commands if line.startswith("compute ")]
        kinds = {"fix": fixes, "compute": computes}
        return (f"atom {style}", "pair rheo", *dict.fromkeys(f"{kind} {n}" for kind, of in kinds.items() for n in of))

    @property
    def data(self) -> str:
        """Return the data file."""
        solid_n = [int(self.scene.types[t - 1].phase == "solid") for t in self.atoms.type_n]
        return data_file(self.job, [t.mass for t in self.scene.types], solid_n)


def _quoted(text: str) -> str:
    return f"'{text}'" if " " in text else text


def template() -> str:
    """Return the input template, in the form of the others of the folder."""
    words = [f"variable  {name:11s} index  {_quoted(text)}" for name, text in VARIABLES.items()]
    lines = (
        "units            ${units}",
        "dimension        ${dimension}",
        "boundary         ${boundary}",
        "atom_style       ${atom_style}",
        "atom_modify      map array",
        "newton           ${newton_pair} ${newton_bond}",
        "pair_style       ${pair_style}",
        "read_data        ${data_file}",
    )
    return "\n".join((*words, "", *lines, ""))


@functools.cache
def shipped() -> tuple[ForceTest, ...]:
    """Return all tests, by the newest manual."""
    names: dict[str, str] = {}
    cases = (case for path in SCENES for case in casefile.load_file(path))
    return tuple(_named(of_case(case), names) for case in cases)


def of_case(case: Case) -> ForceTest:
    """Return the test of a case; its random numbers are those of its dimension, so that tests share particles."""
    case = with_manual(case)
    scene = case.scene
    seeded = replace(case, name=f"rheo {scene.dimension}d")
    atoms = build(seeded, scene.eos(case.where))
    # Virials are read without computes of their own, which the test programs do not have.
    plain = scene.model_copy(update={"compare": tuple(name for name in scene.compare if name != "virial")})
    job = commands.job(plain, atoms, plan(plain))
    return ForceTest(case, atoms, job, "")


def with_manual(case: Case) -> Case:
    """Return a case by the newest manual, which is that of LAMMPS' tree."""
    return replace(case, scene=case.scene.model_copy(update={"manual": MANUALS[-1]}))


def _named(test: ForceTest, names: dict[str, str]) -> ForceTest:
    """Return a test with the name of its data file: that of an earlier test of the same particles, or the next."""
    return replace(test, data_name=names.setdefault(test.data, f"data.rheo_{len(names) + 1}"))
