"""Validation flows: closed forms, published data, orders and faults on the reference, the command."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.session import Session
from lammps_cases.findings.forces import FORCE_PER_VOLUME
from lammps_cases.findings.variants import Variant
from lammps_cases.records.files import DATA
from lammps_cases.studies.flows import cavity, drops, page, run, walls, waves
from lammps_cases.studies.flows.catalogue import VALIDATIONS
from lammps_cases.studies.flows.flow import Snapshot, Start
from lammps_cases.studies.flows.known import Flow, ReferenceCurve, table
from lammps_cases.studies.flows.record import DOCUMENT, LAMMPS, REFERENCE, UNIT, FlowRecord, Lost, Validated
from lammps_cases.studies.flows.solve import FlowResult, LammpsFlow, ReferenceFlow, by_reference
from tests.support.flow_faults import Plant, of_gravity, of_types
from tests.support.outcome import Outcome
from tests.support.roundings import rounded
from tests.workshop import tables_validation

Run = Callable[..., Outcome]
THICK = walls.THICKENING
Line = tuple[tuple[float, ...], tuple[float, ...]]


# --- known solutions


def test_every_table_has_source_scatter_and_sorted_points() -> None:
    names = sorted(path.stem for path in (DATA / "flows").glob("*.csv"))
    assert names
    for name in names:
        known = table(name, name)
        assert known.source and known.scatter
        steps = np.diff(known.x)
        assert (steps > 0).all() or (steps < 0).all(), name
    u, v = cavity.U.known[0], cavity.V.known[0]  # 17 points per line, with walls at its ends
    assert len(u.x) == len(v.x) == 17
    assert (u.y[0], u.y[-1], v.y[0], v.y[-1]) == (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("of", VALIDATIONS.values(), ids=list(VALIDATIONS))
def test_every_flow_has_the_data_of_its_page_and_a_start_that_can_be_pickled(of: Flow) -> None:
    assert VALIDATIONS[of.name] is of
    assert len(of.resolutions) == 3
    assert of.panels and all(panel.known for panel in of.panels)
    assert of.quantities and of.validates and of.expected and of.limits
    assert all(finding.model_variant and finding.model_variant.stages for finding in of.findings)
    start = of.start(12, of.options)
    again = pickle.loads(pickle.dumps(start))
    assert again.case == start.case
    assert (again.atoms.x_nc == start.atoms.x_nc).all()


@pytest.mark.parametrize("power", [0.5, 1.5])
def test_power_law_velocity_has_its_closed_form(power: float) -> None:
    """Without the law's cut-off: one at zero rate has no effect."""
    cut = walls.power_law(power, 64)
    uncut = replace(cut, eta=cut.K * (1e-9 * cut.gd0) ** (power - 1), gd0=1e-9 * cut.gd0)
    y = np.linspace(0, 64, 65)
    away = np.abs(y - 32)
    exact = (uncut.gravity / uncut.K) ** (1 / power) * (32 ** (1 + 1 / power) - away ** (1 + 1 / power))
    # 20 000 trapezia of width h have an error of h^2 f''/12, for y^a with a < 1 less than h^(1 + a), at 0.
    missed = 20_000.0 ** -min(2, 1 + 1 / power)
    assert uncut.velocity(y) == pytest.approx(exact / (1 + 1 / power), rel=missed)


def test_stiff_plug_approaches_a_rigid_one() -> None:
    """The distance from Bingham's own solution is inversely proportional to the stiffness below the yield stress."""
    y, misses = np.linspace(0, 24, 49), []
    for stiff in (20.0, 200.0):
        soft = walls.bingham(24)
        law = replace(soft, eta=stiff, gd0=soft.yield_stress / (stiff - soft.K))
        misses.append(np.abs(law.velocity(y) - walls.ideal_bingham(law, y)).max())
    assert 8 < misses[0] / misses[1] < 12


@pytest.mark.parametrize(
    ("known", "marks", "found", "misfit"),
    [
        (((1.0, 2.0), (1.0, 2.0)), True, ((0.0, 4.0), (0.0, 4.0)), 0.0),
        (((1.0, 2.0), (1.0, 2.0)), True, ((0.0, 4.0), (0.5, 4.5)), 0.5 / 2.5**0.5),
        (((0.0, 10.0), (0.0, 10.0)), False, ((3.0, 7.0), (3.0, 7.0)), 0.0),
        (((0.0, 10.0), (0.0, 10.0)), False, ((3.0, 4.0), (4.0, 4.0)), 1 / 5),
    ],
)
def test_data_are_compared_at_their_points_and_solutions_at_particles(
    known: Line, marks: bool, found: Line, misfit: float
) -> None:
    assert ReferenceCurve("", *known, "", marks=marks).misfit(found) == rounded(misfit, 4)


# --- the reference


@pytest.mark.slow
def test_order_is_as_expected_and_faults_are_detected() -> None:
    """Resolutions in the ratio 1.5: an error of second order falls by 2.25, one by a fault does not fall."""

    def error(n: int, plant: Plant = lambda start: start) -> float:
        result = by_reference(plant(THICK.start(n, THICK.options)))
        return next(iter(THICK.measures(n, THICK.options, result.snapshots).values()))

    fine = error(12)
    assert error(8) / fine > 1.5**1.5
    for plant in (of_gravity(1.05), of_types((2,), viscosity=0.7)):
        assert error(12, plant) > 1.5 * fine


# --- the command


@pytest.mark.slow
@pytest.mark.lammps
def test_quick_flow_agrees_is_drawn_and_is_not_rerun(
    eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = eos_ref_command("validate", "--quick", THICK.name, "--out", tmp_path)
    assert first.code == 0
    assert f"report: {tmp_path / 'report.html'}" in first.out
    validated = DOCUMENT.read(tmp_path / "validate.json")
    ours, theirs = (validated.of(THICK.name, side) for side in (REFERENCE, LAMMPS))
    assert [of.n for of in ours] == [of.n for of in theirs] == list(THICK.quick)
    for one, other in zip(ours, theirs, strict=True):
        # Volumes, which LAMMPS' forces lack, are 1 to 2e-6: less than a thousandth of an error of 0.03.
        assert other.errors["velocity"] == pytest.approx(one.errors["velocity"], rel=1e-3)
    html = (tmp_path / "report.html").read_text()
    assert THICK.title in html
    assert "<svg" in html
    assert (tmp_path / "figures" / f"{THICK.name}.png").stat().st_size
    assert len((tmp_path / "curves.csv").read_text().splitlines()) == 1 + 2 * sum(THICK.quick)

    def not_again(*_: object) -> None:
        raise AssertionError("run again")

    monkeypatch.setattr(run, "by_reference", not_again)
    monkeypatch.setattr(run, "in_worker", not_again)
    again = eos_ref_command("validate", "--quick", THICK.name, "--out", tmp_path, "--json")
    assert again.code == 0
    assert [each["seconds"] for each in json.loads(again.out)["runs"]] == [of.seconds for of in validated.runs]


@pytest.mark.parametrize(
    ("name", "file", "said"),
    [
        ("binghm", "", "flow: must be one of"),
        ("binghm", "", "did you mean 'bingham'"),
        (THICK.name, "run.json", "output folder: must not be the report of a run"),
    ],
)
def test_bad_input_is_reported_in_one_line_and_writes_nothing(
    name: str, file: str, said: str, eos_ref_command: Run, tmp_path: Path
) -> None:
    if file:
        (tmp_path / file).touch()
    code, _, err = eos_ref_command("validate", name, "--out", tmp_path)
    assert (code, said in err, err.count("\n")) == (2, True, 1)
    assert [path.name for path in tmp_path.iterdir()] == [file] * bool(file)


# --- wording, and runs that stopped


def made(side: str, value: float, message: str = "") -> FlowRecord:
    name = THICK.quantities[0].name
    values = {} if message else {name: value}
    return FlowRecord(THICK.name, side, 8, 100, 10, 1.0, message, {}, {} if message else {"velocity": 0.1}, values)


def validated(*runs: FlowRecord) -> Validated:
    return Validated("", {"processor": "", "cores": 1}, {}, False, 1.0, runs)


WAVE = VALIDATIONS["standing-wave"]
SWINGS = [quantity.name for quantity in WAVE.quantities][:2]
STOPPED = made(LAMMPS, 0.0, "Lost atoms")
RUNS: dict[str, tuple[FlowRecord, ...]] = {
    "variants": (
        *(made(REFERENCE, 1.0), made(LAMMPS, 0.5), made(UNIT, 0.0, "Lost atoms"), made("force-per-volume", 2.0)),
    ),
    "stopped": (made(REFERENCE, 1.0), replace(made(REFERENCE, 1.0), n=12), made(LAMMPS, 0.5), replace(STOPPED, n=12)),
    "lost and explained": (made(REFERENCE, 1.0), replace(STOPPED, lost=Lost(80, ("a", "b"), 90))),
    "set-ups and starts": (
        *(replace(made(REFERENCE, value), n=n) for n, value in ((8, 1.1), (12, 1.05), (16, 1.04))),
        *(made(f"reference, start {k}", value) for k, value in ((1, 1.13), (2, 1.09))),
        made(f"reference, {next(iter(THICK.setups))}", 2.0),
        made(LAMMPS, 1.1),
        made("force-per-volume", 1.105),  # less than a hundredth: not named
    ),
    "nothing to fit": tuple(
        replace(made(side, 1.0), flow=WAVE.name, quantities=found)
        for side, found in (
            *((side, dict.fromkeys(SWINGS, 1.0)) for side in (REFERENCE, LAMMPS)),
            (UNIT, {SWINGS[0]: 2.0, SWINGS[1]: np.nan}),
        )
    ),
}


@pytest.mark.parametrize("name", RUNS)
def test_effects_and_stops_are_reported_in_the_users_quantities(name: str, snapshot: Any) -> None:
    """A side that stopped has no order of convergence; a missing number is explained in words."""
    assert tables_validation.table(validated(*RUNS[name])) == snapshot


@pytest.mark.parametrize(
    ("theirs", "ours", "words"),
    [
        (1 + 3e-8, 1, "0 %"),
        (0.949, 1, "-5.1 %"),
        (0.35, 1, "-65 %"),
        (39, 0.8, "49 times"),
        (1, 0, ""),
        (np.nan, 1, ""),
    ],
)
def test_differences_have_only_significant_digits(theirs: float, ours: float, words: str) -> None:
    assert page.change(theirs, ours) == words
    assert [page.order(value) for value in (-0.001, -1.26, 1.94, np.nan)] == ["0.0", "-1.3", "1.9", ""]


# --- the dam break, other starts


def falling(n: int, t: float) -> Snapshot:
    """The column in free fall without a floor, from which its start does not move sideways."""
    start = waves.DAM.start(n, waves.DAM.options)
    wet_n, zero_n = start.atoms.type_n == 1, np.zeros(len(start.atoms))
    down_nc = np.stack([zero_n, np.where(wet_n, 1.0, 0.0)], axis=1) / n
    return Snapshot(0, start.atoms.x_nc[:, :2] - down_nc * t**2 / 2, -down_nc * t, zero_n, zero_n, time=t)


def test_free_fall_keeps_its_energy() -> None:
    _, ratio = waves.ENERGY.read(16, waves.DAM.options, [falling(16, t) for t in (1.0, 8.0, 12.0)])
    assert ratio == pytest.approx((1.0, 1.0), rel=1e-12)  # sums of 128 heights, each rounded


def test_zero_of_the_experiments_time_is_found() -> None:
    known = waves.FRONT.known[0]
    error, late = waves._clock((tuple(np.array(known.x) - 0.12), known.y))
    assert (error, late) == pytest.approx((0.0, 0.12), abs=1e-9)


def test_other_starts_move_the_fluid_alone_inside_its_box(monkeypatch: pytest.MonkeyPatch) -> None:
    start, moved = THICK.start(8, THICK.options), list[Start]()
    monkeypatch.setattr(run, "by_reference", moved.append)
    for k in (1, 1, 2):
        run._displaced(k, start)
    first, same, other = (each.atoms.x_nc for each in moved)
    assert (first == same).all() and (first != other).any()
    by_nc, low, high = first - start.atoms.x_nc, start.atoms.low_c, start.atoms.high_c
    fluid_n = start.atoms.type_n == 1
    assert np.abs(by_nc[~fluid_n]).max() == 0 < np.abs(by_nc[fluid_n]).max() <= run.DISPLACED
    assert (low <= first).all() and (first <= high).all()


# --- particles that LAMMPS loses


def lost_at(step: int) -> Callable[[Start], FlowResult]:
    return lambda start: FlowResult((), 0.0, len(start.atoms), max(s for s in start.steps if s <= step), "Lost atoms")


@pytest.mark.parametrize(
    ("losing", "told"),
    [
        ({("a",): 60, ("a", "b"): 40}, Lost(80, ("a",), 60)),
        ({("a", "b"): 90}, Lost(80, ("a", "b"), 90)),
        ({}, Lost(80)),
        ({("a", "b"): 100}, Lost(80)),  # later than the search goes
    ],
)
def test_findings_that_lose_particles_are_tried_alone_then_together(
    losing: dict[tuple[str, ...], int], told: Lost, monkeypatch: pytest.MonkeyPatch
) -> None:
    start = THICK.start(8, THICK.options)

    class Losing:
        """Keeps all particles up to a step that depends on its base classes."""

        def __init__(self, begin: Start, stages: type) -> None:
            self.step, self.until = 0, losing.get(tuple(base.__name__ for base in stages.__bases__), 10**6)

        def advance(self, steps: int) -> None:
            self.step += steps

        def snapshot(self) -> bool:
            return self.step > self.until

    monkeypatch.setattr(run, "ReferenceFlow", Losing)
    monkeypatch.setattr(run, "gone", lambda begin, shot: shot)
    named = [
        replace(FORCE_PER_VOLUME, id=name, variant=Variant(lambda problem: True, type(name, (), {}))) for name in "ab"
    ]
    assert run.explain(start, lost_at(85), named) == told


def test_particles_are_gone_outside_open_faces_or_at_nan() -> None:
    start = THICK.start(8, THICK.options)
    x_nc = start.atoms.x_nc[:, :2]
    for axis, value, expected in ((1, 99.0, True), (0, 99.0, False), (0, np.nan, True), (1, 0.0, False)):
        moved_nc = x_nc.copy()
        moved_nc[3, axis] = value
        zero_n = np.zeros(len(x_nc))
        shot = Snapshot(0, moved_nc, np.zeros_like(x_nc), zero_n, zero_n)
        assert run.gone(start, shot) is expected


@pytest.mark.lammps
def test_lost_atoms_are_no_failure(eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "validate", lambda *_, **__: validated(*RUNS["lost and explained"]))
    ended = eos_ref_command("validate", THICK.name, "--out", tmp_path)
    said = "LAMMPS loses atoms after step 80, at 8 particles; so does the reference with a and b together"
    assert (ended.code, f"{said}, after step 90" in ended.out) == (0, True)


def test_quick_omits_flows_without_a_quick_form_unless_named(
    eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def note(chosen: list[Flow], *_: object, **__: object) -> Validated:
        asked.append([of.name for of in chosen])
        return validated()

    monkeypatch.setattr(run, "validate", note)
    for names in ((), ("cavity",)):
        assert eos_ref_command("validate", "--quick", *names, "--out", tmp_path).code == 0
    assert asked == [[name for name in VALIDATIONS if name not in ("cavity", "convection")], ["cavity"]]


# --- drops and squares


def test_initial_pressure_of_the_square_solves_its_equation() -> None:
    """At the centre it is that of a twisted bar (Timoshenko), twice 0.0737 of a side squared; at the edges it is 0."""
    middle, step = drops.patch_pressure(np.zeros((1, 2)), 1.0, 200)[0], 0.05
    assert middle == pytest.approx(-2 * 0.07367, abs=2 * 0.5e-5)  # given to five digits
    around = step * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    # Second order in the step: a twelfth of both fourth derivatives, which are about 10.
    laplacian = (drops.patch_pressure(around, 1.0, 200).sum() - 4 * middle) / step**2
    assert laplacian == pytest.approx(2, abs=step**2 / 12 * 2 * 10)
    edge = np.array([[0.5, 0.1], [-0.2, 0.5]])
    # Sines of multiples of pi, up to 40, round like these; weights add up to less than 1.
    assert np.abs(drops.patch_pressure(edge, 1.0)).max() < 40 * np.pi * 2.0**-52


def test_ellipse_conserves_energy() -> None:
    """Kinetic and potential: (A^2 + B^2)(a^2 + b^2)."""
    times = np.linspace(0.01, 9, 9001)
    a = drops.ellipse(times)
    rate = np.gradient(np.log(a), times, edge_order=2)[2:-2]
    energy = (rate**2 + 1) * (a**2 + 1 / a**2)[2:-2]
    # Central differences have an error of a sixth of the third one; the energy twice that times the rate, at most 0.4.
    third = np.abs(np.diff(np.log(a), 3)).max() / (times[1] - times[0])
    assert energy == pytest.approx(2 * (drops.STRETCH**2 + 1), rel=2 * drops.STRETCH * third / 6)


@pytest.mark.lammps
@pytest.mark.parametrize("of", [drops.DROP, cavity.CONVECTION], ids=lambda of: of.name)
def test_body_force_is_the_same_on_both_sides(of: Flow) -> None:
    """It adds its formula to the forces of the set-up, on fluid alone, up to rounding."""
    start, lammps = of.start(10, of.options), Session()
    body, atoms = start.body, start.atoms
    assert body

    def of_lammps(begin: Start) -> Any:
        LammpsFlow(begin, lammps)
        lmp = lammps.open()
        order = np.argsort(lmp.numpy.extract_atom("id"))
        return np.array(lmp.numpy.extract_atom("f"))[order][:, :2]

    def of_reference(begin: Start) -> Any:
        return ReferenceFlow(begin).simulation.fields["f"]

    T_n = None if atoms.energy_n is None else np.where(atoms.type_n > 2, 1 / cavity.HEAVY, 1.0) * atoms.energy_n
    exact_nc = np.where((atoms.type_n == 1)[:, None], body.force(atoms.mass_n, atoms.x_nc[:, :2], T_n), 0.0)
    for forces in (of_lammps, of_reference):
        with_nc, without_nc = forces(start), forces(replace(start, body=None))
        rounding = 4 * np.finfo(float).eps * (np.abs(with_nc) + np.abs(without_nc) + np.abs(exact_nc)).max()
        assert np.abs(with_nc - without_nc - exact_nc).max() <= rounding
    assert np.abs(exact_nc).max() > 0


@pytest.mark.lammps
def test_lammps_has_no_fix_for_surface_tension() -> None:
    assert "RHEO has no surface tension" in drops.NO_TENSION
    styles = Session().open().available_styles("fix")
    assert "rheo/viscosity" in styles
    assert not [style for style in styles if "tension" in style]


# --- the document


def test_document_has_the_measured_table() -> None:
    path = Path(__file__).parents[4] / "docs" / "validation.md"
    measured, text = DOCUMENT.read(tables_validation.MEASURED), path.read_text(encoding="utf-8")
    assert tables_validation.document(text, measured) == text
    assert not measured.quick


def test_parts_are_merged_in_the_order_of_the_flows() -> None:
    later = replace(made(REFERENCE, 1.0), flow="bingham")
    both = tables_validation.joined(
        [validated(later, replace(later, side=LAMMPS)), validated(made(REFERENCE, 1), made(LAMMPS, 1))]
    )
    assert both.flows == [THICK.name, "bingham"]
    assert both.seconds == 2
    assert both.command == f"eos-ref validate {THICK.name} bingham"
