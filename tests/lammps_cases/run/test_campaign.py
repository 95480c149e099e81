"""The main job on real LAMMPS: all shipped cases, the files of a run, shards, kills."""

from __future__ import annotations

import json
import os
import re
import shutil
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


COMMAND = [sys.executable, "-m", "lammps_cases.cli.main", "run"]
MEANS, FLOOR = "arithmetic for harmonic mean, or the reverse", "no lower limit to the density of walls"
SOUND, HEAT = "speed of sound ignored in artificial viscosity", "one conductivity for all types"
LONE = "no-slip extrapolation ignored"  # a wall without fluid about it, or whose velocity is not compared
# Mistakes that shipped scenes cannot detect: means of equal viscosities, walls never thinner than rho0, unit values.
BLIND = {
    FLOOR: "claims-walls.pressed exercise-walls-3d.law exercise-walls.images-of-images exercise-walls.law "
    "exercise-walls.lone power-walls.background runs-images.narrow runs-images.ranks-narrow runs-walls.heat.ranks "
    "tilted-close.walls tilted.small.walls virials.walls.two-ranks walls-summed.quintic walls-summed.shift",
    LONE: "degenerate-steps.reconstructed.rk1 degenerate-steps.reconstructed.rk2 exercise-walls-3d.lone "
    "exercise-walls-3d.lone-rk1 exercise-walls.lone exercise-walls.lone-rk1 tilted-close.walls",
    HEAT: "degenerate-steps.heated.rk1 degenerate-steps.heated.rk2 edges-freezing.plain.2d edges-freezing.plain.3d "
    "edges-freezing.shifted.2d edges-freezing.shifted.3d",  # which are equal
    SOUND: "edges-rest.corrected.2d edges-rest.corrected.3d fluids.defaults fluids.unit virials.rest.newton "
    "virials.rest.no-newton virials.rest.two-ranks",
    "V_i for V_j": "fluids.unit tilted-close.summed virials.rest.newton virials.rest.no-newton virials.rest.two-ranks",
    "no volume in the force": "fluids.unit virials.rest.newton virials.rest.no-newton virials.rest.two-ranks",
    "masses ignored": "fluids.unit",
    "rho0 for rho in volumes": "fluids.unit",
    "heat divided by the density": "harmonic.one",
}


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of some cases, as a user runs them."""
    out = tmp_path_factory.mktemp("run") / "report"
    done = subprocess.run(
        [*COMMAND, "ranges", "status", "refused", "--out", str(out)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"report: {out / 'report.html'}" in done.stdout
    return out


@pytest.fixture(scope="module")
def whole() -> RunRecord:
    """The record that ``make validate`` left: the cases that run by default."""
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
    found = {case.case: set(case.lint) - {MEANS} for case in whole.cases if "model" in case.tags}
    expected = {name: {lint for lint, of in BLIND.items() if name in of.split()} for name in found}
    named = {*" ".join(BLIND.values()).split()}
    assert found == expected and named <= found.keys() | casefile.more()


def test_files_of_a_run(small: Path, eos_ref_command: Run, tmp_path: Path) -> None:
    names = {path.name for path in small.iterdir()}
    assert names == {"run.json", "fields", "report.html", "summary.md", "junit.xml"}
    document = json.loads((small / "run.json").read_text())
    jsonschema.Draft202012Validator(schemas.run_schema()).validate(document)
    assert document["engine"]["distribution"] and document["engine"]["git"]
    assert len(document["engine"]["library_sha256"]) == 64
    compared = [case for case in document["cases"] if case["fields"]]
    written = {path.name for path in (small / "fields").iterdir() if "@" not in path.name}
    assert {f"{case['case']}.npz" for case in compared} == written
    assert len(list(ET.parse(small / "junit.xml").getroot().iter("testcase"))) == len(document["cases"])
    with np.load(small / "fields" / "ranges.override.npz") as arrays:
        n = len(arrays["id"])
        assert np.array_equal(arrays["id"], np.arange(1, n + 1))
        assert np.all(np.abs(arrays["pressure.lammps"] - arrays["pressure.reference"]) <= arrays["pressure.bound"])
        assert set(arrays["type"]) == {1, 2, 3, 4}
        assert arrays["x"].shape == (n, 3)
    again = Path(shutil.copytree(small, tmp_path / "report"))
    (again / "report.html").unlink()
    assert eos_ref_command("report", again).code == 0
    assert (again / "report.html").read_bytes() == (small / "report.html").read_bytes(), "rendered from its record"


def test_second_run_and_merged_shards_give_the_same(eos_ref_command: Run, tmp_path: Path) -> None:
    names = ("near-rho0.linear", "ranges", "files")
    for out, arguments in {"a": (), "b": ("--jobs", 2), "s1": ("--shard", "1/2"), "s2": ("--shard", "2/2")}.items():
        assert eos_ref_command("run", *names, *arguments, "--out", tmp_path / out).code == 0
    assert eos_ref_command("merge", tmp_path / "s1", tmp_path / "s2", "--out", tmp_path / "m").code == 0
    for other in ("b", "m"):
        assert_same(tmp_path / "a", tmp_path / other)
    for sides, complaint in ((("a", "b"), "occurs in two of the runs"), (("s1",), "missing 2/2")):
        code, _, err = eos_ref_command("merge", *(tmp_path / side for side in sides), "--out", tmp_path / "n")
        assert code == 2 and complaint in err


def test_json_is_the_only_output(eos_ref_command: Run, tmp_path: Path) -> None:
    code, out, err = eos_ref_command("run", "near-rho0.linear", "--json", "--out", tmp_path / "report")
    assert (code, err) == (0, "")
    assert RunRecord.model_validate_json(out).summary == {"exact": 2}
    assert json.loads(eos_ref_command("list", "--json").out)["cases"][0].keys() >= {"case", "about", "file", "tags"}
    entry = json.loads(eos_ref_command("ledger", "--json").out)["entries"][0]
    assert entry.keys() == {"id", "title", "severity", "engines", "cases", "variant", "upstream"}


def test_other_refusals_differ_and_unexpected_ones_are_exit_code_3(
    case_file: Callable[..., Path], eos_ref_command: Run, tmp_path: Path
) -> None:
    other = case_file("other", violate="no-fix-viscosity", expect={"refused": "something else"})
    none = case_file("none", expect={"refused": "any error"})
    code, out, _ = eos_ref_command("run", "--cases", other, "--cases", none, "--out", tmp_path / "report")
    assert code == 1 and "Missing fix rheo/viscosity" in out and "LAMMPS accepts what the manual refuses" in out
    # Particles outside a box that is not periodic cannot be recognised from the scene alone: LAMMPS loses them.
    (tmp_path / "d.extxyz").write_text(
        '1\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3:rho:R:1 pbc="F F F"\nH 1.0 1.0 0 1.1\n'
    )
    file = case_file(positions={"extxyz": "d.extxyz"}, rho=None, dimension=3, name="flat")
    code = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report").code
    assert code in (0, 3)
    assert (code == 3) == (read_run(tmp_path / "report").cases[0].verdict == "refused")


@pytest.mark.usefixtures("interruptible")
@pytest.mark.parametrize("kill", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_killed_run_leaves_the_earlier_report_whole(
    kill: signal.Signals, small: Path, eos_ref_command: Run, tmp_path: Path
) -> None:
    out = Path(shutil.copytree(small, tmp_path / "report"))
    before = {path: path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    command = [*COMMAND, "near-rho0", "--out", str(out), "--jobs", "1"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
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
    assert eos_ref_command("run", "near-rho0.linear", "--out", out).code == 0


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
    assert {"*", "1", "*3", "3*", "2*3"} <= {law.types for scene in scenes for law in scene.pressure}


def test_cases_known_to_kill_a_worker_come_last() -> None:
    names = [case.name for case in campaign.ordered(casefile.load())]
    crashes = {"strain.unasked.2d", "strain.unasked.3d", "refused.range-two-stars", "refused.no-fix-pressure-read"}
    assert crashes < {*names[-5:]}
    assert names[-9:-5] == ["files.csv", "files.data", "files.dump", "files.extxyz"], "those that are read from files"


def test_published_schemas_are_current_and_shipped_case_files_fit() -> None:
    for path, content in schemas.documents().items():
        assert path.read_text() == content, f"{path.name} is old: python -m lammps_cases.run.schemas"
    schema = json.loads((schemas.FOLDER / "scene" / "scene.schema.json").read_text())
    valid = jsonschema.Draft202012Validator(schema)
    assert [path.name for path in casefile.SHIPPED.glob("*.yaml") if not valid.is_valid(read_yaml(path))] == []
