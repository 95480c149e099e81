r"""A scene for LAMMPS' test programs: the commands of a YAML file, an input template, a data file.

``test_pair_style`` reads the template, sets the pair style, executes ``post_commands`` and compares forces
and virials; ``test_fix_timestep`` reads the template and a file of coefficients and compares positions and velocities
after eight steps. Source: manual, Developer_unittest, and the programs' output.

The numbers are the reference's, and epsilon follows from its bounds. The programs compare every component separately:
:math:`|a-b|/\min(|a|,|b|)`, or :math:`|a-b|` where one of them is 0, must be at most epsilon times a factor of the
stage. With :math:`|a-b|\le B` that ratio is at most :math:`B/(|b|-B)` for an expected number b; epsilon is the largest
of these over all components, divided by the factor of their stage, rounded up to two digits.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import ROUND_UP, Decimal
from typing import Any, Literal

import numpy as np

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from eos_ref.syntax.manual import MANUALS
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.engine.session import Job
from lammps_cases.records.files import DATA
from lammps_cases.scene import Scene, casefile
from lammps_cases.scene.atoms import Atoms, build, seed
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.fields import FIELDS
from lammps_cases.setup import commands
from lammps_cases.setup.deck import data_file
from lammps_cases.setup.plan import plan
from lammps_cases.verdict.problems import TEXT_DIGITS, problem_of

SCENES = [DATA / "upstream" / f"{of}.yaml" for of in ("compute", "density", "fix", "pair", "walls")]
OWN = "eosref"  # in the name of every file and folder for LAMMPS' tree, which has files of its own for RHEO
TEMPLATE, COEFFICIENTS = f"in.{OWN}", f"coeffs.{OWN}"
WRITE_DATA = "write_data_pair"  # the variable of test_pair_style after its ``write_data FILE pair``; ii by default
MODES = ("sumsq", "min", "max")  # of a column over all particles; sums of conserved fields are rounding alone
Program = Literal["test_pair_style", "test_fix_timestep"]
PREFIX: dict[Program, str] = {"test_pair_style": f"atomic-pair-{OWN}_", "test_fix_timestep": f"fix-timestep-{OWN}_"}
# Variables of the template that a test may set, and their defaults.
VARIABLES = {
    "newton_pair": "on",
    "newton_bond": "${newton_pair}",
    "units": "lj",
    "dimension": "2",
    "boundary": "p p p",
    "atom_style": "rheo",
    "input_dir": ".",
    "data_file": f"${{input_dir}}/data.{OWN}",
    "pair_style": "zero 3.0",
}
COLUMNS = "columns"  # those of compute rheo/property/atom, reduced over all particles, as one field
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the order of the components of a virial


@dataclass(frozen=True)
class ForceTest:
    """A test: its case, its particles, and the commands of its YAML file.

    Attributes
    ----------
    job : the job of the scene elsewhere, from which the commands are taken
    data_name : the data file, shared by tests of the same particles
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
        """Return the test program for it, by the compared fields."""
        return "test_pair_style" if "f" in self.scene.compare else "test_fix_timestep"

    @property
    def name(self) -> str:
        """Return the name of its file, without the ending."""
        return PREFIX[self.program] + self.case.name.partition(".")[2].replace("-", "_").replace(".", "_")

    @property
    def variables(self) -> dict[str, str]:
        """Return the variables of the template that it sets."""
        given = {words[0]: " ".join(words[1:]) for words in map(str.split, self.job.setup)}
        own = {name: given[name] for name in ("units", "dimension", "boundary", "atom_style")}
        own |= dict(zip(("newton_pair", "newton_bond"), given.get("newton", "").split(), strict=False))
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
        """Return the commands before a run: settings that a restart file does not keep, the time step, the fixes."""
        kept = ("comm_modify", "neighbor", "neigh_modify", "atom_modify sort")
        neighbours = [line for line in self.job.setup if line.startswith(kept)]
        left_out = ["mass ", "set "]  # these are in the data file
        if self.program == "test_pair_style":  # which has separate keys for the pair style
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
        """Return the number of compared columns of compute rheo/property/atom."""
        return sum(math.prod(shape) for shape in self.job.outputs.values())

    @property
    def reductions(self) -> tuple[str, ...]:
        """Return the commands that give the tested fix a global vector of the columns of the compute."""
        if not self.columns:
            return ()
        columns = " ".join(f"c_q[{k}]" for k in range(1, self.columns + 1)) if self.columns > 1 else "c_q"
        reduced = (f"compute {mode} all reduce {mode} {columns}" for mode in MODES)
        values = " ".join(f"c_{mode}[*]" for mode in MODES) if self.columns > 1 else " ".join(f"c_{m}" for m in MODES)
        return (*reduced, f"fix test all ave/time 1 1 1 {values}")

    @property
    def prerequisites(self) -> tuple[str, ...]:
        """Return the required styles, each with its kind."""
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
    """Return the input template, in the form of the other templates of the folder."""
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
    """Return the test of a case; random numbers depend only on its dimension, so that tests share particles."""
    case = with_manual(case)
    scene = case.scene
    seeded = replace(case, name=f"rheo {scene.dimension}d")
    atoms = build(seeded, scene.eos(case.where))
    # Virials are read without separate computes, which the test programs do not have.
    plain = scene.model_copy(update={"compare": tuple(name for name in scene.compare if name != "virial")})
    job = commands.job(plain, atoms, plan(plain))
    return ForceTest(case, atoms, job, "")


def with_manual(case: Case) -> Case:
    """Return a case with the newest manual, which is that of LAMMPS' tree."""
    return replace(case, scene=case.scene.model_copy(update={"manual": MANUALS[-1]}))


def _named(test: ForceTest, names: dict[str, str]) -> ForceTest:
    """Return a test with the name of its data file: that of an earlier test of the same particles, or the next."""
    return replace(test, data_name=names.setdefault(test.data, f"data.{OWN}_{len(names) + 1}"))


@dataclass(frozen=True)
class Stage:
    """A comparison of a program: its name for each field of the reference, and the origin of the state.

    Attributes
    ----------
    name : what the program does
    checks : per field, its name in the program
    keys : per field, the key of the YAML file with the expected numbers
    factors : per field, of epsilon
    after : the steps taken
    digits : of the text file that the state was read from; None: no text file
    read_back : whether the state was read from a file
    """

    name: str
    checks: dict[str, str]
    keys: dict[str, str]
    factors: dict[str, int]
    after: int = 0
    digits: int | None = None
    read_back: bool = False


def _pair(name: str, check: str, forces: int = 1, stress: int = 1, **more: Any) -> Stage:
    when = "run" if more.get("after") else "init"
    what = {"f": "forces", "virial": "stress"}
    checks, keys = ({field: text.format(of) for field, of in what.items()} for text in (check, when + "_{}"))
    return Stage(name, checks, keys, {"f": forces, "virial": stress}, **more)


def _fix(name: str, read_back: bool = True) -> Stage:
    keys = {"x": "run_pos", "v": "run_vel", COLUMNS: "global_vector"}
    checks = {field: f"{key} ({name}, verlet)" for field, key in keys.items()}
    return Stage(name, checks, keys, dict.fromkeys(keys, 1), after=8, read_back=read_back)


STAGES: dict[Program, tuple[Stage, ...]] = {
    "test_pair_style": (
        _pair("newton on", "init_{} (newton on)"),
        _pair("newton on, 4 steps", "run_{} (newton on)", forces=5, after=4),
        _pair("newton off", "init_{} (newton off)", stress=3),
        _pair("newton off, 4 steps", "run_{} (newton off)", forces=5, after=4),
        _pair("restart", "restart_{}", read_back=True),
        _pair("nofdotr", "nofdotr_{}", read_back=True),
        _pair("data", "data_{}", read_back=True, digits=TEXT_DIGITS),
    ),
    "test_fix_timestep": (_fix("normal run", read_back=False), _fix("restart"), _fix("rmass")),
}


def problem(test: ForceTest, stage: Stage, fields: tuple[str, ...] = ()) -> Problem:
    """Return a stage for the reference, with some of its fields: where its runs begin, and the compared step."""
    whole = problem_of(test.scene, test.atoms, test.case.where, (stage.after,))
    none = np.zeros(len(test.atoms), dtype=bool)
    begins = {"test_pair_style": (0,), "test_fix_timestep": (0, 4)}[test.program] if stage.after else ()
    stops = [ProblemStop(step, none) for step in begins]
    # A binary file holds the state itself, with which a first run begins as with any other, except for walls.
    if stage.digits or (stage.read_back and (stops or test.scene.rheo.interface_reconstruct)):
        place = stops[-1].step if stops else 0
        new_n = np.full(len(test.atoms), stage.digits is not None)  # a restart file holds the data of fixes for walls
        stops = [*stops[:-1], ProblemStop(place, new_n, read_back=True, digits=stage.digits)]
    return replace(whole, fields=fields or test.scene.compare, stops=tuple(stops))


def shown(test: ForceTest, field: str, values: FloatArray) -> FloatArray:
    """Return a field in the columns of the YAML file: three components per particle, or six of the whole virial."""
    padded = np.zeros((len(values), *(3,) * (values.ndim - 1)))
    padded[tuple(map(slice, values.shape))] = values
    if field != "virial":
        return padded
    volume = math.prod(test.atoms.box(test.scene.dimension).edge_c)
    return volume * np.array([padded[0][at] for at in VOIGT])


@dataclass(frozen=True)
class Expected:
    """The expected numbers of a test by key of its YAML file, its epsilon, and the number that decides it, in words."""

    values: dict[str, FloatArray]
    epsilon: float
    why: str


def expected(test: ForceTest, predictor: Predictor) -> Expected:
    """Return the numbers of a test.

    Raises
    ------
    InputError
        A component within its rounding error of 0, for which no relative precision is enough.
    """
    values: dict[str, FloatArray] = {}
    worst, why = 0.0, ""
    for stage, field, value, bound in _predicted(test, predictor):
        key = stage.keys[field]
        values.setdefault(key, value)
        ratio = relative(value, bound) / stage.factors[field]
        if not np.isfinite(ratio).all():
            raise InputError("test", f"has a component of {key} that rounding alone could make 0", test.name)
        if ratio.max() > worst:
            at = np.unravel_index(int(ratio.argmax()), ratio.shape)
            place = f" of atom {at[0] + 1}" if value.ndim > 1 else ""
            worst = float(ratio.max())
            why = (
                f"component {at[-1] + 1} of {key}{place} ({stage.name}) is {value[at]:.3e} within {bound[at]:.1e}"
                f"{f', compared with {stage.factors[field]} epsilon' * (stage.factors[field] > 1)}"
            )
    digits = Decimal(worst)
    epsilon = float(digits.quantize(Decimal(1).scaleb(digits.adjusted() - 1), rounding=ROUND_UP))
    return Expected(values, epsilon, why)


def _predicted(test: ForceTest, predictor: Predictor) -> Iterator[tuple[Stage, str, FloatArray, FloatArray]]:
    for stage in STAGES[test.program]:
        prediction = predictor.predict(problem(test, stage), seed=seed(f"{test.case.name}/moved runs"))
        for field in compared(test):
            if field == COLUMNS:
                yield stage, field, *_reduced(test, prediction)
                continue
            value, bound = (np.asarray(of[0][field]) for of in (prediction.fields, prediction.bounds))
            bound = shown(test, field, np.broadcast_to(bound, value.shape))
            value = shown(test, field, value)
            if field == "x" and not np.all((value >= test.atoms.low_c) & (value < test.atoms.high_c)):
                raise InputError("test", "must keep its particles in the box, as LAMMPS wraps positions", test.name)
            # The product with the volume rounds once here and once more, with the factor of units, in LAMMPS.
            yield stage, field, value, bound + (3 * EPS * np.abs(value) if field == "virial" else 0.0)


def compared(test: ForceTest) -> tuple[str, ...]:
    """Return the compared fields, the columns of the compute together."""
    arrays = tuple(name for name in test.scene.compare if not FIELDS[name].column)
    return (*arrays, COLUMNS) if test.columns else arrays


def reduced(table_nk: FloatArray) -> FloatArray:
    """Return the sum of squares, the minimum and the maximum of each column."""
    return np.concatenate([(table_nk**2).sum(axis=0), table_nk.min(axis=0), table_nk.max(axis=0)])


def table(test: ForceTest, fields: Mapping[str, Any]) -> FloatArray:
    """Return the columns of the compute, in order, from fields by name."""
    columns = [np.asarray(fields[name], float).reshape(len(test.atoms), -1) for name in test.job.outputs]
    return np.concatenate(columns, axis=1)


def _reduced(test: ForceTest, prediction: Prediction) -> tuple[FloatArray, FloatArray]:
    """Return the reduced columns with their bounds: a sum rounds once for every term, in any order."""
    fields = prediction.fields[0]
    of_fields = {name: np.broadcast_to(prediction.bounds[0][name], np.shape(fields[name])) for name in test.job.outputs}
    table_nk, bound_nk = table(test, fields), table(test, of_fields)
    of_squares = (bound_nk * (2 * np.abs(table_nk) + bound_nk)).sum(axis=0)
    of_sum = of_squares + 2 * (len(table_nk) + 1) * EPS * (table_nk**2).sum(axis=0)
    return reduced(table_nk), np.concatenate([of_sum, bound_nk.max(axis=0), bound_nk.max(axis=0)])


def relative(expected: FloatArray, bound: FloatArray) -> FloatArray:
    """Return the largest error, in the programs' measure, within a bound."""
    size = np.abs(expected)
    with np.errstate(all="ignore"):
        ratio = np.where(size > bound, bound / (size - bound), np.inf)
    return np.where(size == 0, bound, ratio)


def error(obtained: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the programs' measure of an error, component by component; infinite for NaN."""
    difference = np.abs(obtained - expected)
    size = np.minimum(np.abs(obtained), np.abs(expected))
    with np.errstate(all="ignore"):
        ratio = np.where(size == 0, difference, difference / size)
    return np.where(np.isnan(ratio), np.inf, ratio)
