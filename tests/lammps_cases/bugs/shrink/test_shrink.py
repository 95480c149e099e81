"""Shrinking of red cases: planted faults, findings, crashes; a one-line message for what cannot be shrunk."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import pytest
import yaml

from eos_ref import InputError
from lammps_cases.bugs.shrink import candidate
from lammps_cases.bugs.shrink.candidate import (
    Content,
    FailureMode,
    as_case,
    failure_mode,
    rule_broken,
    size,
    written_out,
)
from lammps_cases.bugs.shrink.reductions import fewer_digits, fewer_particles, fewer_steps, fewer_types
from lammps_cases.bugs.shrink.shrink import Shrunk, WorkerJudge, shrink
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import Answer
from lammps_cases.engine.workers import Workers
from lammps_cases.records.case_parts import Blame
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run import prepared_case
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from tests.support.outcome import Outcome
from tests.workshop.faults import input_faults, output_faults
from tests.workshop.faults.perturbed import PerturbedCase, PerturbedJudge

Run = Callable[..., Outcome]
Write = Callable[..., Path]
CASES = {case.name: case for case in casefile.load()}
# Faults of input and of output, and a case that each turns red.
PLANTED = {
    "told.x-of-one": "cross-type.both.2d",
    "told.eta-exchanged": "cross-type.both.2d",
    "told.pairs-left-out": "cross-type.both.2d",
    "told.energy-unset": "ideal-gas.beside-tait",
    "told.timestep-off": "cross-type.both.2d",
    "told.gamma-of-seven": "density.two.2d",
    "told.range-ends-late": "ranges.background-override",
    "read.single-drho": "forces.all.quintic.2d",
    "read.stale-v": "cross-type.both.2d",
    "read.nan-output-stress-t": "forces.all.quintic.2d",
    "read.one-off-output-temperature": "thermal.freezing.2d",
    "read.swapped-rho": "cross-type.both.2d",
    "read.axes-x": "cross-type.both.2d",
    "read.single-output-surface-r": "surfaces.shifted.periodic",
}


class FaultyJudge(WorkerJudge):
    """The ordinary verdict on a LAMMPS with a fault in its input or output; an empty name means no fault."""

    def __init__(self, workers: Workers, fault: str = "") -> None:
        super().__init__(workers, Engine())
        self.fault = fault

    def __call__(self, case: Case) -> CaseRecord:
        ready = prepared_case.prepare(case)
        told, read = input_faults.faults().get(self.fault), output_faults.faults().get(self.fault)
        outcomes = self.answers(ready, (input_faults.jobs(told, ready) if told else None) or ready.jobs)
        if read and isinstance(outcomes[0], Answer):
            outcomes = [output_faults.applied(read, outcomes[0]) or outcomes[0], *outcomes[1:]]
        return PerturbedJudge(self.engine).verdict(PerturbedCase(ready, ()), outcomes)


def loaded(shrunk: Shrunk, folder: Path) -> Case:
    """The case in the file written."""
    file = folder / f"{shrunk.case.name}.yaml"
    file.write_text(shrunk.text)
    (case,) = casefile.load((file,))
    return case


@pytest.mark.lammps
@pytest.mark.slow
def test_planted_faults_shrink_to_few_particles_and_steps(workers: Workers, tmp_path: Path) -> None:
    assert len(PLANTED) >= 10
    sizes = {}
    for fault, name in PLANTED.items():
        judge = FaultyJudge(workers, fault)
        shrunk = shrink(CASES[name], judge)
        small = loaded(shrunk, tmp_path)
        assert small.name == name
        assert failure_mode(judge(small)) == shrunk.failure, fault
        assert FaultyJudge(workers)(small).as_expected, fault  # of the fault, not of the removed parts
        assert shrunk.complete
        sizes[fault] = shrunk.after
        assert shrunk.after.particles <= shrunk.before.particles and shrunk.after.steps <= shrunk.before.steps
    assert median(after.particles for after in sizes.values()) <= 4, sizes
    assert median(after.steps for after in sizes.values()) <= 1, sizes
    assert sizes["told.timestep-off"].steps == 1
    assert sizes["told.pairs-left-out"].particles == 2


@pytest.mark.lammps
def test_shrinking_is_deterministic_and_minimal(workers: Workers, tmp_path: Path) -> None:
    judge = FaultyJudge(workers, "told.gamma-of-seven")
    shrunk = shrink(CASES["density.two.2d"], judge)
    assert shrink(CASES["density.two.2d"], judge).text == shrunk.text
    again = shrink(loaded(shrunk, tmp_path), judge)
    assert (again.after, again.content) == (shrunk.after, shrunk.content)


@pytest.mark.lammps
@pytest.mark.slow
def test_command_writes_a_file_that_shows_the_finding(eos_ref_command: Run, tmp_path: Path) -> None:
    file = tmp_path / "small" / "force.yaml"
    left = eos_ref_command("shrink", "forces.all.rk1.2d", "--finding", "force-per-volume", "--out", file, "--json")
    assert left.code == 0, left.err
    report = json.loads(left.out)
    assert report["failure"]["finding"] == "force-per-volume"
    assert report["before"]["particles"] == 80 and report["before"]["steps"] == 10
    assert report["after"]["particles"] <= 2 and report["after"]["steps"] == 0
    assert report["reproduce"] == f"eos-ref run --cases {file} forces.all.rk1.2d"
    run = eos_ref_command("run", "--cases", file, "--out", tmp_path / "run", "--json")
    (case,) = json.loads(run.out)["cases"]
    assert (case["case"], case["verdict"]) == ("forces.all.rk1.2d", "explained")
    assert {name for field in case["fields"] for name in field["explained_by"]} == {"force-per-volume"}
    words = eos_ref_command("shrink", "forces.all.rk1.2d", "--cases", file, "--out", tmp_path / "again.yaml")
    assert words.code == 0
    assert "shows force-per-volume" in words.out and "particles" in words.out and "reproduce: eos-ref run" in words.out


@pytest.mark.lammps
def test_shrunk_refusal_still_breaks_the_rule(eos_ref_command: Run, tmp_path: Path) -> None:
    file = tmp_path / "small.yaml"
    left = eos_ref_command("shrink", "refused.range-hyphen", "--out", file, "--json")
    assert left.code == 0, left.err
    scene = yaml.safe_load(file.read_text())["scene"]
    assert len(scene["positions"]["x"]) == 1
    assert any("-" in str(entry["types"]) for entry in scene["pressure"])


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("near-rho0.linear.2d",), ("must be red", "as expected")),
        (
            ("forces.all.rk1.2d", "--finding", "cross-type-support"),
            ("must show cross-type-support", "force-per-volume"),
        ),
        (("forces.all.rk1.2d", "--finding", "force-per-volum"), ("no such finding", "did you mean 'force-per-volume'")),
        (("near-rho0",), ("must be a single case", "selects")),
        (("near-rho1.linear.2d",), ("no such case",)),
        (("near-rho0.linear.2d", "--out", "."), ("must be a file",)),
    ],
)
def test_unshrinkable_case_gives_a_one_line_message(
    arguments: tuple[str, ...], parts: tuple[str, ...], eos_ref_command: Run, tmp_path: Path
) -> None:
    out = () if "--out" in arguments else ("--out", tmp_path / "small.yaml")
    left = eos_ref_command("shrink", *arguments, *out)
    assert left.code == 2
    (line,) = left.err.strip().splitlines()
    assert all(part in line for part in parts), line
    assert not (tmp_path / "small.yaml").exists()


# --- without LAMMPS


def test_listed_particles_equal_the_generated_ones(tmp_path: Path) -> None:
    for name in ("cross-type.both.2d", "ideal-gas.beside-tait", "thermal.freezing.2d"):
        case = CASES[name]
        content = written_out(case)
        file = tmp_path / "small.yaml"
        file.write_text(candidate.document(content, name, "The same."))
        (same,) = casefile.load((file,))
        one, other = prepared_case.prepare(case).atoms, prepared_case.prepare(same).atoms
        assert same.name == name
        for array in ("x_nc", "v_nc", "rho_n", "type_n", "low_c", "high_c"):
            assert repr(getattr(one, array)) == repr(getattr(other, array)), (name, array)
        assert one.spacing == other.spacing
        found = as_case(content, case)
        assert found is not None and found.scene == same.scene


@pytest.mark.slow
def test_shrunk_case_keeps_name_and_seeds(tmp_path: Path) -> None:
    content = line_of(1, types=[{"mass": 1.0}], pressure=[{"types": "*", "style": "linear"}])
    names = (*CASES, "a.1e-5.2.true.null")
    for name in names:
        (tmp_path / "small.yaml").write_text(candidate.document(content, name, f"Shrunk from {name}: 1.0"))
        (case,) = casefile.load((tmp_path / "small.yaml",))
        assert case.name == name


def line_of(n: int, **more: Any) -> Content:
    """Particles in a row, of two alternating types."""
    return {
        "dimension": 2,
        "types": [{"mass": 1.0}, {"mass": 2.5}],
        "positions": {
            "x": [[k + 0.5, 0.123456] for k in range(n)],
            "types": [1 + k % 2 for k in range(n)],
            "low": [0.0, 0.0],
            "high": [float(n), 4.0],
        },
        "pressure": [{"types": 1, "style": "linear"}, {"types": "2*", "style": "cubic", "A3": 0.7}],
        "rho": {"values": [1.0 + 0.01 * k for k in range(n)]},
        **more,
    }


def failing_if(rule: Callable[[Content], bool], atom: int | None = None, step: int | None = None) -> Any:
    def fails(content: Content) -> FailureMode | None:
        case = as_case(content, CASES["density.two.2d"])
        return FailureMode("differs", atom=atom, step=step) if case and rule(content) else None

    return fails


def test_needed_particles_stay() -> None:
    needed = {1.03, 1.17, 1.3}

    def rule(content: Content) -> bool:
        return needed <= {round(value, 2) for value in content["rho"]["values"]}

    small = fewer_particles(line_of(40), failing_if(rule, atom=18))
    assert {round(value, 2) for value in small["rho"]["values"]} == needed
    assert [round(x, 1) for x, _ in small["positions"]["x"]] == [3.5, 17.5, 30.5]
    assert small["positions"]["types"] == [2, 2, 1]


@pytest.mark.parametrize(("fails_from", "first", "left"), [(0, 0, 0), (1, 1, 1), (7, 7, 7), (7, None, 7), (40, 40, 40)])
def test_steps_end_at_the_first_failure(fails_from: int, first: int | None, left: int) -> None:
    evolve = {"steps": 40, "timestep": 0.1}
    fails = failing_if(lambda content: content.get("evolve", {}).get("steps", 0) >= fails_from, step=first)
    assert fewer_steps(line_of(3, evolve=evolve), fails).get("evolve", {}).get("steps", 0) == left


def test_removed_types_take_their_laws_and_ranges_along() -> None:
    forces = [{"style": "gravity", "vector": [0.0, 1.0], "types": "2"}, {"style": "gravity", "vector": [1.0, 0.0]}]
    content = line_of(4, forces=forces, rheo={"shift": {"exclude": ["1"]}})

    def rule(content: Content) -> bool:
        return any(entry["style"] == "cubic" for entry in content["pressure"]) and 2.5 in [
            t["mass"] for t in content["types"]
        ]

    small = fewer_types(content, failing_if(rule))
    assert small["types"] == [{"mass": 2.5}]
    assert small["positions"]["types"] == [1, 1, 1, 1]
    assert small["pressure"] == [{"types": "*", "style": "cubic", "A3": 0.7}]
    assert small["forces"] == [forces[0] | {"types": "*"}, forces[1]]
    assert small["rheo"]["shift"]["exclude"] == []


def test_numbers_keep_significant_digits() -> None:
    content = line_of(2)
    small = fewer_digits(content, failing_if(lambda c: abs(c["pressure"][1]["A3"] - 0.7) < 0.05))
    assert small["pressure"][1]["A3"] == 0.7
    assert small["types"] == [{"mass": 1.0}, {"mass": 1.0}]
    assert size(small).digits < size(content).digits
    fine = replaced_value(content, 0.71234567)
    assert (
        fewer_digits(fine, failing_if(lambda c: abs(c["pressure"][1]["A3"] - 0.7123) < 1e-4))["pressure"][1]["A3"]
        == 0.7123
    )


def replaced_value(content: Content, value: float) -> Content:
    return candidate.replaced(content, ("pressure", 1, "A3"), value)


def test_same_failure_means_same_field_and_verdict() -> None:
    def record(field: str, atom: int, **more: Any) -> CaseRecord:
        blame = Blame(field=field, stage="pair", atom=atom, step=atom, outside=1, of=2)
        return CaseRecord.model_validate({"case": "x", "verdict": "differs", "blame": blame, **more})

    assert failure_mode(record("f", 1)) == failure_mode(record("f", 2))
    assert failure_mode(record("f", 1)) != failure_mode(record("drho", 1))
    unbounded = record("f", 1)
    assert unbounded.blame is not None
    unbounded.blame.bound = float("inf")
    assert failure_mode(unbounded) != failure_mode(record("f", 1))
    assert failure_mode(CaseRecord(case="x", verdict="pass")) is None
    assert failure_mode(CaseRecord(case="x", verdict="explained", explained_by=["a"]), "b") is None
    refused = [
        CaseRecord(case="x", verdict="refused", ended="refused", engine_error=f"ERROR: {text}")
        for text in ("atom 12 lost at 0.5", "atom 3 lost at 1e-3", "no such fix")
    ]
    one, other, another = map(failure_mode, refused)
    assert one == other != another
    crashed = [
        CaseRecord(case="x", verdict="crashed", ended="crashed", engine_error=text, died=signal)
        for text, signal in (("one text", "SIGSEGV"), ("another", "SIGSEGV"), ("one text", "SIGABRT"))
    ]
    one, other, another = map(failure_mode, crashed)
    assert one == other != another


def test_several_findings_require_a_choice() -> None:
    explained = CaseRecord(case="x", verdict="explained", ended="refused", explained_by=["a", "b"])
    with pytest.raises(InputError, match=r"choose one by --finding \(a, b\)"):
        shrink(CASES["density.two.2d"], lambda case: explained)


def test_rules_broken_by_a_scene() -> None:
    assert rule_broken(CASES["density.two.2d"].scene) == ()
    assert rule_broken(CASES["refused.no-fix-rheo"].scene) == ("no-fix-rheo",)
    assert rule_broken(CASES["refused.range-hyphen"].scene) != rule_broken(CASES["refused.range-beyond"].scene) != ()
