"""Effects of known findings on a deck and causes of failed runs, from the reference with and without the findings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from eos_ref.numbers.rounded import value
from lammps_cases.audit import effects
from lammps_cases.audit.effects import compare, worst
from lammps_cases.audit.evaluation import ParticleSample, SampleEvaluation
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.sample import judged, known
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.cli.audit import field_table
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.findings.neighbour_lists import NeighbourList
from lammps_cases.records import deck_wording
from lammps_cases.records.case_parts import EffectRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.records.wording import number
from lammps_cases.report import findings
from tests.support.vortices import EDGE, vortices

ENGINE = "2025.7.22.4.0"

COLUMN = (Path(__file__).parents[2] / "decks" / "in.column").read_text()
# The same with particles of unit volume, where no known finding of this LAMMPS makes a difference to forces at rest.
UNIT = (
    COLUMN.replace("sq 100.0", "sq 1.0")
    .replace("0 12 0 14 -0.1 0.1", "0 12 0 14 -0.5 0.5")
    .replace("* 0.01\n", "* 1.0\n", 1)
    .replace("rheo 0.3 ", "rheo 3.0 ")
    .replace("timestep        0.001", "timestep        0.01")
    .replace("* constant 0.01", "* constant 0.5")
)


def case_of(text: str, folder: Path) -> CaseRecord:
    """The record of a deck."""
    (folder / "in.deck").write_text(text)
    return audit_deck(folder / "in.deck", AuditOptions()).record.cases[0]


# --- effects


def test_multiple_is_reported_by_its_factor() -> None:
    right = np.array([[1.0, -2.0], [0.5, 0.25]])
    assert compare(right, 100 * right, 0.0 * right) == (2, 99.0, 100.0)  # sums of few bits
    assert compare(right, right, 0.0 * right) is None
    assert compare(right, right + 1e-9, np.full((2, 2), 1e-8)) is None, "rounding is no effect"


def test_other_difference_is_reported_by_its_size() -> None:
    right, wrong = np.array([4.0, 2.0, 1.0]), np.array([4.0, 3.0, 1.0])
    assert compare(right, wrong, np.zeros(3)) == (1, 0.25, None)
    assert compare(np.zeros(3), wrong, np.zeros(3)) == (3, None, None)


def test_the_largest_effect_is_kept() -> None:
    def effect(field: str, relative: float | None) -> EffectRecord:
        of = {"finding": "a", "run": 1, "step": 0, "particles": 1, "of": 2, "factor": None}
        return EffectRecord(field=field, relative=relative, **of)

    small, large, other = effect("f", 0.1), effect("f", 0.2), effect("drho", None)
    assert worst([small], [large, other]) == [large, other]
    assert worst([large], [small]) == [large]
    assert deck_wording.effect(large) == "f is wrong by up to 20 % of its largest value (1 of 2 particles, step 0)"
    assert deck_wording.effect(other) == "drho is wrong where it should be 0 (1 of 2 particles, step 0)"
    multiple = large.model_copy(update={"factor": 100.0})
    assert deck_wording.effect(multiple) == "f is 100 times what it should be (1 of 2 particles, step 0)"


def sample_of_vortices() -> ParticleSample:
    """With volumes of 0.01."""
    problem = vortices(mass=0.01)
    return ParticleSample(problem.model, problem.box, problem.state, np.full(len(problem.state.x_nc), 0.01))


def test_effect_of_a_finding_is_sampled_from_many_particles(monkeypatch: pytest.MonkeyPatch) -> None:
    sample = sample_of_vortices()
    (whole,) = effects.effects(sample, ENGINE, 1, 0)
    monkeypatch.setattr(effects, "MOST", 900)
    monkeypatch.setattr(effects, "FEW", 600)
    (some,) = effects.effects(sample, ENGINE, 1, 0)
    assert whole.of == EDGE**2 and 0 < some.of < 600
    assert some.finding == whole.finding == "force-per-volume"
    assert some.factor == pytest.approx(whole.factor, rel=1e-12) and number(some.factor) == "100"


def test_neighbour_lists_are_read_for_findings_that_depend_on_them() -> None:
    sample, listed = sample_of_vortices(), known(ENGINE)
    wrong = SampleEvaluation(sample, ("f",), ForcePerVolume)
    shown = {"f": np.asarray(value(wrong.output("f")))}

    def never(tag_n: np.ndarray) -> tuple[NeighbourList, ...]:
        raise AssertionError

    found = judged(sample, ("f",), np.arange(EDGE**2), shown, listed, {}, lists=never)
    assert [entry.id for entry in found.explained["f"]] == ["force-per-volume"]


@pytest.mark.lammps
def test_finding_hidden_by_other_forces_is_detected(tmp_path: Path) -> None:
    """The total f cannot be compared, as an unknown force adds to it; the effect of the finding on pairs is known.

    Forces are multiplied by density over mass, 1.01 over 0.01.
    """
    shaken = "displace_atoms  all random 0.01 0.01 0 135414 units box\nset group all rheo/rho 1.01\n"
    hidden = "fix             7 water spring/self 0.1\nrun             0"
    moved = COLUMN.replace("set             group all rheo/rho 1.0\n", shaken).replace("run             100", hidden)
    case = case_of(moved, tmp_path)
    assert any(line.startswith("f with all that adds to it: fix 7 (spring/self)") for line in case.not_checked)
    (f,) = [of for of in case.effects if (of.finding, of.field) == ("force-per-volume", "f")]
    assert deck_wording.effect(f).startswith("f is 101 times what it should be") and f.particles > 100


# --- why a run broke off


@pytest.mark.lammps
def test_correct_deck_made_unstable_by_a_finding(tmp_path: Path) -> None:
    case = case_of(COLUMN, tmp_path)
    assert case.verdict == "refused" and case.outlook is not None
    assert (case.outlook.cause, case.outlook.findings) == ("findings", ["force-per-volume"])
    run = RunRecord(engine=EngineRecord(), reference={}, cases=[case])
    assert findings.outcome(run).next_command == "eos-ref findings force-per-volume"
    without = case.model_copy(update={"outlook": None})
    unexplained = findings.outcome(run.model_copy(update={"cases": [without]}))
    assert unexplained.next_command == "" and not any(line.startswith("next") for line in unexplained.closing())
    assert field_table(case)[0].startswith("field") and field_table(case.model_copy(update={"fields": []})) == []
    (f,) = [of for of in case.effects if of.field == "f"]
    assert deck_wording.effect(f).startswith("f is 100 times what it should be")
    assert case.message.startswith("unstable because of the known bug force-per-volume: continued from step")
    assert "run 1: from step 10 on particles are much faster than sound: fields were not checked there" in case.warnings


@pytest.mark.lammps
def test_same_deck_in_unit_volumes_is_stable(tmp_path: Path) -> None:
    case = case_of(UNIT, tmp_path)
    assert case.verdict in ("pass", "explained") and case.outlook is None


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("old", "new", "cause", "because"),
    [
        (
            "timestep        0.01",
            "timestep        0.4",
            "time step",
            "unstable because of the time step: time step is 16 times",
        ),
        (
            "* linear",
            "* linear * background 3e5",
            "set-up",
            "unstable as set up: speed of sound is 3.33 times sqrt(g h)",
        ),
        ("gravity 1.0 vector 0 -1 0", "gravity 40.0 vector 0 1 0", "not understood", "not understood"),
    ],
)
def test_differences_that_are_not_findings(old: str, new: str, cause: str, because: str, tmp_path: Path) -> None:
    text = UNIT.replace(old, new, 1).replace("boundary        p s p", "boundary        p f p")
    case = case_of(text, tmp_path)
    assert case.verdict == "refused" and case.outlook is not None, case.message
    assert case.outlook.cause == cause and case.outlook.findings == []
    runs = "continued from step" if cause == "not understood" else "the reference also diverges after"
    assert case.message.startswith(because) and f"{runs} " in case.message
