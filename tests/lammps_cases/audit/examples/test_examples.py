"""Example decks: how they are found, how LAMMPS and the reference run them, and the page."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.audit import budgets, examples
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.engine import installations
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.ranks import first_pressure
from lammps_cases.records.case_parts import BudgetPart, BudgetRecord
from lammps_cases.records.run_record import CaseRecord
from tests.support.outcome import Outcome

DECKS = Path(__file__).parents[3] / "decks"
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


def budget(momentum: float, finding: float, bound: float = 1e-12) -> BudgetRecord:
    pairs = BudgetPart(name="pairs", force=[momentum, 0.0])
    wrong = BudgetPart(name="some-finding", force=[finding, 0.0])
    return BudgetRecord(
        run=1, step=0, mass=1.0, volume=1.0, momentum=[0.0, 0.0], kinetic=1.0, size=4.0,
        residual={"momentum": momentum}, bound={"momentum": bound}, parts=[], pairs=pairs, findings=[wrong],
    )  # fmt: skip


def test_bound_decides_what_is_conserved() -> None:
    (kept,) = budgets.conserved([budget(5e-13, 5e-13), budget(0.0, 0.5e-12)])
    assert kept.kept and kept.broken_by == {}
    (broken,) = budgets.conserved([budget(5e-13, 2.0), budget(0.0, 1.0)])
    assert broken.kept and broken.broken_by == {"some-finding": (2.0 - 5e-13) / 4}
    (lost,) = budgets.conserved([budget(0.0, 0.0), budget(1.0, 1.0)])
    assert not lost.kept and lost.share == 0.25 and lost.broken_by == {}
    assert list(budgets.conserved([])) == []


@pytest.mark.parametrize(("of", "words"), [(-0.00001, "0.00 %"), (-0.0255, "−2.55 %"), (0.0255, "+2.55 %"), (None, "")])
def test_zero_has_no_sign(of: float | None, words: str) -> None:
    assert budgets.percent(of) == words


@pytest.mark.parametrize(("power", "shown"), [(-4e-23, 0.0), (-2e-12, -2e-12)])
def test_power_within_its_rounding_counts_as_zero(power: float, shown: float) -> None:
    bound = {"energy of pressure": 1e-12}
    of = budget(0.0, 0.0).model_copy(update={"bound": bound, "parts": [BudgetPart(name="pressure", power=power)]})
    case = CaseRecord(case="made", verdict="pass", budgets=[of])
    assert examples.View(examples.Example("", "", case)).powers == {"pressure": shown}


# --- with LAMMPS


def case_of(name: str) -> CaseRecord:
    options = AuditOptions(every=50, steps=100, budgets=True, trust=True)
    return audit_deck(DECKS / f"in.{name}", options).record.cases[0]


@pytest.mark.lammps
@pytest.mark.parametrize("name", ["vortices", "plates"])
def test_lammps_deviates_less_than_any_change_of_the_reference(name: str) -> None:
    case = case_of(name)
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
        (
            "group some id 1:9\nfix 5 some gravity 0.1 vector 0 -1 0\nrun 20",
            "rheo 3.0",
            "the reference does not run on from the first look, as forces act on groups that are not of types "
            "(gravity on some)",
        ),
        ("run 20", "hybrid/overlay soft 1.0 rheo 3.0", "nothing is followed, as forces are not compared"),
        ("fix 5 all gravity 0.1 vector 0 -1 0\nrun 20", "rheo 3.0", None),
    ],
)
def test_contributions_missing_from_budgets_are_reported(
    tmp_path: Path, line: str, pairs: str, why: str | None
) -> None:
    text = (DECKS / "in.vortices").read_text().replace("run             200", line)
    text = text.replace("pair_style      rheo 3.0", f"pair_style {pairs}")
    if "hybrid" in pairs:
        text = text.replace("pair_coeff      * *", "pair_coeff * * rheo\npair_coeff * * soft 0.1")
    (tmp_path / "in.deck").write_text(text)
    case = audit_deck(tmp_path / "in.deck", AuditOptions(every=20, budgets=True, trust=True)).record.cases[0]
    lines = [warning for warning in case.warnings if warning.startswith("--budgets: ")]
    assert len(lines) == (why is not None) and (why is None or why in lines[0])
    assert bool(case.series) == (why is None)


@pytest.mark.lammps
def test_last_of_several_runs_is_repeated(tmp_path: Path) -> None:
    text = (DECKS / "in.plates").read_text().replace("run             200", "run 20\nrun 40")
    (tmp_path / "in.deck").write_text(text)
    case = audit_deck(tmp_path / "in.deck", AuditOptions(every=20, budgets=True, trust=True)).record.cases[0]
    own, right = budgets.measured(case), case.series[0]
    assert own.steps == right.steps == [0, 20, 40] and case.closed is None, "the fluid moves when the second run begins"
    assert right.kinetic[0] == own.kinetic[0] > 0


@pytest.mark.lammps
def test_pressure_depends_on_ranks_with_newton_off(tmp_path: Path) -> None:
    """Finding virials-cancel; on one rank with newton on, it is the reference's except for the part of the origin."""
    shutil.copy(DECKS / "in.vortices", tmp_path)
    deck = tmp_path / "in.vortices"
    one, two = (first_pressure(None, deck, count) for count in (1, 2))
    assert one != two
    case = case_of("vortices")
    right = case.budgets[0].press
    assert right is not None and "virials-cancel" in case.budgets[0].press_findings
    on = first_pressure(None, deck, 1, newton=True)
    assert abs(on - right) < min(abs(one - right), abs(two - right))


@pytest.mark.lammps
def test_command_writes_a_page(tmp_path: Path, eos_ref_command: Callable[..., Outcome]) -> None:
    folder = examples_of(tmp_path / "decks", "plates")
    (folder / "plates" / "log.17Apr2024.plates.g++.2").write_text(LOG.replace("4 procs", "2 procs"))
    (folder / "bonds").mkdir()
    others = "fix 7 water spring/self 0.1\nrun 20"  # the harness does not know its forces
    (folder / "bonds" / "in.bonds").write_text((DECKS / "in.basin").read_text().replace("run             20", others))
    out = tmp_path / "out"
    outcome = eos_ref_command("examples", "--from", str(folder), "--trust", "--out", str(out))
    assert outcome.code == 0, outcome.err
    assert re.search(r"LAMMPS: \S+ % at step 200", outcome.out) and "pressure before step 1, 2 ranks" in outcome.out
    html = (out / "report.html").read_text()
    assert (
        'id="deck-plates"' in html and "Against the closed solution" in html and (out / "plates" / "run.json").is_file()
    )
    document = examples.DOCUMENT.read(out / examples.NAME)
    assert [example.name for example in document.examples] == ["bonds", "plates"]
    assert list(examples.lines(document)) == outcome.out.splitlines()[: len(list(examples.lines(document)))]
    assert json.loads((out / examples.NAME).read_text())["schema"] == "eos-ref/examples/1"

    (folder / "plates" / "in.plates").write_text((folder / "plates" / "in.plates").read_text() + "# changed\n")
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
