"""`run`, `audit` and `compare` as functions: the commands' own results, as tables and ase.Atoms, nothing printed."""

from __future__ import annotations

import csv
import html
import inspect
import json
import pydoc
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ase
import ase.io
import numpy as np
import pandas as pd
import pytest

import eos_ref
from eos_ref import EOS, EOSTable, InputError, audit, compare, run
from lammps_cases.engine import forkserver
from lammps_cases.records.files import arrays_files, read_arrays
from lammps_cases.records.run_record import read_run
from lammps_cases.run import campaign, tables
from lammps_cases.run.command import Result
from lammps_cases.run.options import CaseOptions, several
from lammps_cases.run.tables import VALUE_COLUMNS, unit
from lammps_cases.scene import ase_io
from tests.conftest import ROOT
from tests.support.outcome import Outcome
from tests.support.pages import unpacked

pytestmark = pytest.mark.lammps

Run = Callable[..., Outcome]
DECKS = ROOT / "tests" / "decks"
DECK = DECKS / "in.systems"
CASES = ["external.gravity", "near-rho0.linear.2d"]
PERIODIC = {"boundaries.fixed.drop": [False, False, True], "tilted.little.surface": [True] * 3}
HALF_UNIT = 0.5e-8  # of the last digit that ASE writes


@pytest.fixture(scope="module")
def ran() -> Result:
    return run(CASES, jobs=1)


@pytest.fixture(scope="module")
def others() -> Result:
    return run([*PERIODIC, "near-rho0.tait-water.2d"], jobs=1)


@pytest.fixture(scope="module")
def audited() -> Result:
    return audit(DECK)


@pytest.fixture(scope="module")
def tilted() -> Result:
    return audit(DECKS / "in.tilted", steps=10, suffix="kk")


# --- arguments


def test_package_is_imported_without_the_harness() -> None:
    heavy = "import sys, eos_ref; print({'lammps_cases', 'pandas', 'pydantic', 'ase', 'numba'} & {*sys.modules})"
    assert subprocess.run([sys.executable, "-c", heavy], check=True, capture_output=True, text=True).stdout == "set()\n"
    with pytest.raises(AttributeError, match="no attribute 'models'"):
        eos_ref.models  # noqa: B018


def test_documented_names_are_in_the_package() -> None:
    """Every name of `__all__` can be imported and completed, and documents import from the package only."""
    assert all(getattr(eos_ref, name) is not None for name in eos_ref.__all__)
    assert {*eos_ref.__all__} <= {*dir(eos_ref)}
    assert {"ArrayEvaluator", "Box", "CompiledEvaluator", "Model", "Simulation", "State"} <= set(eos_ref.__all__)
    for page in ("docs/python.md", "README.md", "eos_ref/NUMERICS.md"):
        text = (ROOT / page).read_text()
        for line in re.findall(r"^from eos_ref import (.*)$", text, flags=re.MULTILINE):
            assert set(line.split(", ")) <= set(eos_ref.__all__), line
        assert not re.findall(r"^from eos_ref\.", text, flags=re.MULTILINE)


@pytest.mark.parametrize(
    ("function", "parameters"),
    [
        (run, "names: str | collections.abc.Sequence[str] = (), *, tag: str | None = None, cases: "),
        (audit, "deck: str | pathlib.Path, *, dump: pathlib.Path | None = None, restart: "),
        (compare, "a: str | pathlib.Path | lammps_cases.run.command.Result, b: "),
    ],
)
def test_functions_are_plain_with_signature_and_help(function: Callable[..., Any], parameters: str) -> None:
    signature, shown = inspect.signature(function), pydoc.plain(pydoc.render_doc(function))
    assert inspect.isfunction(function) and str(signature).startswith(f"({parameters}") and "Annotated" not in shown
    described = (inspect.getdoc(function) or "").partition("Raises")[0]
    assert all(re.search(rf"^(\w+, )*{name}(, \w+)* :", described, re.MULTILINE) for name in signature.parameters)
    assert f"{function.__name__}({parameters}" in shown and described.splitlines()[0] in shown


def test_script_needs_no_guard(tmp_path: Path) -> None:
    """Workers and the process of an audit do not import the user's script, which would start them again."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nfrom eos_ref import audit, run\nprint('once', file=sys.stderr)\n"
        f"print(run('near-rho0.linear.2d', jobs=1).verdicts, audit({str(DECK)!r}).exit_code)\n"
    )
    done = subprocess.run([sys.executable, script], check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("{'exact': 1} 0\n", "once\n")


def test_arguments_become_the_equivalent_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert several("walls") == ["walls"] and several(Path("a.yaml")) == ["a.yaml"]
    assert several(["a", Path("b")]) == ["a", "b"] and several(()) == []
    assert CaseOptions().processes >= 1
    given: list[Any] = []

    def run_cases(cases: Any, engine: Any, jobs: int, folder: Path, asked: campaign.Request, **_: Any) -> Any:
        given.extend([[case.name for case in cases], jobs, folder, asked.command, asked.fail_on, asked.allow])
        raise InputError("cases", "are not run here")

    monkeypatch.setattr(forkserver, "start_for_judging", lambda: None)
    monkeypatch.setattr(campaign, "run_cases", run_cases)
    with pytest.raises(InputError, match="are not run here"):
        run(CASES[1], jobs=3, fail_on="high", allow="support-unit", out=tmp_path / "out")
    line = f"eos-ref run {CASES[1]} --allow support-unit"
    assert given == [[CASES[1]], 3, tmp_path / "out", line, "high", ["support-unit"]]


BAD: dict[str, Callable[[Result, Path], Any]] = {
    "no such case: 'extrenal' (did you mean 'external'?)": lambda ran, tmp: run("extrenal"),
    "tag: no case has the tag 'slow'": lambda ran, tmp: run(tag="slow"),
    "case file: cannot be read: No such file": lambda ran, tmp: run(cases="no-such-folder"),
    "argument names: Input should be a valid string, found 3 (run())": lambda ran, tmp: run(3),
    "argument jobs: Input should be greater than or equal to 1, found 0 (run())": lambda ran, tmp: run(jobs=0),
    "argument jobs: Input should be a valid integer": lambda ran, tmp: run(jobs=1.5),
    "engine: must be env, pypi:VERSION or path:DIR, found 'x'": lambda ran, tmp: run(CASES[0], engine="x"),
    "no such finding: 'support-units' (did you mean 'support-unit'?)": lambda ran, tmp: run(allow="support-units"),
    "output folder: must be empty or hold an earlier report": lambda ran, tmp: run(CASES[1], out=tmp),
    "deck: no such file (none)": lambda ran, tmp: audit("none"),
    "every: must be 1 to 2147483647 time steps, found 0": lambda ran, tmp: audit(DECK, every=0),
    "argument fail_on: Input should be 'high'": lambda ran, tmp: audit(DECK, fail_on="bad"),
    "side: must be an engine": lambda ran, tmp: compare(ran, "none"),
    "no such case: 'external.gravitas' (did you mean": lambda ran, tmp: ran.values("external.gravitas"),
    "case: must be named, as there are 2": lambda ran, tmp: ran.particles(),
}


@pytest.mark.parametrize("line", BAD)
def test_bad_input_is_one_exception_with_one_line(line: str, ran: Result, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("not a report")
    with pytest.raises(InputError) as raised:
        BAD[line](ran, tmp_path)
    assert str(raised.value).startswith(line) and "\n" not in str(raised.value)


# --- results


def test_run_equals_that_of_the_command(
    ran: Result, tmp_path: Path, eos_ref_command: Run, capfd: pytest.CaptureFixture[str]
) -> None:
    outcome = eos_ref_command("run", *CASES, "--out", tmp_path / "report")
    record = read_run(tmp_path / "report")
    of_command = {case.case: [field.digest for field in case.fields] for case in record.cases}
    assert {case.case: [field.digest for field in case.fields] for case in ran.record.cases} == of_command
    assert (ran.exit_code, ran.verdicts) == (outcome.code, record.summary) == (0, {"exact": 1, "explained": 1})
    assert str(ran.headline) in outcome.out and ran.headline.state == "KNOWN BUGS"
    assert ran.record.command == f"eos-ref run {' '.join(CASES)}"
    capfd.readouterr()
    again = run(CASES[1], jobs=1, fail_on="high", out=tmp_path / "kept")
    assert capfd.readouterr() == ("", "")
    assert again.folder == tmp_path / "kept" and (tmp_path / "kept" / "report.html").exists()
    assert read_run(tmp_path / "kept").fail_on == "high"

    same = compare(ran, ran.folder)
    assert (same.exit_code, same.headline.state, set(same.counts)) == (0, "PASS", {"same bits"})
    assert len(same.fields) == sum(same.counts.values()) and same.findings.empty
    other = compare(again, ran, out=tmp_path / "out")
    document = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert other.exit_code == eos_ref_command("compare", again.folder, ran.folder, "--out", tmp_path / "by").code == 1
    assert document["fields"] == json.loads((tmp_path / "by" / "compare.json").read_text())["fields"]
    assert len(other.fields) == len(document["fields"])
    assert other.counts["new case"] == 1 and set(other.fields.change) == set(other.counts)


def test_results_show_headline_and_bugs_in_a_notebook(ran: Result) -> None:
    shown, both = ran._repr_html_(), compare(ran, ran)
    assert shown.startswith(f"<p><b>KNOWN BUGS</b>: {html.escape(ran.headline.sentence)}</p><table")
    assert all(html.escape(ran.findings[column][0]) in shown for column in ("id", "severity", "title", "workaround"))
    assert both._repr_html_() == f"<p><b>PASS</b>: {html.escape(both.headline.sentence)}</p>"
    pd.testing.assert_frame_equal(both.to_pandas(), both.fields)


def test_temporary_report_is_deleted_with_its_result(ran: Result, tmp_path: Path) -> None:
    assert ran.temporary and ran.folder.is_dir()
    result = Result(ran.record, Path(shutil.copytree(ran.folder, tmp_path / "made" / "report")), temporary=True)
    folder = result.folder
    del result
    assert not folder.exists() and not folder.parent.exists()


def test_audit_takes_the_suffix_of_the_command_line(tilted: Result) -> None:
    (case,) = tilted.record.cases
    assert "suffix kk: this LAMMPS has no rheo/kk; RHEO's styles run without it" in case.warnings
    assert "-sf kk" in case.reproduce


def test_page_has_the_pairs_of_explain_and_is_reproducible(ran: Result, tmp_path: Path, eos_ref_command: Run) -> None:
    again = tmp_path / "again"
    shutil.copytree(ran.folder, again)
    assert eos_ref_command("report", again).code == 0
    made = [unpacked((folder / "report.html").read_text()) for folder in (ran.folder, again)]
    first, second = (re.findall(r'class="(?:data|more)">(.*?)</script>', html) for html in made)
    assert first == second and len(first) == 3  # both cases, and the other steps of one
    beside = read_arrays(arrays_files(ran.folder / "fields", CASES[0])[1])
    field = next(field for field in ran.record.cases[0].fields if field.field == "f")
    looked = list(zip(beside["@pairs step"].tolist(), beside["@pairs atom"].tolist(), strict=True))
    at = looked.index((field.worst_step, field.worst_id))
    words = ("--atom", str(field.worst_id), "--step", str(field.worst_step), "--json")
    explained = json.loads(eos_ref_command("explain", CASES[0], *words).out)
    names = beside["@pairs names"].tolist()
    assert beside["@pairs sum"][at][: names.index("force y") + 1].tolist() == explained["sum"]["force"]
    assert beside["@pairs count"][at] == explained["count"] > 0


# --- tables


def test_tables_of_a_run(ran: Result, others: Result) -> None:
    assert dict(zip(ran.cases.case, ran.cases.verdict, strict=True)) == {CASES[0]: "explained", CASES[1]: "exact"}
    assert ran.findings.id.tolist() == ["force-per-volume"] and ran.findings.cases.tolist() == [CASES[0]]
    explained = ran.fields[ran.fields.explained_by == "force-per-volume"]
    assert set(explained.verdict) == {"explained"} and "f" in set(explained.field)
    assert explained.set_index("field").unit["f"] == "mass length time^-2"
    textbook = others.fields[(others.fields.field == "pressure") & (others.fields.case == "near-rho0.tait-water.2d")]
    assert (textbook.max_over_bound <= 1).all()
    assert (textbook.digits_lost_lammps > 10).all(), "the textbook form cancels at 1e-12 compression"
    pd.testing.assert_frame_equal(ran.to_pandas(), ran.fields)
    law = ran.particles(CASES[1])
    assert list(law.id) == list(range(1, len(law) + 1))
    assert (law["pressure.lammps"] == law["pressure.reference"]).all()
    rows = ran.particles(CASES[0])
    assert {"f/x.lammps", "f/y.reference", "grad/v/yx.bound", "coordination.lammps", "v/x.lammps"} <= set(rows.columns)
    arrays = read_arrays(ran.folder / "fields" / f"{CASES[0]}.npz")
    assert np.array_equal(rows["grad/v/yx.lammps"], arrays["grad/v.lammps"][:, 1, 0])


def test_every_value_is_a_row_with_the_verdict_of_its_step(ran: Result) -> None:
    frame = ran.values()
    assert tuple(frame.columns) == VALUE_COLUMNS and frame.case.unique().tolist() == CASES
    arrays = read_arrays(ran.folder / "fields" / f"{CASES[0]}.npz")
    own = frame[frame.case == CASES[0]]
    yx = own[(own.field == "grad/v") & (own.component == "yx")]
    for side in ("lammps", "reference", "bound"):
        np.testing.assert_array_equal(yx[side], arrays[f"grad/v.{side}"][:, 1, 0])
    assert yx.id.tolist() == arrays["id"].tolist() and yx.type.tolist() == arrays["type"].tolist()
    for field in ran.record.cases[0].fields:
        at = {step.step: step.verdict for step in field.steps} or {0: field.verdict}
        shown = own[own.field == field.field]
        assert set(shown.verdict) == {at[int(shown.step.iloc[0])]}, field.field
        if field.field == "grad/v":
            assert set(yx.step) == {field.worst_step} and shown.ratio.max() == field.max_over_bound
    law = frame[(frame.case == CASES[1]) & (frame.field == "pressure")]
    assert set(law.component) == {""} and set(law.verdict) == {"exact"} and (law.ratio <= 1).all()
    assert frame.attrs["units"][CASES[0]]["pressure"] == "mass time^-2"
    assert set(ran.values(CASES[1]).case) == {CASES[1]}


def test_tables_of_an_audit(audited: Result, tmp_path: Path) -> None:
    """Pressures are judged by type, at a single step, the last sample."""
    frame = audited.values()
    assert set(frame.step) == {int(read_arrays(audited.folder / "fields" / "in.systems.npz")["step"])}
    checks = {(check.field, check.type): check.verdict for check in audited.record.cases[0].checks}
    for (field, component), rows in frame.groupby(["field", "component"], observed=True):
        for t, of_type in rows.groupby("type"):
            assert set(of_type.verdict) == {checks.get((field, t)) or checks[field, 0]}, (field, component, t)
    wide = audited.particles()
    assert "step" not in wide and {"id", "type", "x", "f/x.lammps"} <= set(wide.columns)
    assert len(wide) == audited.record.cases[0].natoms
    shutil.copytree(audited.folder / "fields", tmp_path / "fields")
    record = audited.record.model_copy(deep=True)
    last = max(k for k, check in enumerate(record.cases[0].checks) if (check.field, check.type) == ("pressure", 2))
    record.cases[0].checks[last].verdict = "differs"
    (tmp_path / "run.json").write_text(record.to_json())
    frame = tables.values(tmp_path)
    differs = frame[frame.verdict == "differs"]
    assert set(differs.field) == {"pressure"} and set(differs.type) == {2}


def test_tables_are_written(ran: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = ran.values(CASES[0])
    tables.write(frame, tmp_path / "values.parquet")
    back = pd.read_parquet(tmp_path / "values.parquet")
    pd.testing.assert_frame_equal(back, frame)
    assert back.attrs == frame.attrs
    tables.write(frame, tmp_path / "values.csv")
    with (tmp_path / "values.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == VALUE_COLUMNS
    for name in ("id", "lammps", "bound", "ratio"):
        assert [float(row[name]) for row in rows] == frame[name].tolist()
    assert [row["verdict"] for row in rows] == frame.verdict.tolist()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for place, rule in (
        ("a.xlsx", "must be written to a file .parquet or .csv"),
        ("no/a.csv", "cannot be written"),
        ("other.parquet", r"needs pyarrow for Parquet: pip install 'eos-ref\[parquet\]'"),
    ):
        with pytest.raises(InputError, match=rule):
            tables.write(frame, tmp_path / place)


@pytest.mark.parametrize(
    ("field", "style", "dimension", "of"),
    [
        ("pressure", "si", 3, "kg m^-1 s^-2"),
        ("pressure", "si", 2, "kg s^-2"),
        ("rho (given)", "real", 3, "g/cm^3"),
        ("esph (given)", "metal", 3, "eV"),
        ("f", "metal", 3, "eV Angstrom^-1"),
        ("coordination", "cgs", 2, "1"),
        ("conductivity", "si", 3, "kg m s^-3 K^-1"),
        ("e", "lj", 2, "length^2 time^-2"),
        ("type", "si", 3, "1"),
        ("stress/atom", "real", 3, "atm Angstrom^3"),
    ],
)
def test_units(field: str, style: str, dimension: int, of: str) -> None:
    assert unit(field, style, dimension) == of


# --- ase.Atoms


def test_laws_on_atoms() -> None:
    table = EOSTable((EOS("linear", 1.2, 3.0), EOS("tait/water", 0.9, 5.0)))
    atoms = ase.Atoms("H4", positions=np.eye(4, 3))
    rho_n, type_n = np.array([1.0, 1.1, 1.2, 0.9]), np.array([1, 1, 1, 2])
    atoms.set_array("rho", rho_n)
    atoms.set_array("type", type_n)
    expected = [float(table[t].pressure(rho)) for t, rho in zip(type_n.tolist(), rho_n.tolist(), strict=True)]
    assert ase_io.pressures(atoms, table).tolist() == expected
    with pytest.raises(InputError, match="rho"):
        ase_io.pressures(ase.Atoms("H"), table)


def read_back(atoms: ase.Atoms, path: Path) -> ase.Atoms:
    """Write and read atoms as extended XYZ, which keeps eight digits."""
    ase.io.write(path, atoms, format="extxyz")
    return ase.io.read(path, format="extxyz")


@pytest.mark.parametrize("case", PERIODIC)
def test_atoms_of_a_run_are_complete(case: str, others: Result, tmp_path: Path) -> None:
    """Box, axes, velocities and all fields reach a file that other programs read."""
    arrays, atoms = read_arrays(others.folder / "fields" / f"{case}.npz"), others.atoms(case)
    assert atoms.pbc.tolist() == PERIODIC[case]
    low_c, high_c, *tilt = arrays["box"]
    np.testing.assert_array_equal(np.diag(atoms.cell.array), high_c - low_c)
    assert atoms.cell.array[1, 0] == (tilt[0][0] if tilt else 0.0) and bool(tilt) == case.startswith("tilted")
    np.testing.assert_array_equal(atoms.info["Origin"], low_c)
    assert arrays["v"].any()
    for name, found in (("x", atoms.positions), ("mass", atoms.get_masses()), ("type", atoms.arrays["type"])):
        np.testing.assert_array_equal(found, arrays[name])
    # times the mass and over it: two roundings
    np.testing.assert_allclose(atoms.get_velocities(), arrays["v"], rtol=2 * 2.0**-53, atol=0)
    (record,) = (record for record in others.record.cases if record.case == case)
    worst = {field.field: field.worst_step for field in record.fields}
    assert worst["v"] == record.steps, "the case shows its last velocities"
    np.testing.assert_array_equal(arrays["v"][:, :2], arrays["v.lammps"])
    np.testing.assert_array_equal(atoms.arrays["f_lammps"], arrays["f.lammps"])
    back = read_back(atoms, tmp_path / "x.extxyz")
    assert back.arrays.keys() == atoms.arrays.keys() and back.pbc.tolist() == PERIODIC[case]
    assert all(re.fullmatch(r"\w+", name) for name in back.arrays)
    gradient = arrays["grad/v.lammps"]
    shown = back.arrays["grad_v_lammps"].reshape(gradient.shape)
    np.testing.assert_allclose(shown, gradient, rtol=0, atol=HALF_UNIT + 2.0**-53)
    np.testing.assert_allclose(back.cell.array, atoms.cell.array, rtol=2.0**-53)


def test_atoms_of_an_audit(tilted: Result, tmp_path: Path) -> None:
    atoms = tilted.atoms()
    back = read_back(atoms, tmp_path / "x.extxyz")
    assert back.cell.array[1, 0] == atoms.cell.array[1, 0] != 0
    assert back.pbc.all() and back.get_velocities().any()
    # Velocities, and momenta, which are divided by the masses.
    either_n = HALF_UNIT * (1 + 1 / back.get_masses())
    assert np.all(np.abs(back.arrays["velo"] - back.get_velocities()) <= (either_n + 4 * 2.0**-53)[:, None])
    assert {"pressure_lammps", "f_reference", "grad_v_bound"} <= set(back.arrays)


def test_atoms_of_an_earlier_version() -> None:
    """Its reports have neither axes nor velocities nor masses."""
    box = np.array([[0, 0, 0], [2, 2, 2]])
    atoms = ase_io.as_atoms({"id": np.arange(1, 3), "type": np.ones(2, int), "x": np.eye(2, 3), "box": box})
    assert atoms.pbc.all() and not atoms.has("momenta") and atoms.cell.array.tolist() == (2 * np.eye(3)).tolist()
