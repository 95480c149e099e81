"""LAMMPS' own test programs on the tests of the kit: the checks that fail, and the findings that explain them.

The same commands are given to LAMMPS' Python module, in the order of the programs, and each stage is compared:
forces and the virial after ``run 0`` and four steps, with newton on and off, after a restart, with ``pair_modify
nofdotr``, from a data file; or positions and velocities after eight steps.

``python -m lammps_cases.bugs.upstream.programs TREE`` builds them for a source tree with a serial build of LAMMPS in
its folder ``build`` (a C++ compiler, googletest and libyaml: Debian's libgmock-dev and libyaml-dev), runs them, and
writes the outcome into measured.json and the table of docs/upstream.md.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from eos_ref import InputError
from lammps_cases.bugs.upstream.files import kit_files, write_folder
from lammps_cases.bugs.upstream.force_tests import (
    COEFFICIENTS,
    COLUMNS,
    STAGES,
    TEMPLATE,
    WRITE_DATA,
    Expected,
    ForceTest,
    Program,
    Stage,
    compared,
    error,
    expected,
    problem,
    reduced,
    shipped,
    shown,
    table,
)
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.problem import Problem
from lammps_cases.engine import installations
from lammps_cases.engine.reading import Array, Compute, read, read_list
from lammps_cases.engine.session import Session, translated
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.records.files import DATA, write_atomically
from lammps_cases.scene.fields import FIELDS
from lammps_cases.verdict import particle_model

TIME_LIMIT = 60.0  # seconds for a test; they take 0.1
VIRIAL = Compute("own_virial", True, True)
Looks = dict[str, dict[str, Any]]  # observations by stage
INCLUDE = ("src", "third_party", "src/STUBS")  # of a tree; the stubs replace MPI
PAGE = Path("docs/upstream.md")
MEASURED = DATA / "upstream" / "measured.json"
MARKS = "<!-- measured -->", "<!-- end -->"
FAILURE = re.compile(r"^\S+/(\w+)\.cpp:(\d+): Failure$", re.M)  # source and line
TRACE = re.compile(r"EXPECT_\w+: (.+)$", re.M)  # the check of a failure
By = dict[str, tuple[str, ...]]  # findings, by check that fails


@dataclass(frozen=True)
class Commands:
    """Commands that a test program takes from a YAML file."""

    program: Program
    before: tuple[str, ...]
    pair: str
    after: tuple[str, ...]
    outputs: dict[str, tuple[int, ...]]

    @classmethod
    def of(cls, test: ForceTest) -> Commands:
        """Return the commands of a test."""
        return cls(test.program, test.pre_commands, test.pair, test.post_commands, dict(test.job.outputs))


def replay(site: str | None, given: Commands, folder: str) -> Looks:
    """Replay a test in a worker; the files of the kit lie in a folder.

    Raises
    ------
    EngineRefused
    """
    with translated():
        return {"test_pair_style": _pair, "test_fix_timestep": _fix}[given.program](site, given, Path(folder))


def _pair(site: str | None, given: Commands, folder: Path) -> Looks:
    looks: Looks = {}
    for newton in ("on", "off"):
        with Session(site) as lmp:
            _each(lmp, f"variable newton_pair index {newton}", f"variable input_dir index {folder}", *given.before)
            lmp.file(str(folder / TEMPLATE))
            _each(lmp, f"pair_style {given.pair}", "pair_coeff * *", "pair_modify table 0", "pair_modify table/disp 0")
            looks[f"newton {newton}"] = _looked(lmp, *given.after)
            _each(lmp, f"write_restart {folder}/test.restart", f"variable {WRITE_DATA} index ii")
            lmp.command(f"write_data {folder}/test.data pair ${{{WRITE_DATA}}}")
            _each(lmp, "thermo_style custom step temp pe press", "thermo 2", "fix 1 all nve")
            looks[f"newton {newton}, 4 steps"] = _looked(lmp, run=4, defined=True)
    for stage, more in (("restart", ()), ("nofdotr", ("pair_modify nofdotr",))):
        with Session(site) as lmp:
            _each(lmp, "newton on", f"read_restart {folder}/test.restart")
            _each(lmp, f"pair_style {given.pair}", "pair_coeff * *")
            looks[stage] = _looked(lmp, *given.after, *more)
    with Session(site) as lmp:
        _each(lmp, f"variable input_dir index {folder}", f"variable data_file index {folder}/test.data")
        _each(lmp, *(line for line in given.before if " data_file " not in line))
        _each(lmp, f"variable pair_style index '{given.pair}'")
        lmp.file(str(folder / TEMPLATE))
        looks["data"] = _looked(lmp, "pair_coeff * *", *given.after)
    return looks


def _fix(site: str | None, given: Commands, folder: Path) -> Looks:
    looks: Looks = {}
    half = "run 4 post no start 0 stop 8"
    with Session(site) as lmp:
        _each(lmp, f"variable input_dir index {folder}", *given.before)
        lmp.file(str(folder / TEMPLATE))
        lmp.file(str(folder / COEFFICIENTS))
        _each(lmp, *given.after, "timestep 0.25", "run 0 post no", "thermo 2", half)
        _each(lmp, f"write_restart {folder}/test.restart", half)
        looks["normal run"] = _seen(lmp, given)
    for stage, rmass in (("restart", False), ("rmass", True)):
        with Session(site) as lmp:
            lmp.command(f"read_restart {folder}/test.restart")
            if rmass:
                mass_t = lmp.numpy.extract_atom("mass")[1 : lmp.extract_global("ntypes") + 1].tolist()
                lmp.command("fix rmass all property/atom rmass ghost yes")
                _each(lmp, *(f"set type {t} mass {mass:g}" for t, mass in enumerate(mass_t, 1)))
            _each(lmp, *given.after, "timestep 0.25", "thermo 2", half)
            looks[stage] = _seen(lmp, given)
    return looks


def _seen(lmp: Any, given: Commands) -> dict[str, Any]:
    return read(lmp, given.outputs, ("x", "v"))


def _each(lmp: Any, *commands: str) -> None:
    for command in commands:
        lmp.command(command)


def _looked(lmp: Any, *commands: str, run: int = 0, defined: bool = False) -> dict[str, Any]:
    """Execute commands and run; return the arrays of atoms, the virial, and the list of neighbours."""
    _each(lmp, *commands)
    if not defined:
        lmp.command(f"compute {VIRIAL.id} all pressure NULL virial")
    lmp.command(f"run {run} post no")
    return read(lmp, atom_arrays=("f", "x", "v"), computes=(VIRIAL,)) | {"list": read_list(lmp)}


def failing(test: ForceTest, numbers: Expected, looks: Looks) -> Iterator[tuple[Stage, str]]:
    """Yield the stages and fields whose errors, in the program's measure, exceed its limit."""
    for stage in STAGES[test.program]:
        for field, key in ((field, stage.keys[field]) for field in compared(test)):
            obtained = _obtained(test, field, looks[stage.name])
            allowed = numbers.epsilon * stage.factors[field]
            if not (error(obtained, numbers.values[key]) <= allowed).all():
                yield stage, field


def explained(
    test: ForceTest, stage: Stage, field: str, look: dict[str, Any], engine: str, predictor: Predictor
) -> tuple[str, ...]:
    """Return the findings that together reproduce a field at a stage on every atom; empty if none do."""
    fields = tuple(test.job.outputs) if field == COLUMNS else (field,)
    of = problem(test, stage, fields)
    snapshot = {name: _field(test, name, look) for name in fields} | _lists(stage, of, look)
    reason = particle_model.reason(of, test.case.name, look["id"], [snapshot], engine, predictor)
    return tuple(entry.id for entry in reason.explained) if reason else ()


def _lists(stage: Stage, of: Problem, look: dict[str, Any]) -> dict[str, Any]:
    """Return LAMMPS' list of neighbours for every evaluation of particles at rest; empty for moving ones."""
    if "list" not in look:
        return {}
    evaluations = stage.after + len(of.stops) + 1
    # With nofdotr LAMMPS sums the virials of its pairs, as it does with newton off.
    newton = look["list"]["newton"] & (stage.name != "nofdotr")
    return {"lists": (NeighbourList.read(look["id"], **look["list"] | {"newton": newton}),) * evaluations}


def _obtained(test: ForceTest, field: str, look: dict[str, Any]) -> Array:
    """Return a field in the form of the YAML file."""
    if field == COLUMNS:
        return reduced(table(test, {name: _field(test, name, look) for name in test.job.outputs}))
    return shown(test, field, _field(test, field, look))


def _field(test: ForceTest, field: str, look: dict[str, Any]) -> Array:
    return np.asarray(FIELDS[field].of(look, test.scene.dimension))


class Measured(BaseModel):
    """Results of the test programs for a LAMMPS: for each test the checks that fail, each with its findings."""

    lammps: str
    tests: dict[str, By]


def build(tree: Path, folder: Path) -> None:
    """Build only the two test programs, for the library of a tree.

    Raises
    ------
    InputError
        The tree has no library, or the compiler refuses.
    """
    library, own = tree / "build", tree / "unittest"
    if not (library / "liblammps.so").is_file():
        raise InputError("tree", "must hold build/liblammps.so", where=str(tree))
    include = [f"-I{place}" for place in (own, own / "force-styles", *(tree / of for of in INCLUDE))]
    defined = ["-DLAMMPS_SMALLBIG", "-DLAMMPS_MEMALIGN=64", f"-DTEST_INPUT_FOLDER={own / 'force-styles' / 'tests'}"]
    names = ["../yaml_writer", "../error_stats", "test_config_reader", "test_main"]
    for name in (*names, *STAGES):
        source = own / "force-styles" / f"{name}.cpp"
        _compile("-O1", "-std=c++17", *defined, *include, "-c", str(source), "-o", str(folder / f"{source.stem}.o"))
    shared = [str(folder / f"{Path(name).name}.o") for name in names]
    for name in STAGES:
        linked = [f"-L{library}", f"-Wl,-rpath,{library}", "-llammps", "-lgmock", "-lgtest", "-lyaml", "-lpthread"]
        _compile(str(folder / f"{name}.o"), *shared, *linked, "-o", str(folder / name))


def _compile(*arguments: str) -> None:
    done = subprocess.run(["c++", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        error = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip())
        raise InputError("test program", f"must compile: {error}", where=arguments[-1])


def untraced(tree: Path) -> dict[int, str]:
    """Return the checks that failures do not name, by their lines in the source of test_fix_timestep, in order."""
    lines = (tree / "unittest" / "force-styles" / "test_fix_timestep.cpp").read_text(encoding="utf-8").splitlines()
    at = [n for n, line in enumerate(lines, 1) if "EXPECT_FP_LE_WITH_EPS(test_config.global_vector[i]," in line]
    return dict(zip(at, (stage.checks[COLUMNS] for stage in STAGES["test_fix_timestep"]), strict=False))


def failed_checks(program: Path, file: Path, lines: Mapping[int, str]) -> set[str]:
    """Run a test program on a file of the folder of all tests; return the failed checks, by lines if necessary.

    Raises
    ------
    InputError
        The program ends without tests passed or failed, or a failure belongs to no check.
    """
    done = subprocess.run(
        [str(program), str(file), "-d", str(file.parent)],
        cwd=file.parent,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=TIME_LIMIT,
        check=False,
    )
    _, *failures = FAILURE.split(done.stdout)
    failed = set[str]()
    for line, output in zip(failures[1::3], failures[2::3], strict=True):
        trace = TRACE.search(output)
        failed.add(trace[1] if trace else lines.get(int(line), ""))
    ended = done.returncode in (0, 1) and "[  PASSED  ]" in done.stdout and bool(done.returncode) == bool(failed)
    if not ended or "" in failed:
        last = (done.stderr or done.stdout).strip().splitlines()[-1:]
        raise InputError("test program", f"must end with what passed and failed: {' '.join(last)}", where=str(file))
    return failed


def replayed(chosen: Iterable[ForceTest], folder: Path, workers: Workers, engine: str) -> Mapping[str, By]:
    """Run tests, whose files lie in a folder, by LAMMPS' Python module; return the failed checks, with findings.

    Raises
    ------
    InputError
        LAMMPS does not run a test.
    """
    predictor, findings = Predictor(), dict[str, By]()
    for test in chosen:
        looks = workers.outcome(workers.call(replay, Commands.of(test), str(folder), time_limit=TIME_LIMIT))
        if isinstance(looks, Failure):
            raise InputError("test", f"must run: {looks.message}", test.name)
        numbers = expected(test, predictor)
        findings[test.name] = {
            stage.checks[field]: explained(test, stage, field, looks[stage.name], engine, predictor)
            for stage, field in failing(test, numbers, looks)
        }
    return findings


def measure(tree: Path) -> Measured:
    """Run all tests by the programs of a tree and by LAMMPS' Python module, whose results must agree.

    Raises
    ------
    InputError
        They disagree.
    """
    site = installations.resolve(f"path:{tree}").site
    with tempfile.TemporaryDirectory() as place, Workers(site, 1) as workers:
        folder = Path(place)
        build(tree, folder)
        write_folder(folder, kit_files())
        who = workers.outcome(workers.identify())
        if isinstance(who, Failure):
            raise InputError("engine", f"must start: {who.message}", where=str(tree))
        findings = replayed(shipped(), folder, workers, who["distribution"])
        for test in shipped():
            failed = failed_checks(folder / test.program, folder / f"{test.name}.yaml", untraced(tree))
            if failed != set(findings[test.name]):
                other = sorted(failed ^ set(findings[test.name]))
                raise InputError("test program", "must fail where LAMMPS' Python module does", other, test.name)
    return Measured(lammps=who["distribution"], tests=dict(findings))


def measured() -> Measured:
    """Return the latest measurement."""
    return Measured.model_validate_json(MEASURED.read_text(encoding="utf-8"))


def text(result: Measured) -> str:
    """Return a measurement as a file with a line for every test."""
    lines = [f"  {json.dumps(name)}: {json.dumps(by)}" for name, by in result.tests.items()]
    return f'{{\n "lammps": {json.dumps(result.lammps)},\n "tests": {{\n' + ",\n".join(lines) + "\n }\n}\n"


def summary_table(result: Measured) -> str:
    """Return a measurement as a table: the tests that fail in the same way, the checks, and the findings."""
    groups: dict[str, list[str]] = {}
    for name, by in result.tests.items():
        groups.setdefault(json.dumps(by), []).append(name)
    rows = ["| tests | checks that fail | by |", "|---|---|---|"]
    for key, names in sorted(groups.items(), key=lambda group: len(json.loads(group[0]))):
        of_findings: dict[tuple[str, ...], list[str]] = {}
        for check, ids in json.loads(key).items():
            of_findings.setdefault(tuple(ids), []).append(check)
        first = _pattern(names, list(result.tests))
        for ids, failed in of_findings.items() or [((), ["none"])]:
            rows.append(f"| {first} | {', '.join(failed)} | {', '.join(f'`{name}`' for name in ids)} |")
            first = ""
    return "\n".join(rows)


def _pattern(names: list[str], every: list[str]) -> str:
    """Return the number of tests of a group, and the words that only their names hold, else the names."""
    every = [name for name in every if name.partition("_")[0] == names[0].partition("_")[0]]
    words = {name: set(name.split("_")[1:]) for name in every}
    own = set().union(*(words[name] for name in names))
    tails = [name.partition("_")[2] for name in names]
    in_both = {tail[:-3] for tail in tails if {tail[:-3] + "_2d", tail[:-3] + "_3d"} <= set(tails)}
    short = dict.fromkeys(f"`{tail[:-3]}_*`" if tail[:-3] in in_both else f"`{tail}`" for tail in tails)
    shortest = ", ".join(short)
    for word in sorted(own) if len(names) > 1 else ():
        others = [words[name] for name in every if word in words[name] and name not in names]
        unlike = sorted(set().union(*others) - own)
        if all(word in words[name] for name in names) and all(other & set(unlike) for other in others):
            without = f" without {', '.join(f'`{other}`' for other in unlike)}" if unlike else ""
            shortest = min(shortest, f"all of `{word}`{without}", key=len)
    return f"{len(names)} of `{names[0].partition('_')[0]}`: {shortest}"


def updated(page: str, result: Measured) -> str:
    """Return a page with the table between its marks."""
    begin, end = MARKS
    before, _, rest = page.partition(begin)
    return f"{before}{begin}\n\n{summary_table(result)}\n\n{end}{rest.partition(end)[2]}"


if __name__ == "__main__":
    from lammps_cases.bugs.upstream import programs  # workers find `replay` by this name, but not in __main__

    result = programs.measure(Path(sys.argv[1]).resolve())
    write_atomically(MEASURED, text(result))
    PAGE.write_text(updated(PAGE.read_text(encoding="utf-8"), result), encoding="utf-8")
