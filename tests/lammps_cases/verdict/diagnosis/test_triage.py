"""Planted faults, unknown to the triage: it groups them, and names the cause among its hypotheses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOSTable
from eos_ref.eos import rounded_eos
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model import interactions
from eos_ref.numbers.elementary import where
from eos_ref.numbers.number import Array
from lammps_cases.records import wording
from lammps_cases.records.case_parts import Blame
from lammps_cases.records.files import write_arrays
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord, Triage, read_run
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.changes import Change
from lammps_cases.verdict.diagnosis import laws, trials
from lammps_cases.verdict.diagnosis.edits import FunctionEdits
from lammps_cases.verdict.diagnosis.reached import reached
from lammps_cases.verdict.diagnosis.triage import in_common, triage
from tests.support.outcome import Outcome
from tests.support.planted import red_run

Run = Callable[..., Outcome]


class TwiceTheViscosity(ArrayEvaluator):
    def viscosity(self, gradient_ncc: Array | None = None) -> Array:
        return super().viscosity(gradient_ncc) + super().viscosity(gradient_ncc)


class SoundOfTypeOne(ArrayEvaluator):
    def eos_pressure(self, rho_n: Array, e_n: Array | None) -> Array:
        first = self.model.eos[1]
        table = EOSTable(tuple(replace(law, cs=first.cs) for law in self.model.eos))
        return rounded_eos.by_type(rounded_eos.pressure, table, self.type_n, rho_n, e_n)


class OwnVolumeInGradients(ArrayEvaluator):
    def gradients(self, *arguments: Any, **options: Any) -> Any:
        self.own = True
        try:
            return super().gradients(*arguments, **options)
        finally:
            self.own = False

    def density_pair(self, rho_n: Array) -> tuple[Array, Array]:
        rho_i, rho_j = super().density_pair(rho_n)
        if getattr(self, "own", False):
            return rho_i, rho_j * 0 + self.mass_n[self.j] / (self.mass_n[self.i] / rho_i)
        return rho_i, rho_j


class OwnMassesSummed(ArrayEvaluator):
    def kernel_sum(self, weight_n: Array | None = None) -> Array:
        return self.total(self.mass_n[self.i] * self.w)


class DiffusionWithoutOtherTypes(ArrayEvaluator):
    def diffusion(self, rho_n: Array, volume_j: Array, F: Array, grad: Any) -> Array:
        same = self.type_n[self.i] == self.type_n[self.j]
        return super().diffusion(rho_n, where(same, volume_j, 0.0), F, grad)


class HalfHeat(ArrayEvaluator):
    def heated_volume(self, rho_i: Array, rho_j: Array) -> Array:
        return self.mass_n[self.i] / (rho_i + rho_i)


class OwnConductivity(ArrayEvaluator):
    def pair_terms(self, fields: Any) -> Any:
        terms = super().pair_terms(fields)
        F = sum(x_p * g_p for x_p, g_p in zip(self.x, self.g, strict=True)) / self.rr
        rho_i, rho_j = self.density_pair(fields.rho_n)
        kappa, T_n = self.conduction()[self.i], fields.temperature_n
        flow = interactions.heat_term(kappa, self.mass_n[self.i] / rho_i, self.mass_n[self.j] / rho_j, F)
        return replace(terms, heat_n=self.total(flow * (T_n[self.i] - T_n[self.j])))


class ShiftTheOtherWay(ArrayEvaluator):
    def raw_shift(self, v: Any, rho_n: Array) -> Any:
        return [-shift_n for shift_n in super().raw_shift(v, rho_n)]


class PlainKernelInForces(ArrayEvaluator):
    def pair_terms(self, fields: Any) -> Any:
        corrected, self.g = self.g, list(self.gradw)
        terms = super().pair_terms(fields)
        self.g = corrected
        return terms


class NoFirstKick(Simulation):
    def step(self, dt: float) -> None:
        f_nc = self.fields["f"]
        self.fields["f"] = 0 * f_nc
        kept = self.state.v_nc
        self.state.v_nc = kept - 0.5 * dt * (f_nc / self.mass_n[:, None])
        self.fields["f"] = f_nc
        super().step(dt)


class OldViscosity(Simulation):
    def _forces(self) -> None:
        now_n = self.fields["viscosity"]
        self.fields["viscosity"] = getattr(self, "old_n", now_n)
        super()._forces()
        self.old_n = self.fields["viscosity"] = now_n


class WrongTwice(ArrayEvaluator):
    """Viscous forces doubled, and pressures with the opposite sign."""

    def pair_terms(self, fields: Any) -> Any:
        fields = fields._replace(pressure_n=-fields.pressure_n, viscosity_n=fields.viscosity_n + fields.viscosity_n)
        return super().pair_terms(fields)


class SquaredDistance(ArrayEvaluator):
    """A change that no factor, exchange or omission produces."""

    def viscosity(self, gradient_ncc: Array | None = None) -> Array:
        plain = super().viscosity(gradient_ncc)
        return plain * (1 + 0.1 * np.sin(np.arange(self.n)))


@dataclass(frozen=True)
class Planted:
    cases: tuple[str, ...]
    cause: str
    stages: type[ArrayEvaluator] = ArrayEvaluator
    stepping: type[Simulation] = Simulation


PLANTED = [
    Planted(
        ("forces.viscous.quintic.2d", "forces.viscous.rk1.2d"),
        "had `2 * eta_n` for `eta_n`",
        TwiceTheViscosity,
    ),
    Planted(("forces.pressure.quintic.2d", "shift.all.2d"), "used the speed of sound of type 1", SoundOfTypeOne),
    Planted(
        ("forces.pressure.quintic.2d", "forces.viscous.quintic.2d"),
        "had `self.mass_n[self.i] / rho_i` for `self.mass_n[self.j] / rho_j`",
        OwnVolumeInGradients,
    ),
    Planted(("density.two.2d", "shift.sum.2d"), "density sum with the own mass", OwnMassesSummed),
    Planted(
        ("forces.damp.quintic.2d", "forces.damp.rk0.2d"),
        "* where(self.type_n[self.i] != self.type_n[self.j], 0.0, 1.0)",
        DiffusionWithoutOtherTypes,
    ),
    Planted(("thermal.arithmetic.2d", "thermal.rk1.2d"), "heat flow without the factor 2", HalfHeat),
    Planted(("thermal.arithmetic.2d", "thermal.latent.2d"), "own conductivity in place of the mean", OwnConductivity),
    Planted(("shift.all.2d", "shift.exclude.2d"), "shift of the other sign", ShiftTheOtherWay),
    Planted(
        ("forces.viscous.rk1.2d", "forces.viscous.rk2.2d"),
        "had `self.gradw` for `self.g` in all its statements",
        PlainKernelInForces,
    ),
    Planted(("images.quintic.two", "images.quintic.four"), "first half of the kick", stepping=NoFirstKick),
    Planted(("forces.power.quintic.2d", "forces.power.rk0.2d"), "viscosities of the eval", stepping=OldViscosity),
]


@pytest.mark.slow
@pytest.mark.parametrize("fault", PLANTED, ids=lambda fault: fault.cause)
def test_cause_is_among_the_hypotheses(fault: Planted, tmp_path: Path) -> None:
    run = red_run(tmp_path, fault.cases, fault.stages, fault.stepping)
    assert run.triage is not None
    named = [each.sentence for group in run.triage.groups for each in group.hypotheses]
    assert any(fault.cause in sentence for sentence in named), named


def test_two_edits_are_found_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def of_two_terms(types: int, run: Callable[[], object]) -> Iterator[Change]:
        for found in reached(run):
            if found.function.__name__ in ("pair_terms", "viscous_term"):
                path = f"{found.function.__module__}:{found.function.__qualname__}"
                edits = FunctionEdits(path, found.scope, found.words)
                yield from (edit for edit in edits if "in `p_sum = pres" in edit.what or "in `return 2" in edit.what)

    monkeypatch.setattr(trials, "candidates", of_two_terms)
    run = red_run(tmp_path, ("images.quintic.two", "images.quintic.four"), WrongTwice)
    assert run.triage is not None
    (group,) = run.triage.groups
    both = group.hypotheses[0].sentence.split(" and ")
    assert len(both) == 2 and "viscous_term" in group.hypotheses[0].sentence, both


@pytest.mark.slow
def test_fault_beyond_all_edits_gets_no_hypothesis(tmp_path: Path) -> None:
    run = red_run(tmp_path, ("images.quintic.four", "forces.viscous.quintic.2d"), SquaredDistance, seconds=10.0)
    assert run.triage is not None
    assert sum(len(group.cases) for group in run.triage.groups) == 2
    assert not any(group.hypotheses for group in run.triage.groups)
    assert any("no hypothesis: none of" in line for line in wording.triage_lines(run))


def test_green_run_has_no_triage(tmp_path: Path) -> None:
    run = red_run(tmp_path, ("images.quintic.two",))
    assert run.triage is None
    assert list(wording.triage_lines(run)) == []


@pytest.mark.lammps
def test_diagnose_has_nothing_to_group_in_a_green_run(tmp_path: Path, eos_ref_command: Run) -> None:
    assert eos_ref_command("run", "near-rho0.linear.2d", "--out", tmp_path / "report").code == 0
    assert "nothing to group" in eos_ref_command("diagnose", tmp_path / "report").out


@pytest.mark.slow
def test_features_common_to_red_and_absent_from_green_scenes(tmp_path: Path, eos_ref_command: Run) -> None:
    names = ("shift.all.2d", "images.shift.two", "images.shift.four", "images.quintic.two", "images.quintic.four")
    run = red_run(tmp_path / "fields", names, ShiftTheOtherWay)
    assert run.triage is not None
    (group,) = run.triage.groups
    assert group.cases == ["images.shift.four", "images.shift.two", "shift.all.2d"]
    assert (group.common, group.green_with, group.green) == (["`rheo.shift`"], 0, 2)
    assert wording.in_common(group) == "all 3 scenes with `rheo.shift`; none of 2 others"
    (tmp_path / "run.json").write_text(run.model_copy(update={"triage": None}).to_json())
    told = eos_ref_command("diagnose", tmp_path)
    assert told.code == 1
    assert "as if the reference made the mistake: shift of the other sign" in told.out
    assert read_run(tmp_path).triage == run.triage
    assert "all 3 scenes with `rheo.shift`; none of 2 others" in (tmp_path / "report.html").read_text()
    assert "### Triage" in (tmp_path / "summary.md").read_text()


def test_several_features_are_named_if_one_is_not_enough() -> None:
    red = [{"a", "b", "x"}, {"a", "b", "y"}]
    green = [{"a", "x"}, {"b", "y"}, {"a"}]
    found = in_common(red, green)
    assert (set(found.features), found.green) == ({"a", "b"}, 0)
    assert in_common(red, [*green, {"a", "b"}]).green == 1


def test_failures_are_grouped_by_their_error() -> None:
    error = "ERROR: one (src/a.cpp:1)\nLast input line: x"
    records = [CaseRecord(case=f"made.{k}", verdict="refused", ended="refused", engine_error=error) for k in range(3)]
    records.append(CaseRecord(case="made.other", verdict="crashed", ended="crashed", engine_error="signal 11"))
    run = RunRecord(engine=EngineRecord(), reference={}, cases=records)
    made = triage(run, [], Path())
    assert isinstance(made, Triage)
    assert [(len(group.cases), group.verdict) for group in made.groups] == [(3, "refused"), (1, "crashed")]
    assert wording.hypotheses(made.groups[0]) == ["no hypothesis: nothing to try formulas on"]


def test_cases_of_laws_and_of_the_model_are_grouped_separately() -> None:
    """Only the former have the energies that a law needs."""
    blame = {"field": "pressure_used", "stage": "eos", "atom": 1, "lammps": 2.0, "reference": 1.0, "bound": 1e-9}
    steps = {"law.one": None, "law.two": None, "model": 0, "model.later": 3}
    records = [
        CaseRecord(case=name, verdict="differs", blame=Blame(**blame, step=step, outside=1, of=1))
        for name, step in steps.items()
    ]
    made = triage(RunRecord(engine=EngineRecord(), reference={}, cases=records), [], Path())
    assert isinstance(made, Triage)
    assert [group.cases for group in made.groups] == [["law.one", "law.two"], ["model"], ["model.later"]]


# --- hypotheses about laws

ONE = {"mass": 1.3, "rho0": 1.2, "cs": 3.1}
LINEAR, GAS = {"types": "*", "style": "linear"}, {"types": "*", "style": "ideal/gas", "gamma": 1.4}


def red(case: Case, folder: Path) -> CaseRecord:
    """Return a case in which all pressures are twice the correct ones; energies are not saved."""
    atoms = prepare(case).atoms
    p_n = case.scene.eos(case.where).pressure(atoms.rho_n, atoms.type_n, np.ones_like(atoms.rho_n))
    arrays = {"id": atoms.id_n, "type": atoms.type_n, "rho": atoms.rho_n, "mass": atoms.mass_n}
    arrays |= {"pressure.lammps": 2 * p_n, "pressure.bound": 1e-14 * abs(p_n)}
    write_arrays(folder / f"{case.name}.npz", arrays)
    blame = Blame(field="pressure", stage="eos", atom=1, outside=1, of=1, lammps=2.0, reference=1.0, bound=1e-14)
    return CaseRecord(case=case.name, verdict="differs", blame=blame)


@pytest.mark.parametrize(("law", "energy", "reproduced"), [(LINEAR, None, {"three", "one"}), (GAS, 1.0, {"three"})])
def test_change_is_not_tried_on_scenes_where_it_is_meaningless(
    law: dict[str, Any], energy: float | None, reproduced: set[str], tmp_path: Path, case_file: Callable[..., Path]
) -> None:
    """A scene of one type next to one of three; an ideal gas whose energies are not available."""
    one = {"types": [ONE], "pressure": [law], "energy": energy and {"constant": energy}}
    files = case_file("three", types=[ONE, ONE, ONE], pressure=[LINEAR]), case_file("one", **one)
    cases = {case.name: case for file in files for case in casefile.load_file(file)}
    tried, found = laws.hypotheses([red(case, tmp_path) for case in cases.values()], cases, tmp_path)
    assert tried > 40 and found.cases == reproduced
    assert "the pressure of every particle were twice as large" in found.sentences
