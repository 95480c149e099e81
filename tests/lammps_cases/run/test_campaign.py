"""The main job on real LAMMPS: all shipped cases, the files of a run, shards, kills."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from lammps_cases.records import folders
from lammps_cases.records.run_record import RunRecord, read_run
from lammps_cases.records.yaml_files import read_yaml
from lammps_cases.run import campaign, schemas
from lammps_cases.scene import casefile
from tests.support.outcome import Outcome
from tests.support.same_reports import assert_same

pytestmark = pytest.mark.lammps

Run = Callable[..., Outcome]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of some cases, as a user runs them."""
    out = tmp_path_factory.mktemp("run") / "report"
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "ranges", "status", "refused", "--out", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"report: {out / 'report.html'}" in done.stdout
    return out


@pytest.fixture(scope="module")
def whole() -> RunRecord:
    """The record that ``make validate`` left: all cases that are not long."""
    run = read_run(Path(__file__).parents[3] / "reports" / "latest")
    assert {case.case for case in run.cases} == {case.name for case in casefile.select(casefile.load(), [])}
    return run


@pytest.mark.campaign
def test_every_shipped_case_is_as_expected(whole: RunRecord) -> None:
    laws = [case for case in whole.cases if "model" not in case.tags]
    assert len(laws) >= 80
    assert len(whole.cases) - len(laws) >= 150
    for case in whole.cases:
        assert case.as_expected, (case.case, case.verdict, case.message)
    for case in laws:
        if not case.expects:
            assert [field.field for field in case.fields][-1] == "pressure"
            # LAMMPS' order of operations is known for every law; in real and metal units a finding hides it.
            assert case.verdict == ("explained" if case.units in ("real", "metal") else "exact"), case.case
    assert whole.carried is None, "every finding that is listed for this engine is still there"


@pytest.mark.campaign
def test_shipped_scenes_of_the_model_tell_formulas_apart(whole: RunRecord) -> None:
    """Mistakes that scenes cannot detect: means of equal viscosities, walls never thinner than rho0, unit values."""
    means, floor = "arithmetic for harmonic mean, or the reverse", "no lower limit to the density of walls"
    at_rest = {"V_i for V_j", "no volume in the force", "speed of sound ignored in artificial viscosity"}
    lone = "no-slip extrapolation ignored"  # a wall without fluid about it, or whose velocity is not compared
    blind = {case.case: set(case.lint) - {means} for case in whole.cases if "model" in case.tags}
    assert {name: lint for name, lint in blind.items() if lint} == {
        "claims-walls.pressed": {floor},
        "degenerate-steps.heated.rk1": {"one conductivity for all types"},
        "degenerate-steps.heated.rk2": {"one conductivity for all types"},
        "degenerate-steps.reconstructed.rk1": {lone},
        "degenerate-steps.reconstructed.rk2": {lone},
        **{
            f"edges-freezing.{name}.{d}": {"one conductivity for all types"}  # which are equal
            for name in ("plain", "shifted")
            for d in ("2d", "3d")
        },
        **{f"edges-rest.corrected.{d}": {"speed of sound ignored in artificial viscosity"} for d in ("2d", "3d")},
        "exercise-walls-3d.law": {floor},
        "exercise-walls-3d.lone": {lone},
        "exercise-walls-3d.lone-rk1": {lone},
        "exercise-walls.images-of-images": {floor},
        "exercise-walls.law": {floor},
        "exercise-walls.lone": {lone, floor},
        "exercise-walls.lone-rk1": {lone},
        "fluids.defaults": {"speed of sound ignored in artificial viscosity"},
        "fluids.unit": {
            "masses ignored",
            "rho0 for rho in volumes",
            "V_i for V_j",
            "no volume in the force",
            "speed of sound ignored in artificial viscosity",
        },
        "harmonic.one": {"heat divided by the density"},
        "power-walls.background": {floor},
        "runs-images.narrow": {floor},
        "runs-images.ranks-narrow": {floor},
        "runs-walls.heat.ranks": {floor},
        "tilted-close.summed": {"V_i for V_j"},
        "tilted-close.walls": {floor, lone},
        "tilted.small.walls": {floor},
        "virials.rest.newton": at_rest,
        "virials.rest.no-newton": at_rest,
        "virials.rest.two-ranks": at_rest,
        "virials.walls.two-ranks": {floor},
        "walls-summed.quintic": {floor},
        "walls-summed.shift": {floor},
    }


def test_files_of_a_run(small: Path) -> None:
    names = {path.name for path in small.iterdir()}
    assert names == {"run.json", "fields", "report.html", "summary.md", "junit.xml"}
    document = json.loads((small / "run.json").read_text())
    jsonschema.Draft202012Validator(schemas.run_schema()).validate(document)
    assert document["engine"]["distribution"]
    assert len(document["engine"]["library_sha256"]) == 64
    assert "stable" in document["engine"]["git"] or document["engine"]["git"]
    compared = [case for case in document["cases"] if case["fields"]]
    assert {f"{case['case']}.npz" for case in compared} == {
        path.name for path in (small / "fields").iterdir() if "@" not in path.name
    }
    suite = ET.parse(small / "junit.xml").getroot()
    assert len(list(suite.iter("testcase"))) == len(document["cases"])


def test_arrays_of_a_case_hold_both_sides(small: Path) -> None:
    with np.load(small / "fields" / "ranges.override.npz") as arrays:
        n = len(arrays["id"])
        assert np.array_equal(arrays["id"], np.arange(1, n + 1))
        difference = np.abs(arrays["pressure.lammps"] - arrays["pressure.reference"])
        assert np.all(difference <= arrays["pressure.bound"])
        assert set(arrays["type"]) == {1, 2, 3, 4}
        assert arrays["x"].shape == (n, 3)


def test_second_run_and_merged_shards_give_the_same(eos_ref_command: Run, tmp_path: Path) -> None:
    names = ("near-rho0", "ranges", "files")
    for out, arguments in {"a": (), "b": ("--jobs", 2), "s1": ("--shard", "1/2"), "s2": ("--shard", "2/2")}.items():
        assert eos_ref_command("run", *names, *arguments, "--out", tmp_path / out).code == 0
    assert eos_ref_command("merge", tmp_path / "s1", tmp_path / "s2", "--out", tmp_path / "m").code == 0
    for other in ("b", "m"):
        assert_same(tmp_path / "a", tmp_path / other)
    code, _, err = eos_ref_command("merge", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "n")
    assert code == 2
    assert "occurs in two of the runs" in err
    code, _, err = eos_ref_command("merge", tmp_path / "s1", "--out", tmp_path / "n")
    assert code == 2
    assert "missing 2/2" in err


def test_json_is_the_only_output(eos_ref_command: Run, tmp_path: Path) -> None:
    code, out, err = eos_ref_command("run", "near-rho0.linear", "--json", "--out", tmp_path / "report")
    assert code == 0
    assert RunRecord.model_validate_json(out).summary == {"exact": 2}
    assert err == ""
    assert json.loads(eos_ref_command("list", "--json").out)["cases"][0].keys() >= {"case", "about", "file", "tags"}
    assert {"id", "title", "severity", "engines", "cases", "variant", "upstream"} == json.loads(
        eos_ref_command("ledger", "--json").out
    )["entries"][0].keys()


def test_strict_turns_explained_into_failure(eos_ref_command: Run, tmp_path: Path) -> None:
    assert eos_ref_command("run", "refused.range-two-stars", "--out", tmp_path / "a").code == 0
    assert eos_ref_command("run", "refused.range-two-stars", "--strict", "--out", tmp_path / "b").code == 1


def test_refusal_with_another_text_differs(
    case_file: Callable[..., Path], eos_ref_command: Run, tmp_path: Path
) -> None:
    file = case_file(violate="no-fix-viscosity", expect={"refused": "something else"})
    code, out, _ = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 1
    assert "Missing fix rheo/viscosity" in out


def test_refusal_that_does_not_come_differs(
    case_file: Callable[..., Path], eos_ref_command: Run, tmp_path: Path
) -> None:
    file = case_file(expect={"refused": "any error"})
    code, out, _ = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 1
    assert "LAMMPS accepts what the manual refuses" in out


def test_unexpected_refusal_is_exit_code_3(
    case_file: Callable[..., Path], eos_ref_command: Run, tmp_path: Path
) -> None:
    # Particles outside a box that is not periodic cannot be recognised from the scene alone: LAMMPS loses them.
    (tmp_path / "d.extxyz").write_text(
        '1\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3:rho:R:1 pbc="F F F"\nH 1.0 1.0 0 1.1\n'
    )
    file = case_file(positions={"extxyz": "d.extxyz"}, rho=None, dimension=3, name="flat")
    code, _out, _ = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code in (0, 3)
    run = read_run(tmp_path / "report")
    assert (code == 3) == (run.cases[0].verdict == "refused")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_killed_run_leaves_the_earlier_report_whole(kill: signal.Signals, tmp_path: Path) -> None:
    out = tmp_path / "report"
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "--out", str(out), "--jobs", "1"]
    subprocess.run([*command, "near-rho0.linear"], check=True, capture_output=True)
    before = {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    process = subprocess.Popen(
        [*command, "near-rho0", "units"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob(".report.partial/journal/cases/*.json")):  # until the run has judged a case
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.005)
    if kill == signal.SIGKILL:
        os.killpg(process.pid, kill)
    else:
        process.send_signal(kill)
    _, err = process.communicate(timeout=60)
    assert process.returncode != 0
    if kill != signal.SIGKILL:
        assert process.returncode == 130
        partial = folders.interrupted(out)
        rest = "the same command with --resume continues"
        told = rf"eos-ref: interrupted after \d+ of \d+ cases: see {partial}/summary.md; {rest}"
        assert re.fullmatch(told, err.strip().splitlines()[-1]), err
        assert "not judged" in (partial / "summary.md").read_text()
        assert not (tmp_path / ".report.partial").exists()
    assert before == {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    assert subprocess.run([*command, "near-rho0.linear"], check=False, capture_output=True).returncode == 0


def test_report_is_rendered_again(eos_ref_command: Run, tmp_path: Path) -> None:
    eos_ref_command("run", "near-rho0.linear", "--out", tmp_path / "report")
    page = tmp_path / "report" / "report.html"
    before = page.read_bytes()
    page.unlink()
    assert eos_ref_command("report", tmp_path / "report").code == 0
    assert page.read_bytes() == before


def test_shipped_cases_cover_laws_units_and_forms() -> None:
    cases = casefile.load()
    assert len(cases) >= 80
    scenes = [case.scene for case in cases]
    styles = {law.style for scene in scenes for law in scene.pressure}
    assert styles == {"linear", "cubic", "tait/water", "tait/general", "ideal/gas", "background"}
    assert {scene.units for scene in scenes} == {"lj", "si", "real", "metal", "cgs", "micro", "nano"}
    assert {scene.dimension for scene in scenes} == {2, 3}
    assert any(scene.rho_sum for scene in scenes)
    assert any(scene.evolve for scene in scenes)
    assert sum(scene.expect is not None for scene in scenes) >= 10
    forms = {law.types for scene in scenes for law in scene.pressure}
    assert {"*", "1", "*3", "3*", "2*3"} <= forms


def test_cases_known_to_kill_a_worker_come_last() -> None:
    names = [case.name for case in campaign.ordered(casefile.load())]
    crashes = {"strain.unasked.2d", "strain.unasked.3d", "refused.range-two-stars", "refused.no-fix-pressure-read"}
    assert crashes < {*names[-5:]}
    assert names[-9:-5] == ["files.csv", "files.data", "files.dump", "files.extxyz"], "those that are read from files"


def test_published_schemas_are_current() -> None:
    for path, content in schemas.documents().items():
        assert path.read_text() == content, f"{path.name} is old: python -m lammps_cases.run.schemas"


@pytest.mark.parametrize("path", sorted(casefile.SHIPPED.glob("*.yaml")), ids=lambda path: path.stem)
def test_shipped_case_files_fit_the_published_schema(path: Path) -> None:
    schema = json.loads((schemas.FOLDER / "scene" / "scene.schema.json").read_text())
    jsonschema.Draft202012Validator(schema).validate(read_yaml(path))
