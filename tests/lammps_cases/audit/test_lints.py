"""Lints of an audit: each is silent on a correct deck and warns on real LAMMPS when one word is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from eos_ref import EOS, EOSTable, parse_fix_rheo
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from lammps_cases.audit import lints as audit_lints
from lammps_cases.audit.deck import hyphens
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.lints import Stillness, lints, number_density
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.records.run_record import CaseRecord
from tests.support.pages import unpacked

BASIN = (Path(__file__).parents[2] / "decks" / "in.basin").read_text()
RHO, MASS = "set             group all rheo/rho 1.0", "mass            * 1.0"
STATUS = "set             group floor rheo/status 1\n"


def case_of(folder: Path, *changes: tuple[str, str], fields: tuple[str, ...] = ("pressure",)) -> CaseRecord:
    """Audit the basin with some words changed."""
    text = BASIN
    for old, new in changes:
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "in.deck").write_text(text)
    return audit_deck(folder / "in.deck", AuditOptions(fields=fields)).record.cases[0]


@pytest.mark.lammps
def test_correct_deck_gives_no_warning(tmp_path: Path) -> None:
    case = case_of(tmp_path, fields=("all",))
    assert case.warnings == [] and case.verdict in ("pass", "explained")


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("changes", "lines"),
    [
        (
            [(RHO, RHO.replace("1.0", "1.2"))],
            ["type 1: speed of sound 1 is 4.58 times ", "type 1: rho is 1.2 times rho0 = 1 (median of 72 fluid "],
        ),
        ([(MASS, MASS.replace("1.0", "1.5"))], ["type 1: m = 1.5 is 1.5 times rho0 V = 0.9999"]),
        # Masses that fit a density far from rho0 are not reported in addition.
        (
            [(RHO, RHO.replace("1.0", "1.5")), (MASS, MASS.replace("1.0", "1.5"))],
            ["type 1: speed of sound 1 is 2.39 times ", "type 1: rho is 1.5 times rho0 = 1 "],
        ),
        (
            [("timestep ", "velocity water set 0.2 0 0\ntimestep ")],
            ["type 1: speed of sound 1 is 4.97 times the largest speed of its fluid, 0.201: "],
        ),
        # Nine rows of fluid: the extent between the outer ones is 8.
        (
            [("gravity 1e-4", "gravity 2e-2")],
            ["speed of sound 1 is 2.5 times sqrt(g h) = 0.4 (g = 0.02, fluid of height 8): its weight will "],
        ),
        ([("vector 0 -1 0", "vector 1 0 0"), ("gravity 1e-4", "gravity 2e-2")], []),
        (
            [(STATUS, "")],
            [
                "fix setforce 0 holds 32 particles of type 2 that are fluid",
                "fix rheo has interface/reconstruct, but none of 104 particles is solid",
            ],
        ),
        (
            [(STATUS, ""), (" interface/reconstruct", "")],
            ["fix setforce 0 holds 32 particles of type 2 that are fluid"],
        ),
        (
            [("units ", "suffix omp\nunits ")],
            ["suffix omp: this LAMMPS has no rheo/omp; RHEO's styles run without it"],
        ),
    ],
)
def test_wrong_word_is_named(changes: list[tuple[str, str]], lines: list[str], tmp_path: Path) -> None:
    found = case_of(tmp_path, *changes).warnings
    own = [line for line in found if "tension at which" not in line]
    assert len(own) == len(lines)
    assert all(line.startswith(expected) for line, expected in zip(own, lines, strict=True)), own


@pytest.mark.lammps
def test_fluid_held_by_another_fix(tmp_path: Path) -> None:
    """A setforce within a region is not followed; its effect on the floor is still detected."""
    changes = [(STATUS, ""), (" interface/reconstruct", ""), ("setforce 0 0 0", "setforce 0 0 0 region floor")]
    # The lowest rows have no moving fluid next to them.
    (line,) = case_of(tmp_path, *changes, fields=("coordination",)).warnings
    assert line.startswith("24 fluid particles of type 2 are at rest in step 20 as in the sample before, although ")


@pytest.mark.lammps
def test_range_with_hyphen_is_read_as_by_lammps(tmp_path: Path) -> None:
    law = ("rheo/pressure * linear", "rheo/pressure * linear 1-2 background 0.01")
    case = case_of(tmp_path, law)
    assert [law.background for law in case.laws] == [0.01, 0.0] and case.explained_by == ["hyphen-range-accepted"]
    assert case.verdict == "explained" and all(field.verdict == "exact" for field in case.fields)
    (line,) = [line for line in case.warnings if "offset" not in line]
    assert line.startswith(
        "fix 3 (rheo/pressure): '1-2' is not a valid type range: LAMMPS reads it as '1' only (known bug "
    )
    refused = case_of(tmp_path, (law[0], "rheo/pressure 1-2 linear"))
    assert refused.verdict == "refused" and refused.warnings == [line]


def test_words_that_are_not_ranges_are_ignored() -> None:
    assert hyphens(["fix", "1-2", "all", "rheo/pressure", "*", "background", "1e-2"]) == []
    assert hyphens(["fix", "1", "all", "deposit", "1-2", "3"]) == [] == hyphens(["pair_coeff", "1-2", "*"])


@pytest.mark.lammps
def test_suffix_of_the_command_line(tmp_path: Path) -> None:
    from lammps_cases.cli.audit import audit_command

    (tmp_path / "in.deck").write_text(BASIN)
    arguments = [str(tmp_path / "in.deck"), "-sf", "kk", "--fields", "pressure", "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(audit_command, arguments, standalone_mode=False)
    assert result.return_value == 0, result.output
    assert "\nwarning: suffix kk: this LAMMPS has no rheo/kk; RHEO's styles run without it\n" in result.stdout
    assert "-sf kk" in (tmp_path / "out" / "run.json").read_text()
    assert "this LAMMPS has no rheo/kk" in unpacked((tmp_path / "out" / "report.html").read_text())


# --- the numbers behind them


def sample_of(x_nc: np.ndarray, box: Box, v_nc: np.ndarray | None = None) -> ParticleSample:
    """Fluid particles of one type with a cutoff of 3."""
    d, n = x_nc.shape[1], len(x_nc)
    model = Model(
        2 if d == 2 else 3,
        parse_fix_rheo("fix 1 all rheo 3.0 quintic 0"),
        (1.0,),
        EOSTable((EOS("linear"),)),
        PairRheo(3.0),
        (Viscosity("constant", 0.1),),
    )
    v_nc = np.zeros((n, d)) if v_nc is None else v_nc
    return ParticleSample(model, box, State(x_nc, v_nc, np.ones(n), np.ones(n, int), np.zeros(n, bool)), np.ones(n))


def test_many_particles_are_sampled_in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Results from evenly spaced blocks equal those of all particles, and the line states the count."""
    x_nc = np.stack(np.meshgrid(np.arange(30), np.arange(30), indexing="ij"), -1).reshape(-1, 2) + 0.5
    sample = sample_of(x_nc, Box((0.0, 0.0), (30.0, 30.0), (True, False)))
    n_n, full_n = number_density(sample)
    assert not [of for of in lints(sample, np.arange(900)) if of.subject == "some"]
    monkeypatch.setattr(audit_lints, "ROWS", 100)
    monkeypatch.setattr(audit_lints, "MOST", 300)
    some_n, some_full_n = number_density(sample)
    judged_n = np.isfinite(some_n)
    assert judged_n.sum() == 300 and judged_n[:100].all() and judged_n[400:500].all() and judged_n[-100:].all()
    np.testing.assert_array_equal(some_n[judged_n], n_n[judged_n])
    np.testing.assert_array_equal(some_full_n, full_n & judged_n)
    (line,) = [of.line for of in lints(sample, np.arange(900)) if of.subject == "some"]
    assert "were judged by about 300 of 900 particles" in line


@pytest.mark.parametrize("d", [2, 3])
def test_only_particles_with_full_support_count(d: int) -> None:
    """On a lattice of spacing 1 between two free surfaces: those two rows inside, where 1/n is 1."""
    rows, across = 8, 6
    x_nc = np.stack(np.meshgrid(*[np.arange(across) + 0.5] * (d - 1), np.arange(rows) + 0.5, indexing="ij"), -1)
    x_nc = x_nc.reshape(-1, d)
    box = Box((0.0,) * d, (*(float(across),) * (d - 1), float(rows)), (*(True,) * (d - 1), False))
    n_n, full_n = number_density(sample_of(x_nc, box))
    assert sorted(set(x_nc[full_n, -1])) == [2.5, 3.5, 4.5, 5.5]
    # The sum over the quintic spline with h = spacing is an integral to within its smallest wave's transform.
    np.testing.assert_allclose(n_n[np.abs(x_nc[:, -1] - rows / 2) < 1.5], 1.0, rtol=3e-3, atol=0)
    assert not number_density(sample_of(x_nc[:1], box))[1].any()


def test_stillness_needs_two_samples_and_a_moving_particle() -> None:
    x_nc = np.stack(np.meshgrid(np.arange(6.0), np.arange(6.0)), -1).reshape(-1, 2) + 0.5
    ids, box = np.arange(36), Box((0, 0), (6, 6), (True, True))
    held_n = x_nc[:, 1] < 2
    moving = sample_of(x_nc, box, np.where(held_n[:, None], 0.0, 0.1))
    still = Stillness()
    still.look(0, ids, moving, True)
    assert not still.line
    still.look(10, ids[::-1].copy(), sample_of(x_nc[::-1].copy(), box, moving.state.v_nc[::-1].copy()), False)
    assert still.line.startswith("12 fluid particles of type 1 are at rest in step 10 ")
    again = Stillness()  # a run begins, and velocities may have been set
    again.look(10, ids, moving, False)
    again.look(10, ids, moving, True)
    assert not again.line
    rest = Stillness()
    for step in (0, 10):
        rest.look(step, ids, sample_of(x_nc, box), False)
    assert not rest.line, "nothing moves"
