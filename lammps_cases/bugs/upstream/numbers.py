r"""The numbers of a test, from the reference, and the epsilon that the reference's bounds allow.

The test programs compare every component by itself: :math:`|a-b|/\min(|a|,|b|)`, or :math:`|a-b|` where one of them is
0, must be at most epsilon times a factor of the stage. With :math:`|a-b|\le B` that ratio is at most
:math:`B/(|b|-B)` for an expected number b; epsilon is the largest of these over all components, divided by the
factor of their stage, rounded up to two digits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import ROUND_UP, Decimal
from typing import Any

import numpy as np

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.eos.table import FloatArray
from lammps_cases.bugs.upstream.form import ForceTest, Program
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem, ProblemStop
from lammps_cases.comparison.trajectory import Prediction
from lammps_cases.scene.atoms import seed
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict.problems import TEXT_DIGITS, problem_of

COLUMNS = "columns"  # those of compute rheo/property/atom, reduced over all particles, as one field
VOIGT = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))  # the order of the components of a virial


@dataclass(frozen=True)
class Stage:
    """What a program compares at one point: per field of the reference its name for it, and how the state came there.

    Attributes
    ----------
    name : what is done
    checks : per field, the name under which the program compares it
    keys : per field, the key of the YAML file that holds what is expected
    factors : per field, of epsilon
    after : the steps taken
    digits : of the text file that the state was read from; None: of none
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
    """Return a stage as the reference takes it, for some of its fields: where its runs begin, and the step compared."""
    whole = problem_of(test.scene, test.atoms, test.case.where, (stage.after,))
    none = np.zeros(len(test.atoms), dtype=bool)
    begins = {"test_pair_style": (0,), "test_fix_timestep": (0, 4)}[test.program] if stage.after else ()
    stops = [ProblemStop(step, none) for step in begins]
    # What a binary file holds is the state itself, with which a first run begins as with any other but for walls.
    if stage.digits or (stage.read_back and (stops or test.scene.rheo.interface_reconstruct)):
        place = stops[-1].step if stops else 0
        new_n = np.full(len(test.atoms), stage.digits is not None)  # a restart file holds what fixes keep for walls
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
    """What a test expects by key of its YAML file, its epsilon, and the number that decides epsilon, in words."""

    values: dict[str, FloatArray]
    epsilon: float
    why: str


def expected(test: ForceTest, predictor: Predictor) -> Expected:
    """Return the numbers of a test.

    Raises
    ------
    InputError
        A component within its own rounding error of 0, which no relative precision is enough for.
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
    """Yield what the reference predicts for every stage and field, with its bound."""
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
    """Return the fields that are compared, the columns of the compute together."""
    arrays = tuple(name for name in test.scene.compare if not FIELDS[name].column)
    return (*arrays, COLUMNS) if test.columns else arrays


def reduced(table_nk: FloatArray) -> FloatArray:
    """Return the sum of squares, the minimum and the maximum of each column."""
    return np.concatenate([(table_nk**2).sum(axis=0), table_nk.min(axis=0), table_nk.max(axis=0)])


def table(test: ForceTest, fields: Mapping[str, Any]) -> FloatArray:
    """Return the columns of the compute, in their order, of fields by name."""
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
    """Return the largest value that the programs' measure of an error has within a bound."""
    size = np.abs(expected)
    with np.errstate(all="ignore"):
        ratio = np.where(size > bound, bound / (size - bound), np.inf)
    return np.where(size == 0, bound, ratio)


def error(obtained: FloatArray, expected: FloatArray) -> FloatArray:
    """Return the programs' measure of an error, component by component; infinite for what is no number."""
    difference = np.abs(obtained - expected)
    size = np.minimum(np.abs(obtained), np.abs(expected))
    with np.errstate(all="ignore"):
        ratio = np.where(size == 0, difference, difference / size)
    return np.where(np.isnan(ratio), np.inf, ratio)
