"""The kit for LAMMPS' unit tests: YAML files with the reference's numbers, data files, the input template."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.syntax.manual import MANUALS
from lammps_cases.bugs.upstream.form import COEFFICIENTS, TEMPLATE, ForceTest, shipped, template
from lammps_cases.bugs.upstream.numbers import Expected, expected
from lammps_cases.ci.kits.files import KitFile
from lammps_cases.comparison.predictor import Predictor

TESTS = "unittest/force-styles/tests"  # in LAMMPS' tree
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def date(manual: str) -> str:
    """Return the date of a version of the manual in LAMMPS' form, as 4 Jul 2026."""
    year, month, day = map(int, manual.split(".")[:3])
    return f"{day} {_MONTHS[month - 1]} {year}"


def kit_files(predictor: Predictor | None = None, chosen: Sequence[ForceTest] | None = None) -> list[KitFile]:
    """Return the files of the kit, by their paths in LAMMPS' tree."""
    predictor = predictor or Predictor()
    contents = {TEMPLATE: template()}
    for test in shipped() if chosen is None else chosen:
        contents[test.data_name] = test.data
        contents[f"{test.name}.yaml"] = yaml_text(test, expected(test, predictor))
    if any(name.startswith("fix-") for name in contents):
        contents[COEFFICIENTS] = "pair_coeff       * *\n"
    return [KitFile(f"{TESTS}/{name}", content, executable=False) for name, content in contents.items()]


def write_folder(folder: Path, files: Iterable[KitFile]) -> None:
    """Write the tests alone into a folder, without those of LAMMPS' tree around them."""
    for file in files:
        if file.path.startswith(TESTS):
            (folder / Path(file.path).name).write_text(file.content, encoding="utf-8")


def yaml_text(test: ForceTest, numbers: Expected) -> str:
    """Return a YAML file in the form that the test programs write themselves."""
    lines = [
        "---",
        f"# {test.case.about}",
        "# The numbers are those of an independent reference that follows the manual, not of a LAMMPS (eos-ref).",
        f"# epsilon: {numbers.why}",
        f"lammps_version: {date(MANUALS[-1])}",
        "tags: rheo no_respa",
        f"date_generated: by eos-ref {version('eos-ref')}",  # a time would make a new file of the same numbers
        f"epsilon: {numbers.epsilon:g}",
        "skip_tests:",
        *_block("prerequisites", test.prerequisites),
        *_block("pre_commands", test.pre_commands),
        *_block("post_commands", test.post_commands),
        f"input_file: {TEMPLATE}",
    ]
    if test.program == "test_pair_style":
        energies = [f"{when}_{of}: 0" for when in ("init", "run") for of in ("vdwl", "coul")]
        lines += [f"pair_style: {test.pair}", *_block("pair_coeff", ["* *"]), 'extract: ! ""']
        lines += [f"natoms: {len(test.atoms)}", *energies]
    else:
        lines += [f"input_coeffs: {COEFFICIENTS}", f"natoms: {len(test.atoms)}"]
    for key, values in numbers.values.items():
        count = f"{len(values)} " if key == "global_vector" else ""
        lines += [f"{key}: ! |2", *_rows(values, count)]
    return "\n".join(lines) + "\n...\n"


def _block(key: str, lines: Sequence[str]) -> list[str]:
    return [f"{key}: ! |", *(f"  {line}" for line in lines)] if lines else [f'{key}: ! ""']


def _rows(values: FloatArray, count: str) -> list[str]:
    """Return a vector on one line, behind its size if that is given, or those of all atoms, each behind its id."""
    rows = [" ".join(f"{value:23.16e}" for value in row) for row in np.atleast_2d(values)]
    return (
        [f"  {count}{row}" for row in rows]
        if values.ndim == 1
        else [f"  {n:3d} {row}" for n, row in enumerate(rows, 1)]
    )
