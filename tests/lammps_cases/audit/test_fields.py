"""The audit of fields other than the pressure: test decks on real LAMMPS, with faults planted on either side."""

from __future__ import annotations

import functools
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from eos_ref import EOS, EOSTable, InputError, parse_fix_rheo
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Thermal, Viscosity
from eos_ref.model.state import State
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit import deck, fields, share, supervise
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.options import AuditOptions, AuditResult, AuditTask
from lammps_cases.audit.supervise import audit_deck
from tests.support.audited_decks import DECKS, case_of, run_plain, written
from tests.support.pages import unpacked

pytestmark = pytest.mark.lammps

SURFACE = {"surface", "surface/r", "surface/n", "surface/divr"}
STRESS = {"grad/v", "viscosity", "stress/v", "stress/t"}
HEAT = {"conductivity", "cv", "temperature"}
EVERYWHERE = {"coordination", "pressure"}
MOVED = "wall-velocity-lost"
# Fields checked in each deck, and what the ledger has to explain.
FOUND: dict[str, tuple[set[str], dict[str, str]]] = {
    "summed": (EVERYWHERE | SURFACE | STRESS | {"rho", "shift/v", "drho", "f"}, {"f": "force-per-volume"}),
    "walls_quintic": (
        EVERYWHERE | STRESS | {"chi", "shift/v", "drho", "f"},
        dict.fromkeys(("grad/v", "stress/v", "stress/t"), MOVED) | {"f": f"force-per-volume, {MOVED}"},
    ),
    "walls_summed": (
        EVERYWHERE | STRESS | {"rho", "chi", "shift/v", "drho", "f"},
        dict.fromkeys(("grad/v", "stress/v", "stress/t"), MOVED) | {"f": f"force-per-volume, {MOVED}"},
    ),
    "walls_corrected": (EVERYWHERE | {"viscosity", "chi", "shift/v"}, {}),
    "tilted": (EVERYWHERE | STRESS | {"shift/v", "drho", "f"}, {"f": "force-per-volume"}),
    "power": (
        EVERYWHERE | SURFACE | STRESS | HEAT | {"heatflow", "drho", "f"},
        {"f": "force-per-volume", "heatflow": "heat-is-temperature-rate"},
    ),
    "gas": (EVERYWHERE | STRESS | HEAT | {"drho", "f"}, {"f": "force-per-volume"}),
    "overlay": (EVERYWHERE | STRESS | {"drho", "f"}, {"f": "force-per-volume"}),
}


@functools.cache
def audited(name: str, folder: Path) -> AuditResult:
    """Audit all fields of a deck of the tests; its output is kept in ``folder``."""
    return audit_deck(DECKS / f"in.{name}", AuditOptions(keep=folder, fields=("all",)))


@pytest.fixture(scope="session")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    return functools.cache(lambda name: tmp_path_factory.mktemp(name))


# --- every field that can be checked is


@pytest.mark.parametrize("name", FOUND)
def test_every_field_is_compared(name: str, kept: Callable[[str], Path]) -> None:
    case = case_of(audited(name, kept(name)))
    checked, explained = FOUND[name]
    assert {field.field for field in case.fields} == checked
    assert {f.field: ", ".join(f.explained_by) for f in case.fields if f.verdict == "explained"} == explained
    assert all(f.verdict in ("exact", "pass") for f in case.fields if f.field not in explained)
    assert all((f.max_over_bound or 0) < 1 for f in case.fields if f.field not in explained)
    touched = {effect.finding for effect in case.effects if effect.field not in checked}  # a known bug, unseen
    assert case.verdict == ("explained" if explained or touched else "pass")
    named = {line.partition(":")[0].removesuffix(" with all that adds to it") for line in case.not_checked}
    assert named | checked == set(fields.offered())


def test_fields_have_values(kept: Callable[[str], Path]) -> None:
    """A comparison of zeros would pass, too."""
    summed = audited("summed", kept("summed")).arrays
    assert set(np.unique(summed["surface.lammps"])) == {0.0, 1.0, 2.0}
    for field in ("shift/v", "grad/v", "surface/n", "surface/r", "stress/v"):
        assert np.abs(summed[f"{field}.lammps"]).max() > 1e-6
    walls = audited("walls_quintic", kept("walls_quintic")).arrays
    assert 0.3 < walls["chi.lammps"].min() < 0.9 and np.abs(walls["drho.lammps"]).max() > 1e-6
    power = audited("power", kept("power")).arrays
    assert len(np.unique(power["viscosity.lammps"][power["type"] == 1])) > 16
    assert np.abs(power["heatflow.lammps"]).max() > 1e-6


def test_samples_of_one_step_are_independent(kept: Callable[[str], Path]) -> None:
    """A second set-up invokes the callback twice on a step, with different half-step velocities; both samples agree."""
    checks = [c for c in case_of(audited("summed", kept("summed"))).checks if c.field == "grad/v"]
    assert [(c.run, c.step) for c in checks] == [(1, 0), (1, 10), (1, 20), (2, 20), (2, 30), (2, 30), (2, 40)]
    assert all(c.verdict == "pass" and c.natoms == 75 for c in checks)


def test_set_up_with_summed_wall_densities(kept: Callable[[str], Path]) -> None:
    """LAMMPS then outputs densities of solids that it did not use: only fluid is judged, and density not at all."""
    checks = case_of(audited("walls_summed", kept("walls_summed"))).checks
    first = {(c.field, c.type): c.natoms for c in checks if c.step == 0}
    assert first == {("coordination", 0): 64, ("rho", 0): 22, ("chi", 0): 64, ("viscosity", 0): 64, ("pressure", 1): 22}
    later = {(c.field, c.type): c.natoms for c in checks if c.step == 10}
    assert later["pressure", 2] == 42 and later["grad/v", 0] == 64 and later["rho", 0] == 22


def test_atoms_off_the_plane(kept: Callable[[str], Path]) -> None:
    """Atoms deposited into a slab lie off the plane of a 2D deck: fields near them are not two-dimensional."""
    case = case_of(audited("deposit", kept("deposit")))
    assert "atoms of this 2D deck have neighbours at another height" in case.warnings[-1]
    assert {c.step for c in case.checks if c.field == "grad/v"} == {0}
    assert {c.step for c in case.checks if c.field == "pressure"} == {0, 10, 20, 30, 33, 40}
    assert all(field.verdict in ("exact", "pass", "explained") for field in case.fields)


# --- the audit changes nothing


@pytest.mark.parametrize("name", [*FOUND, "deposit", "loop", "systems"])
def test_deck_does_the_same_as_without_audit(name: str, kept: Callable[[str], Path], tmp_path: Path) -> None:
    shutil.copytree(DECKS, tmp_path / "plain")
    run_plain(f"in.{name}", tmp_path / "plain")
    audited(name, kept(name))
    expected = written(tmp_path / "plain")
    assert len(expected) >= 2 and written(kept(name)) == expected


# --- planted faults, in the process that runs the deck


def _wrong(plant: Callable[[Any], None], task: AuditTask, connection: Connection) -> None:
    from lammps_cases.audit import child, sample

    plant(sample)
    child.main(task, connection)


def _damage(field: str, sample: Any) -> None:
    right = sample.Sampler.shown
    calls: list[int] = []

    def wrong(self: Any, n: int) -> Any:
        shown = right(self, n)
        calls.append(n)
        if len(calls) > 1:  # from the second sample on
            row = self.lmp.numpy.extract_atom("id")[:n].tolist().index(17)
            values = shown[field].reshape(n, -1)
            values[row, -1] += 1 if field == "coordination" else 1e-9
        return shown

    sample.Sampler.shown = wrong


def _thicker(sample: Any) -> None:
    right = sample.Sampler.__init__

    def wrong(self: Any, lmp: Any, names: Any, model: Model, *rest: Any) -> None:
        one, two = model.viscosity
        right(self, lmp, names, replace(model, viscosity=(replace(one, K=one.K * (1 + 1e-10)), two)), *rest)

    sample.Sampler.__init__ = wrong


def _heavier(sample: Any) -> None:
    right = sample.Sampler.take

    def wrong(self: Any, *arguments: Any) -> Any:
        taken = right(self, *arguments)
        self.last = replace(taken, mass_n=taken.mass_n * (1 + 1e-12))
        return self.last

    sample.Sampler.take = wrong


# --- forces to which other styles add


def _second_only(plant: Callable[[Any], None], task: AuditTask, connection: Connection) -> None:
    if task.deck == share.SCRIPT:
        _wrong(plant, task, connection)
    from lammps_cases.audit import child

    child.main(task, connection)


def _one_force(sample: Any) -> None:
    right = sample.Sampler.shown

    def wrong(self: Any, n: int) -> Any:
        shown = right(self, n)
        shown["f"][self.lmp.numpy.extract_atom("id")[:n].tolist().index(17)] += 1e-9
        return shown

    sample.Sampler.shown = wrong


def soft_forces(x_nc: Any, edge: float, amplitude: float, cut: float) -> Any:
    """Forces of E = A (1 + cos(pi r/cut)) in a periodic square, (n, 2)."""
    apart = x_nc[:, None] - x_nc[None]
    apart -= edge * np.round(apart / edge)
    r = np.sqrt((apart**2).sum(axis=2))
    np.fill_diagonal(r, np.inf)
    size = np.where(r < cut, amplitude * np.pi / cut * np.sin(np.pi * np.minimum(r, cut) / cut) / r, 0.0)
    return (size[..., None] * apart).sum(axis=1)


def test_force_of_pair_rheo_is_the_remainder_of_the_total(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results: list[AuditResult] = []
    audit = supervise.audit_deck

    def kept(*given: Any) -> AuditResult:
        results.append(audit(*given))
        return results[-1]

    monkeypatch.setattr(supervise, "audit_deck", kept)
    case = case_of(audit(DECKS / "in.overlay", AuditOptions(keep=tmp_path)))
    rows = np.loadtxt(tmp_path / "final.dump", skiprows=9)
    rows = rows[np.argsort(rows[:, 0])]
    second = results[0].arrays
    periods = (second["x"] - rows[:, 2:5]) / 8
    assert np.array_equal(second["type"], rows[:, 1]) and np.array_equal(periods, np.round(periods))
    edge, amplitude, cut = 8.0, 0.5, 1.2
    total = second["f.lammps"] + soft_forces(rows[:, 2:4], edge, amplitude, cut)
    # Of each of the other particles: ten roundings of its force, and those of two places, which change it by pi/cut.
    size, moved = amplitude * np.pi / cut, 2 * edge * np.pi / cut
    assert np.abs(total - rows[:, 8:10]).max() < 2 * len(rows) * (10 + moved) * 2.0**-53 * size
    assert np.abs(second["f.lammps"] - rows[:, 8:10]).max() > 0.01
    looks = [(check.run, check.step) for check in case.checks if check.field == "f"]
    assert looks == [(1, 20)]
    told = next(line for line in case.not_checked if line.startswith("f "))
    assert told.startswith(
        "f with all that adds to it: pair_style soft adds to it; compared is that of pair_style rheo"
    )


def test_wrong_force_of_pair_rheo_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", functools.partial(_second_only, _one_force))
    case = case_of(audit_deck(DECKS / "in.overlay", AuditOptions()))
    assert case.verdict == "differs" and {f.field for f in case.fields if f.verdict == "differs"} == {"f"}
    assert case.blame is not None and (case.blame.field, case.blame.step) == ("f", 20)


@pytest.mark.parametrize(
    "commands, asked",
    [
        ("", True),
        ("bond_style harmonic", False),
        ("pair_coeff 1 1 rheo", True),
        ("fix 8 all wall/harmonic ylo EDGE 1 1 1", True),
        ("neigh_modify exclude type 1 1", False),
        ("unfix 2\nfix 2 half rheo/viscosity * constant 0.1", False),
        ("pair_style soft 1.2", False),
    ],
)
def test_when_force_of_pair_rheo_is_available(commands: str, asked: bool) -> None:
    assert share.can_be_had(followed(MODEL + commands)) is asked


def test_words_of_pair_rheo_in_a_hybrid_style() -> None:
    assert deck.rheo_words(followed(MODEL).pair) == ["rheo", "3.0", "artificial/visc", "0.1", "harmonic/means"]


def test_failure_of_the_second_lammps_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    write = share.write
    monkeypatch.setattr(share, "write", lambda asked, to: write(replace(asked, commands=["bogus"]), to))
    case = case_of(audit_deck(DECKS / "in.overlay", AuditOptions(steps=1)))
    told = next(line for line in case.not_checked if line.startswith("f: "))
    assert "pair_style soft adds to it; of pair_style rheo alone" in told and "cannot be had (ERROR" in told
    assert case.verdict == "explained" and case.findings == ["force-per-volume"]  # which no sample of f contradicts


SUMMED_WRONG = ["coordination", "rho", "grad/v", "shift/v", "surface/r", "surface/n", "surface/divr", "f", "drho"]


@pytest.mark.parametrize("field", SUMMED_WRONG)
def test_one_wrong_value_is_named(field: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", functools.partial(_wrong, functools.partial(_damage, field)))
    result = audit_deck(DECKS / "in.summed", AuditOptions(fields=("all",), steps=20))
    case = case_of(result)
    assert case.verdict == "differs" and result.record.exit_code() == 1
    assert f"{field} leaves its bound first at step 10 (run 1), atom 17: 1 of 75 atoms" in case.message or field == "f"
    bad = {(check.field, check.step) for check in case.checks if check.verdict == "differs"}
    assert bad == {(field, 10), (field, 20)}
    assert int(result.arrays["step"]) == 10  # where it starts, not where the audit ends
    if field == "f":  # without the finding, which also moves all other ones out of their bounds
        assert "f leaves its bound first at step 10 (run 1)" in case.message


@pytest.mark.parametrize(
    ("plant", "name", "red"),
    [(_thicker, "power", {"viscosity", "stress/v", "stress/t", "f"}), (_heavier, "summed", {"rho", "shift/v"})],
)
def test_wrong_parameter_differs(plant: Any, name: str, red: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(supervise, "ENTRY", functools.partial(_wrong, plant))
    case = case_of(audit_deck(DECKS / f"in.{name}", AuditOptions(fields=("all",), steps=10)))
    found = {field.field for field in case.fields if field.verdict == "differs"}
    assert red <= found and not found & {"coordination", "pressure", "temperature"}
    assert "first at step 0 (run 1)" in case.message


# --- fields requested


@pytest.mark.parametrize(
    ("name", "field", "why"),
    [
        ("plain", "surface", "fix rheo has no surface/detection in this deck"),
        ("plain", "rho", "integrated over time"),
        ("plain", "x", "input to the check, not a result"),
        ("gas", "heatflow", r"fix 6 \(add/heat\) may add to it"),
        ("walls_corrected", "f", "reproducing kernels used densities of walls"),
    ],
)
def test_field_missing_from_the_deck(name: str, field: str, why: str) -> None:
    with pytest.raises(InputError, match=rf"{field}: cannot be checked in this deck: .*{why}"):
        audit_deck(DECKS / f"in.{name}", AuditOptions(fields=("pressure", field)))


def test_unknown_field_gives_a_one_line_message() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "lammps_cases.cli.main", "audit", "in.plain", "--fields", "pressure,densty"],
        cwd=DECKS,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 2 and run.stdout == ""
    (line,) = run.stderr.splitlines()
    assert "densty" in line and "must be one of all, coordination, rho, chi, grad/v" in line
    with pytest.raises(InputError, match="must name at least one"):
        AuditOptions(fields=())


def test_command_line_prints_fields(tmp_path: Path) -> None:
    from lammps_cases.cli.audit import audit_command

    arguments = [str(DECKS / "in.summed"), "--fields", "all", "--steps", "10", "--out", str(tmp_path)]
    result = CliRunner().invoke(audit_command, arguments, standalone_mode=False)
    assert result.return_value == 0, result.output
    lines = {line.split()[0]: line.split() for line in result.stdout.splitlines() if line.strip()}
    assert lines["f"][1:4] == ["all", "2", "75"] and lines["f"][-3:] == ["explained", "by", "force-per-volume"]
    assert [line for line in result.stdout.splitlines() if line.startswith("not checked")] == [
        "not checked: chi, conductivity, cv, temperature, heatflow, rho_wall, energy: fix rheo of this deck has no "
        "such feature",
        "not checked: stress/atom, virial, press, x, v, phase, status: not in any audit (the report says why)",
    ]
    page = unpacked((tmp_path / "report.html").read_text())
    assert "<td>surface/divr</td>" in page and "Not checked" in page


def test_only_chosen_fields_are_compared() -> None:
    case = case_of(audit_deck(DECKS / "in.summed", AuditOptions(fields=("surface/n", "rho"), steps=10)))
    assert [field.field for field in case.fields] == ["rho", "surface/n"] and case.verdict == "pass"
    assert "--fields rho,surface/n" in case.reproduce and case.not_checked == []


# --- what a deck says


def followed(commands: str) -> deck.Deck:
    found = deck.Deck()
    for line in commands.splitlines():
        found.note(line.split())
    return found


MODEL = """pair_style hybrid/overlay rheo 3.0 artificial/visc 0.1 harmonic/means rheo/solid
pair_coeff * * rheo
fix 1 all rheo 3.0 RK1 8 thermal
fix 2 all rheo/viscosity * constant 0.1 2 power 1 2 3 4
fix 3 all rheo/thermal conductivity 1 constant 1 react 1.5 1 specific/heat * constant 3 Tfreeze 1 constant 4
"""


def test_parameters_of_a_hybrid_deck() -> None:
    found = followed(MODEL)
    assert deck.pair_rheo(found.pair) == PairRheo(3.0, 0.1, 0.0, True)
    with pytest.raises(InputError, match="atom type 2: needs a conductivity"):
        found.model(2, 2, (1.0, 1.0), EOSTable((EOS("linear"),) * 2))
    given = "fix 3 all rheo/thermal conductivity * constant 1 specific/heat * constant 3 Tfreeze 1 constant 4"
    found.note(given.split())
    model = found.model(2, 2, (1.0, 1.0), EOSTable((EOS("linear"),) * 2))
    assert model.viscosity == (Viscosity("constant", 0.1), Viscosity("power", 1, 2, 3, 4))
    assert model.thermal == (Thermal(1, 3, T_freeze=4), Thermal(1, 3))


@pytest.mark.parametrize(
    ("commands", "why"),
    [
        ("", "pair_style rheo/solid adds to it"),
        ("pair_style rheo 3.0\npair_coeff * *", ""),
        ("pair_style rheo 3.0\npair_coeff 1 1", "pair_coeff gives rheo to some types only"),
        ("pair_style rheo 3.0\npair_coeff * *\nbond_style harmonic", "bond_style harmonic adds to it"),
        ("pair_style rheo 3.0\npair_coeff * *\nfix 9 all wall/harmonic ylo EDGE 1 1 1", "fix 9 (wall/harmonic)"),
        ("pair_style rheo 3.0\npair_coeff * *\nfix 9 all gravity v_g vector 0 -1 0", "fix 9 (gravity): cannot be"),
        ("pair_style rheo 3.0\npair_coeff * *\nfix 9 all gravity 1 vector 0 -1 0", ""),
        ("pair_style rheo 3.0\npair_coeff * *\nfix 9 all setforce 0 0 0 region r", "cannot be followed"),
        ("pair_style rheo 3.0\npair_coeff * *\nfix 9 all spring/self 1\nunfix 9", ""),
    ],
)
def test_contributions_to_the_force(commands: str, why: str) -> None:
    found = followed(MODEL + commands)
    reason = found.adds_force() or found.changes_pairs()
    assert why in reason and bool(why) == bool(reason)


def test_shifts_of_oxidizing_particles_are_excluded() -> None:
    """LAMMPS' own oxidation example differs from step 69 on, and agrees without fix rheo/oxidation and its bonds."""
    model = Model(
        2,
        parse_fix_rheo("fix 1 all rheo 3.0 quintic 0 shift"),
        (1.0,),
        EOSTable((EOS("linear"),)),
        PairRheo(3.0),
        (Viscosity("constant", 0.1),),
    )
    oxidizing = followed(MODEL + "fix 5 all rheo/oxidation 1.5 2 1.0")
    assert fields.why_not("shift/v", model, fields.Setting(oxidizing, "lj")) == fields.MARKED
    assert not fields.why_not("shift/v", model, fields.Setting(followed(MODEL), "lj"))
    assert not fields.why_not("grad/v", model, fields.Setting(oxidizing, "lj"))


def test_types_without_rheo_pairs_have_other_cutoffs() -> None:
    some = "pair_style hybrid rheo 3.0\npair_coeff 1 1 rheo\npair_coeff 1 2 none"
    for style in (some, some.replace("hybrid ", "hybrid/overlay soft 2.0 ")):
        found = followed(style)
        assert found.hides_pairs() == found.changes_pairs() == deck.SOME_TYPES
    every = followed("pair_style hybrid rheo 3.0\npair_coeff * * rheo")
    assert not every.hides_pairs() and not followed("pair_style rheo 3.0\npair_coeff 1 1").hides_pairs()


def test_images_with_other_velocities() -> None:
    model = Model(
        *(2, parse_fix_rheo("fix 1 all rheo 3.0 quintic 0 shift"), (1.0,), EOSTable((EOS("linear"),)), PairRheo(3.0)),
        (Viscosity("constant", 0.1),),
    )
    moved = fields.Setting(followed(MODEL + "fix 5 all deform 1 xy erate 0.1 remap v"), "lj")
    for name in ("grad/v", "stress/v", "f", "shift/v"):
        assert fields.why_not(name, model, moved).endswith("gives images other velocities (remap v)")
    assert not fields.why_not("coordination", model, moved)
    still = fields.Setting(followed(MODEL + "fix 5 all deform 1 xy erate 0.1 remap x"), "lj")
    assert not fields.why_not("grad/v", model, still)


def test_commands_that_remove_pairs() -> None:
    assert followed("neigh_modify exclude type 1 1").hides_pairs() and not followed(MODEL).hides_pairs()
    assert not followed("neigh_modify exclude type 1 1\nneigh_modify exclude none").hides_pairs()
    bonds = "bond_style bpm/spring\nspecial_bonds lj 0 1 1 "
    assert followed(bonds).unlists_bonded and not followed(f"{bonds}coul 1 1 1").unlists_bonded


# --- decisions at the cutoff


def test_pairs_at_the_cutoff_are_open() -> None:
    """On a square lattice with a cutoff of 3 spacings four neighbours lie at the cutoff, exactly or within rounding."""
    from eos_ref import EOS, EOSTable

    for limit, open_ in ((24, False), (25, True), (28, True), (29, False)):
        fix = parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 surface/detection coordination {limit} 0")
        model = Model(2, fix, (1.0,), EOSTable((EOS("linear"),)), PairRheo(3.0), (Viscosity("constant", 0.1),))
        x_nc = np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), -1).reshape(-1, 2) + 0.1
        n = len(x_nc)
        ones_n = np.ones(n)
        state = State(x_nc, np.zeros((n, 2)), ones_n, np.ones(n, int), np.zeros(n, bool))
        sample = ParticleSample(model, Box((0, 0), (10, 10), (True, True)), state, ones_n)
        evaluation = SampleEvaluation(sample, ("coordination", "surface"))
        counted = evaluation.output("coordination")
        assert np.all(error(counted) == 4) and np.all((value(counted) >= 24) & (value(counted) <= 28))
        assert np.all((error(evaluation.output("surface")) > 0) == open_)
        assert np.all(value(evaluation.output("surface")) == (limit == 29)) or open_
