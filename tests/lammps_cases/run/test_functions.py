"""`run`, `audit` and `compare` as functions: the commands' own results, as tables, with nothing printed."""

from __future__ import annotations

import csv
import inspect
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from eos_ref import InputError
from lammps_cases import audit, compare, run
from lammps_cases.records.files import arrays_files, read_arrays
from lammps_cases.records.run_record import read_run
from lammps_cases.run import tables
from lammps_cases.run.command import Result
from lammps_cases.run.tables import VALUE_COLUMNS, unit
from tests.support.outcome import Outcome
from tests.support.pages import unpacked

pytestmark = pytest.mark.lammps

DECK = Path(__file__).parents[2] / "decks" / "in.systems"
CASES = ["external.gravity", "near-rho0.linear.2d"]


@pytest.fixture(scope="module")
def ran() -> Result:
    return run(CASES, jobs=1)


@pytest.fixture(scope="module")
def audited() -> Result:
    return audit(DECK)


def test_an_audit_takes_the_suffix_of_the_command_line() -> None:
    (case,) = audit(DECK, suffix="kk", steps=1, fields="pressure").record.cases
    assert "suffix kk: this LAMMPS has no rheo/kk; RHEO's styles run without it" in case.warnings
    assert "-sf kk" in case.reproduce


def test_the_package_is_imported_at_once_and_without_numpy() -> None:
    heavy = (
        "import sys, lammps_cases; print(sorted({'numpy', 'pandas', 'pydantic', 'ase', 'eos_ref'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", heavy], check=True, capture_output=True, text=True).stdout == "[]\n"
    assert list(inspect.signature(run).parameters)[:3] == ["names", "tag", "cases"]
    with pytest.raises(AttributeError, match="no attribute 'audits'"):
        import lammps_cases

        lammps_cases.audits  # noqa: B018


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    """Workers and the process of an audit do not import the user's script, which would start them again."""
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\nfrom lammps_cases import audit, run\nprint('once', file=sys.stderr)\n"
        f"print(run('near-rho0.linear.2d', jobs=1).verdicts, audit({str(DECK)!r}).exit_code)\n"
    )
    done = subprocess.run([sys.executable, script], check=True, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("{'exact': 1} 0\n", "once\n")


def test_run_equals_that_of_the_command(
    ran: Result, tmp_path: Path, eos_ref_command: Callable[..., Outcome], capfd: pytest.CaptureFixture[str]
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


def test_temporary_report_is_deleted_with_its_result() -> None:
    result = run(CASES[1], jobs=1)
    folder = result.folder
    assert (folder / "run.json").exists()
    del result
    assert not folder.exists()


def test_page_has_the_pairs_of_explain_and_is_reproducible(
    ran: Result, tmp_path: Path, eos_ref_command: Callable[..., Outcome]
) -> None:
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


def test_tables_of_a_run(ran: Result) -> None:
    assert dict(zip(ran.cases.case, ran.cases.verdict, strict=True)) == {CASES[0]: "explained", CASES[1]: "exact"}
    assert ran.findings.id.tolist() == ["force-per-volume"] and ran.findings.cases.tolist() == [CASES[0]]
    explained = ran.fields[ran.fields.explained_by == "force-per-volume"]
    assert set(explained.verdict) == {"explained"} and "f" in set(explained.field)
    assert explained.set_index("field").unit["f"] == "mass length time^-2"


def test_every_value_is_a_row(ran: Result) -> None:
    frame = ran.values()
    assert tuple(frame.columns) == VALUE_COLUMNS and frame.case.unique().tolist() == CASES
    arrays = read_arrays(ran.folder / "fields" / f"{CASES[0]}.npz")
    yx = frame[(frame.case == CASES[0]) & (frame.field == "grad/v") & (frame.component == "yx")]
    for side in ("lammps", "reference", "bound"):
        np.testing.assert_array_equal(yx[side], arrays[f"grad/v.{side}"][:, 1, 0])
    assert yx.id.tolist() == arrays["id"].tolist() and yx.type.tolist() == arrays["type"].tolist()
    record = {field.field: field for field in ran.record.cases[0].fields}["grad/v"]
    assert set(yx.step) == {record.worst_step}
    worst = frame[(frame.case == CASES[0]) & (frame.field == "grad/v")].ratio.max()
    assert worst == record.max_over_bound
    law = frame[(frame.case == CASES[1]) & (frame.field == "pressure")]
    assert set(law.component) == {""} and set(law.verdict) == {"exact"} and (law.ratio <= 1).all()
    assert frame.attrs["units"][CASES[0]]["pressure"] == "mass time^-2"
    assert set(ran.values(CASES[1]).case) == {CASES[1]}


def test_verdicts_are_those_of_the_step_shown(ran: Result) -> None:
    frame = ran.values(CASES[0])
    for field in ran.record.cases[0].fields:
        at = {step.step: step.verdict for step in field.steps} or {0: field.verdict}
        shown = frame[frame.field == field.field]
        assert set(shown.verdict) == {at[int(shown.step.iloc[0])]}, field.field


def test_tables_of_an_audit(audited: Result) -> None:
    """Pressures are judged by type, at a single step."""
    frame = audited.values()
    assert set(frame.step) == {int(read_arrays(audited.folder / "fields" / "in.systems.npz")["step"])}
    checks = {(check.field, check.type): check.verdict for check in audited.record.cases[0].checks}
    for (field, component), rows in frame.groupby(["field", "component"], observed=True):
        for t, of_type in rows.groupby("type"):
            assert set(of_type.verdict) == {checks.get((field, t)) or checks[field, 0]}, (field, component, t)
    wide = audited.particles()
    assert "step" not in wide and {"id", "type", "x", "f/x.lammps"} <= set(wide.columns)
    assert len(wide) == audited.record.cases[0].natoms


def test_last_sample_of_an_audit_is_judged_by_type(audited: Result, tmp_path: Path) -> None:
    shutil.copytree(audited.folder / "fields", tmp_path / "fields")
    record = audited.record.model_copy(deep=True)
    last = max(k for k, check in enumerate(record.cases[0].checks) if (check.field, check.type) == ("pressure", 2))
    record.cases[0].checks[last].verdict = "differs"
    (tmp_path / "run.json").write_text(record.to_json())
    frame = tables.values(tmp_path)
    differs = frame[frame.verdict == "differs"]
    assert set(differs.field) == {"pressure"} and set(differs.type) == {2}


def test_sides_are_compared(ran: Result, tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    same = compare(ran, ran.folder)
    assert (same.exit_code, same.headline.state, set(same.counts)) == (0, "PASS", {"same bits"})
    assert len(same.fields) == sum(same.counts.values()) and same.findings.empty
    one = run(CASES[1], jobs=1)
    other = compare(one, ran, out=tmp_path / "out")
    document = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert other.exit_code == eos_ref_command("compare", one.folder, ran.folder, "--out", tmp_path / "by").code == 1
    of_command = json.loads((tmp_path / "by" / "compare.json").read_text())
    assert document["fields"] == of_command["fields"] and len(other.fields) == len(document["fields"])
    assert other.counts["new case"] == 1 and set(other.fields.change) == set(other.counts)


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
    for place, rule in (("a.xlsx", "must be written to a file .parquet or .csv"), ("no/a.csv", "cannot be written")):
        with pytest.raises(InputError, match=rule):
            tables.write(frame, tmp_path / place)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"needs pyarrow for Parquet: pip install 'eos-ref\[parquet\]'"):
        tables.write(frame, tmp_path / "other.parquet")


BAD = {
    "no such case: 'extrenal' (did you mean 'external'?)": lambda ran, tmp: run("extrenal"),
    "tag: no case has the tag 'slow'": lambda ran, tmp: run(tag="slow"),
    "argument names: Input should be a valid string, found 3 (run())": lambda ran, tmp: run(3),
    "argument jobs: Input should be greater than or equal to 1, found 0 (run())": lambda ran, tmp: run(jobs=0),
    "engine: must be env, pypi:VERSION or path:DIR, found 'x'": lambda ran, tmp: run(CASES[0], engine="x"),
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


def test_units() -> None:
    assert unit("pressure", "si", 3) == "kg m^-1 s^-2" and unit("pressure", "si", 2) == "kg s^-2"
    assert unit("rho (given)", "real", 3) == "g/cm^3" and unit("esph (given)", "metal", 3) == "eV"
    assert unit("f", "metal", 3) == "eV Angstrom^-1" and unit("coordination", "cgs", 2) == "1"
    assert unit("conductivity", "si", 3) == "kg m s^-3 K^-1"
    assert unit("e", "lj", 2) == "length^2 time^-2" and unit("type", "si", 3) == "1"
    assert unit("stress/atom", "real", 3) == "atm Angstrom^3"
