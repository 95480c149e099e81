"""Conserved quantities of a sample, runs of the reference with one thing changed, and eos-ref examples."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.numbers.columns import axes, summed
from eos_ref.numbers.rounded import error, value
from lammps_cases.audit import budgets, examples, rerun
from lammps_cases.audit.budgets import Rates, budget
from lammps_cases.audit.deck import Action
from lammps_cases.audit.evaluation import ParticleSample, TimedSample
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.rerun import closed, deviation
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.ranks import played
from lammps_cases.findings import LEDGER
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.records.case_parts import BudgetPart, BudgetRecord, ClosedRecord, SeriesRecord
from lammps_cases.records.run_record import CaseRecord
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.verdict.problems import problem_of
from tests.support import made_runs
from tests.support.audited_decks import DECKS, case_of
from tests.support.outcome import Outcome
from tests.support.vortices import EDGE, vortices

FORCES, SHIFT, THERMAL = "forces.all.quintic.2d", "shift.all.2d", "thermal.arithmetic.2d"


@cache
def sample_of(name: str) -> ParticleSample:
    (case,) = (case for case in casefile.load() if case.name == name)
    problem = problem_of(case.scene, prepare(case).atoms, case.where, case.scene.snapshots)
    mass_n = np.array(problem.model.mass_t)[problem.state.type_n - 1]
    return ParticleSample(replace(problem.model, forces=()), problem.box, problem.state, mass_n)


def still(sample: ParticleSample) -> np.ndarray:
    return np.zeros(sample.state.x_nc.shape)


def quintic(sample: ParticleSample) -> ParticleSample:
    """The same particles, all fluid, with opposite forces of pairs."""
    fix = replace(sample.model.fix, kernel="quintic", interface_reconstruct=False, rho_sum=False, shift=None)
    state = replace(sample.state, solid_n=np.zeros(len(sample.mass_n), bool))
    return replace(sample, model=replace(sample.model, fix=fix), state=state)


@pytest.mark.parametrize("name", [FORCES, SHIFT])
def test_pressure_power_equals_compression_work(name: str) -> None:
    sample = quintic(sample_of(name))
    found = budget(sample, still(sample), 1, 0, 0.0, [entry for entry in LEDGER if entry.id == "force-per-volume"])
    assert {"momentum", "energy of pressure"} <= set(found.residual)
    for quantity, residual in found.residual.items():
        assert abs(residual) <= found.bound[quantity], quantity
    parts = {part.name: part for part in found.parts}
    assert abs(parts["pressure"].power) > found.bound["energy of pressure"], "nothing of note is kept"
    assert parts["viscosity"].power < 0
    (wrong,) = found.findings
    assert max(abs(f) for f in wrong.force) > found.bound["momentum"]


def test_force_without_volume_breaks_conservation() -> None:
    sample = quintic(sample_of(FORCES))
    wrong = Rates(sample, ForcePerVolume)
    residuals = wrong.residuals(wrong)
    assert all(abs(value(of)[0]) > error(of)[0] for of in residuals.values())


def test_parts_add_up_to_the_total() -> None:
    sample = sample_of(FORCES)
    gravity = Action("gravity", "all", (0.1, -0.2, 0.0))
    sample = replace(sample, actions=[(gravity, np.ones(len(sample.mass_n), bool))])
    found = budget(sample, still(sample), 1, 0, 0.0)
    d = sample.model.dimension
    left_out = ("shifting", "other fixes")
    forces = np.array([part.force for part in found.parts if part.force and part.name not in left_out])
    # Sums of the parts and of the whole, each rounded on its own; the parts cancel where the whole is taken from them.
    np.testing.assert_allclose(forces.sum(axis=0), found.pairs.force, atol=4 * found.bound["momentum"], rtol=0)
    (others,) = [part for part in found.parts if part.name == "other fixes"]
    acted = Rates(sample)
    for force, f_n, g in zip(others.force, axes(acted.acted_nc - acted.force_nc), gravity.vector[:d], strict=True):
        weight = math.fsum(sample.mass_n * g)
        of_weight = EPS * math.fsum(np.abs(sample.mass_n * g))  # half of it a product, half the sum
        assert abs(force - weight) <= error(summed(f_n))[0] + of_weight


def test_half_step_velocities_are_completed() -> None:
    sample = sample_of(FORCES)
    force_nc = np.ones(sample.state.x_nc.shape)
    at_rest = replace(sample, state=replace(sample.state, v_nc=still(sample)))
    found = budget(at_rest, force_nc, 1, 5, 0.25)
    assert found.momentum == [0.25 * len(sample.mass_n)] * sample.model.dimension
    assert found.press is None, "LAMMPS' velocities and forces are not of one moment"
    assert budget(sample, force_nc, 1, 0, 0.0).press is not None


# --- runs with one thing changed


@pytest.mark.parametrize("name", [FORCES, "forces.all.quintic.3d", THERMAL])
def test_refined_particles_represent_the_same_fluid(name: str) -> None:
    sample = sample_of(name)
    state, d = sample.state, sample.model.dimension
    fine = rerun.finer(sample.model, sample.box, state)
    mass_n = np.array(fine.model.mass_t)[fine.state.type_n - 1]
    assert len(fine.state.x_nc) == 2**d * len(state.x_nc) and fine.model.fix.cut == sample.model.fix.cut / 2
    assert math.fsum(mass_n) == math.fsum(sample.mass_n), "masses are divided by powers of 2"
    before, after = (sample.mass_n[:, None] * state.v_nc), mass_n[:, None] * fine.state.v_nc
    for c in range(d):
        # A product of each term, half EPS, and for that of a part the sum that makes its velocity: d products more.
        allowed = EPS * (math.fsum(np.abs(before[:, c])) + (d + 1) * math.fsum(np.abs(after[:, c])))
        assert abs(math.fsum(after[:, c]) - math.fsum(before[:, c])) <= allowed
    low_c, high_c = np.array(sample.box.low_c), np.array(sample.box.high_c)
    inside = (fine.state.x_nc >= low_c) & (fine.state.x_nc <= high_c)
    assert inside[:, np.array(sample.box.periodic)].all()
    if state.energy_n is not None:
        assert math.fsum(fine.state.energy_n) == math.fsum(state.energy_n)


def test_diverging_runs_record_how_they_ended() -> None:
    sample = sample_of(FORCES)
    series = rerun.reruns(TimedSample(sample, 50.0, 1, 0, np.arange(len(sample.mass_n))), 40, 10, ())
    assert series[0].name == rerun.AS_IT_IS and all(of.ended for of in series)


# --- closed solutions


def decaying(**changes: object) -> TimedSample:
    of = vortices(timestep=0.5)
    n = len(of.state.x_nc)
    return TimedSample(
        ParticleSample(of.model, of.box, replace(of.state, **changes), np.full(n, 2.0)), 0.5, 1, 0, np.arange(n)
    )


def test_vortices_are_recognised_by_their_velocities() -> None:
    good = decaying()
    found = closed(good, [0, 10])
    assert found is not None and found.decays
    eta, rho0 = good.sample.model.viscosity[0].eta, good.sample.model.eos.laws[0].rho0
    exponent = 4 * eta / rho0 * (2 * np.pi / EDGE) ** 2 * 5.0
    # Seven operations make either exponent; values and their ratio, of three operations, change its logarithm as much.
    assert np.log(found.values[0] / found.values[1]) == pytest.approx(exponent, rel=14 * EPS, abs=4 * EPS)
    moved = good.sample.state.v_nc * 1.0
    moved[3, 0] += 1e-9
    assert closed(decaying(v_nc=moved), [0, 10]) is None, "something else flows here"
    assert closed(decaying(v_nc=0 * moved), [0, 10]) is None


@pytest.mark.parametrize("eta", [0.0, 1e-30, 1e6])
def test_viscosity_without_decay_rate_has_no_closed_solution(eta: float) -> None:
    good = decaying()
    law = replace(good.sample.model.viscosity[0], eta=eta)
    model = replace(good.sample.model, viscosity=(law,))
    assert closed(replace(good, sample=replace(good.sample, model=model)), [0, 10]) is None


def test_contribution_of_a_finding_is_the_difference_of_runs() -> None:
    exact = ClosedRecord(flow="", quantity="kinetic energy", about="", steps=[0, 1], values=[1, 0.5], decays=True)
    looks = {"steps": [0, 1], "momentum": [[0.0], [0.0]]}
    right = SeriesRecord(name=rerun.AS_IT_IS, kinetic=[1.0, 0.5], **looks)
    faster = {"kinetic": [1.0, 0.25], **looks}
    looked = [budget(sample_of(FORCES), still(sample_of(FORCES)), 1, step, 0.0) for step in (0, 1)]
    series = [right, SeriesRecord(name=rerun.SILENT, **faster), SeriesRecord(name="b", findings=["b"], **faster)]
    case = made_runs.case("a").model_copy(update={"closed": exact, "budgets": looked, "series": series})
    _, _, silent, wrong = budgets.parts(case)
    assert silent.contribution == -1.0, "without it the decay is faster"
    assert wrong.contribution == 1.0, "with it the decay is faster"


def test_deviation_is_measured_at_a_common_step() -> None:
    given = {"flow": "", "about": "", "steps": [0, 4, 8], "values": [1, 0.5, 0.25]}
    decay = ClosedRecord(quantity="kinetic energy", decays=True, **given)
    run = SeriesRecord(name="", steps=[0, 4], kinetic=[2.0, 0.5], momentum=[[0.0], [0.0]])
    assert deviation(decay, run) == 1.0, "twice the rate"
    assert deviation(decay, run, 8) is None
    value = decay.model_copy(update={"decays": False, "quantity": "momentum along x"})
    assert deviation(value, run.model_copy(update={"momentum": [[0.0], [0.625]]})) == 0.25


# --- example decks: how they are found, how LAMMPS and the reference run them, and the page

LOG = """LAMMPS (17 Apr 2024 - Development - somewhere)
   Step          Time          KinEng         Press
         0   0              0.5            0.25
WARNING: something (file.cpp:1)
       100   10             0.25           0.125
Loop time of 1.5 on 4 procs for 100 steps with 9 atoms
"""


def examples_of(folder: Path, *names: str) -> Path:
    """A folder of decks laid out as LAMMPS' examples are: one folder per deck."""
    for name in names:
        (folder / name).mkdir(parents=True)
        shutil.copy(DECKS / f"in.{name}", folder / name / f"in.{name}")
    return folder


# --- decks


def test_decks_are_named_by_their_folders(tmp_path: Path) -> None:
    folder = examples_of(tmp_path, "vortices", "plates")
    (folder / "vortices" / "log.17Apr2024.vortices.g++.4").write_text(LOG)
    (folder / "in.loose").write_text("run 0\n")
    found = examples.decks(Engine(), folder)
    assert [deck.name for deck in found] == ["loose", "plates", "vortices"]
    assert [len(deck.logs) for deck in found] == [0, 0, 1]
    assert [deck.name for deck in examples.decks(Engine(), folder, ["plates"])] == ["plates"]


def test_missing_decks_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"not installed with this LAMMPS.*--from DIR"):
        examples.decks(Engine(), None)
    with pytest.raises(InputError, match="must lie as in"):
        examples.decks(Engine(), tmp_path)
    with pytest.raises(InputError, match=r"must be one of plates.*did you mean"):
        examples.decks(Engine(), examples_of(tmp_path, "plates"), ["plate"])


def test_examples_are_found_in_the_build_tree(tmp_path: Path) -> None:
    library = tmp_path / "build" / "liblammps.so"
    library.parent.mkdir()
    library.touch()
    package = tmp_path / "site" / "lammps"
    package.mkdir(parents=True)
    (package / "liblammps.so").symlink_to(library)
    engine = Engine("path:x", str(package.parent))
    assert installations.examples(engine) is None
    (tmp_path / "examples" / "rheo").mkdir(parents=True)
    assert installations.examples(engine) == tmp_path / "examples" / "rheo"


def test_log_with_warnings_is_read(tmp_path: Path) -> None:
    path = tmp_path / "log.17Apr2024.x.g++.4"
    path.write_text(LOG)
    log = examples.shipped_log(path)
    assert log is not None and (log.version, log.ranks) == ("17 Apr 2024", 4)
    assert log.columns == {"Step": [0, 100], "Time": [0, 10], "KinEng": [0.5, 0.25], "Press": [0.25, 0.125]}
    path.write_text(LOG.replace("Loop time", "Time"))
    assert examples.shipped_log(path) is None, "broken off"


# --- what numbers say


def balance(momentum: float, finding: float, bound: float = 1e-12) -> BudgetRecord:
    pairs = BudgetPart(name="pairs", force=[momentum, 0.0])
    wrong = BudgetPart(name="some-finding", force=[finding, 0.0])
    return BudgetRecord(
        run=1, step=0, mass=1.0, volume=1.0, momentum=[0.0, 0.0], kinetic=1.0, size=4.0,
        residual={"momentum": momentum}, bound={"momentum": bound}, parts=[], pairs=pairs, findings=[wrong],
    )  # fmt: skip


def test_bound_decides_what_is_conserved() -> None:
    (kept,) = budgets.conserved([balance(5e-13, 5e-13), balance(0.0, 0.5e-12)])
    assert kept.kept and kept.broken_by == {}
    (broken,) = budgets.conserved([balance(5e-13, 2.0), balance(0.0, 1.0)])
    assert broken.kept and broken.broken_by == {"some-finding": (2.0 - 5e-13) / 4}
    (lost,) = budgets.conserved([balance(0.0, 0.0), balance(1.0, 1.0)])
    assert not lost.kept and lost.share == 0.25 and lost.broken_by == {}
    assert list(budgets.conserved([])) == []


@pytest.mark.parametrize(("of", "words"), [(-0.00001, "0.00 %"), (-0.0255, "−2.55 %"), (0.0255, "+2.55 %"), (None, "")])
def test_zero_has_no_sign(of: float | None, words: str) -> None:
    assert budgets.percent(of) == words


@pytest.mark.parametrize(("power", "shown"), [(-4e-23, 0.0), (-2e-12, -2e-12)])
def test_power_within_its_rounding_counts_as_zero(power: float, shown: float) -> None:
    bound = {"energy of pressure": 1e-12}
    of = balance(0.0, 0.0).model_copy(update={"bound": bound, "parts": [BudgetPart(name="pressure", power=power)]})
    case = CaseRecord(case="made", verdict="pass", budgets=[of])
    assert examples.View(examples.Example("", "", case)).powers == {"pressure": shown}


# --- with LAMMPS


@cache
def audited(name: str) -> CaseRecord:
    options = AuditOptions(every=50, steps=100, budgets=True, trust=True)
    return case_of(audit_deck(DECKS / f"in.{name}", options))


def audited_text(folder: Path, text: str) -> CaseRecord:
    (folder / "in.deck").write_text(text)
    return case_of(audit_deck(folder / "in.deck", AuditOptions(every=20, budgets=True, trust=True)))


@pytest.mark.lammps
@pytest.mark.parametrize("name", ["vortices", "plates"])
def test_lammps_deviates_less_than_any_change_of_the_reference(name: str) -> None:
    case = audited(name)
    own, right, *changed = budgets.parts(case)
    assert own.name == budgets.LAMMPS and own.deviation is not None and right.deviation is not None
    apart = abs(own.deviation - right.deviation)
    terms = [part for part in changed if part.name.startswith("no ")]
    assert [part.name for part in terms] == ["no artificial viscosity", "no density diffusion", "no shifting"]
    assert all(part.contribution is not None and abs(part.contribution) > apart for part in terms)
    artificial, finer = terms[0], next(part for part in changed if part.name == "half the spacing")
    assert abs(finer.deviation) < abs(right.deviation), "a finer fluid is nearer to the closed solution"
    assert (artificial.contribution > 0) == (name == "vortices"), "it makes a decay faster and a flow slower"
    assert len(case.budgets) == 3 and case.verdict in ("pass", "explained")


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("line", "pairs", "why"),
    [
        ("group some id 1:9\nfix 5 some gravity 0.1 vector 0 -1 0\nrun 20", "rheo 3.0",
         "the reference does not run on from the first look, as forces act on groups that are not of types "
         "(gravity on some)"),
        ("run 20", "hybrid/overlay soft 1.0 rheo 3.0", "nothing is followed, as forces are not compared"),
        ("fix 5 all gravity 0.1 vector 0 -1 0\nrun 20", "rheo 3.0", None),
    ],
)  # fmt: skip
def test_contributions_missing_from_budgets_are_reported(
    tmp_path: Path, line: str, pairs: str, why: str | None
) -> None:
    text = (DECKS / "in.vortices").read_text().replace("run             200", line)
    text = text.replace("pair_style      rheo 3.0", f"pair_style {pairs}")
    if "hybrid" in pairs:
        text = text.replace("pair_coeff      * *", "pair_coeff * * rheo\npair_coeff * * soft 0.1")
    case = audited_text(tmp_path, text)
    lines = [warning for warning in case.warnings if warning.startswith("--budgets: ")]
    assert len(lines) == (why is not None) and (why is None or why in lines[0])
    assert bool(case.series) == (why is None)


@pytest.mark.lammps
def test_last_of_several_runs_is_repeated(tmp_path: Path) -> None:
    text = (DECKS / "in.plates").read_text().replace("run             200", "run 20\nrun 40")
    case = audited_text(tmp_path, text)
    own, right = budgets.measured(case), case.series[0]
    assert own.steps == right.steps == [0, 20, 40] and case.closed is None, "the fluid moves when the second run begins"
    assert right.kinetic[0] == own.kinetic[0] > 0


@pytest.mark.lammps
def test_pressure_depends_on_ranks_with_newton_off(tmp_path: Path) -> None:
    """Finding virials-cancel; on one rank with newton on, it is the reference's except for the part of the origin."""
    shutil.copy(DECKS / "in.vortices", tmp_path)
    deck = tmp_path / "in.vortices"

    def press(count: int, newton: bool | None = None) -> float:
        return examples.columns_of(played(None, deck, count, 0, newton))["Press"][0]

    one, two = press(1), press(2)
    assert one != two
    case = audited("vortices")
    right = case.budgets[0].press
    assert right is not None and "virials-cancel" in case.budgets[0].press_findings
    on = press(1, newton=True)
    assert abs(on - right) < min(abs(one - right), abs(two - right))


@pytest.mark.lammps
def test_command_writes_a_page(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    folder = examples_of(tmp_path / "decks", "plates")
    plates = folder / "plates" / "in.plates"
    plates.write_text(plates.read_text().replace("run             200", "run 100"))
    (folder / "plates" / "log.17Apr2024.plates.g++.2").write_text(LOG.replace("4 procs", "2 procs"))
    (folder / "bonds").mkdir()
    others = "fix 7 water spring/self 0.1\nrun 20"  # the harness does not know its forces
    (folder / "bonds" / "in.bonds").write_text((DECKS / "in.basin").read_text().replace("run             20", others))
    out = tmp_path / "out"
    outcome = eos_ref_command("examples", "--from", str(folder), "--trust", "--out", str(out))
    assert outcome.code == 0, outcome.err
    assert re.search(r"LAMMPS: \S+ % at step 100", outcome.out) and "pressure before step 1, 2 ranks" in outcome.out
    html = (out / "report.html").read_text()
    assert 'id="deck-plates"' in html and "Against the closed solution" in html
    assert (out / "plates" / "run.json").is_file()
    document = examples.DOCUMENT.read(out / examples.NAME)
    assert [example.name for example in document.examples] == ["bonds", "plates"]
    assert list(examples.lines(document)) == outcome.out.splitlines()[: len(list(examples.lines(document)))]
    assert json.loads((out / examples.NAME).read_text())["schema"] == "eos-ref/examples/1"

    plates.write_text(plates.read_text() + "# changed\n")
    before = {name: (out / name / "run.json").stat().st_mtime_ns for name in ("bonds", "plates")}
    eos_ref_command("examples", "--from", str(folder), "--trust", "--out", str(out))
    again = examples.DOCUMENT.read(out / examples.NAME)
    assert again.examples[0] == document.examples[0]
    assert again.seconds > sum(part.seconds for part in examples.judged(out).journal.entries()[::2])
    assert {name: (out / name / "run.json").stat().st_mtime_ns > at for name, at in before.items()} == {
        "bonds": False,
        "plates": True,
    }


def test_command_without_decks(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    outcome = eos_ref_command("examples", "--from", str(tmp_path), "--out", str(tmp_path / "out"))
    assert outcome.code == 2 and not (tmp_path / "out").exists()
