"""`eos-ref advise`: the flow that a deck or a scene holds, and the deck with other numbers."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eos_ref import InputError
from eos_ref.model.units import UNITS
from lammps_cases.audit.advised import advised_deck, case_file
from lammps_cases.audit.flow_scales import scales_of_deck, scales_of_scene
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions, Given
from lammps_cases.audit.supervise import described
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.studies.stability.choice import AdvisedNumbers, strictest
from lammps_cases.studies.stability.limits import read
from tests.support.audited_decks import DECKS
from tests.support.outcome import Outcome

DOCUMENT = Path(__file__).parents[3] / "docs" / "stability.md"
TANK = re.findall(r"```lammps\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)[0]
Command = Callable[..., Outcome]


def edited(*pairs: tuple[str, str], deck: str = TANK) -> str:
    for old, new in pairs:
        assert old in deck
        deck = deck.replace(old, new)
    return deck


def saved(folder: Path, text: str) -> Path:
    deck = folder / "in.tank"
    deck.write_text(text)
    return deck


def choice_of(deck: Path, **given: float) -> tuple[DeckSetups, AdvisedNumbers]:
    _, setups = described(deck, AuditOptions())
    return setups, strictest(scales_of_deck(setups, Given(**given), deck.name), 0.01, read())


# --- decks

AT_REST = ("gravity 1e-3 vector 0 -1 0", "gravity 0 vector 0 -1 0")
TWO_RUNS = ("run             300", "run 100\ntimestep 0.3\nrun 100")


@pytest.mark.lammps
def test_advised_deck_changes_its_numbers_alone_and_is_advised_again(tmp_path: Path) -> None:
    """Numbers stand in variables, in lines that go on, and nowhere; several runs have several time steps."""
    text = edited(
        TWO_RUNS,
        ("interface/reconstruct speed/sound $c $c", "&\n    interface/reconstruct  # walls"),
        ("variable        c equal 1.0", "variable        cut equal 5.0"),
        ("pair_style      rheo 3.0", "pair_style      rheo ${cut}"),
        ("all rheo 3.0 RK1", "all rheo ${cut} RK1"),
    )
    deck = saved(tmp_path, text)
    setups, choice = choice_of(deck)
    new = advised_deck(deck, setups, choice)
    assert new == edited(
        ("equal 5.0", "equal 3"),
        ("timestep        0.5", "timestep        0.16"),
        ("timestep 0.3", "timestep 0.16"),
        ("RK1 10", "quintic 0"),
        ("reconstruct  # walls", "reconstruct speed/sound 1.55 1.55  # walls"),
        deck=text,
    )
    again = saved(tmp_path, new)
    assert advised_deck(again, *choice_of(again)) == new
    without = saved(tmp_path, re.sub("timestep .*\n", "", text))
    assert "timestep 0.16\nrun 100" in advised_deck(without, *choice_of(without))


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("text", "arguments", "complaint"),
    [
        (edited(AT_REST), (), "speed: must be given: nothing moves the fluid (option --speed) (in.tank)"),
        (edited(AT_REST), ("--speed", 0.1), ""),
        (edited(("vector 0 -1 0", "vector 1 0 0"), ("constant 0.2", "constant 0.0")), (), "without walls or viscosity"),
        (
            edited(("gravity 1e-3 vector 0 -1 0", "addforce v_a 0 0"), ("run ", "variable a atom x\nrun ")),
            (),
            "addforce",
        ),
        (edited(("run             300", "")), (), "must reach a run command"),
        (re.sub("fix .*\n", "", TANK), (), "Need to define fix rheo"),
        (TANK, ("--compressibility", 0), "compressibility: must lie between 0 and 1"),
        (TANK, ("--length", -1), "length: must be a number from 0 on"),
        (edited(("timestep        0.5", "include step.inc")), ("--write", "new"), "edits lines of in.tank alone"),
        (
            edited(("timestep        0.5", "if '1 > 0' then 'timestep 0.5'")),
            ("--write", "new"),
            "edits lines of in.tank",
        ),
        (edited(("timestep        0.5", "include step.inc")), (), ""),
        (edited(("units           lj", "units           real")), (), "units: must not be real or metal in 2D"),
    ],
)
def test_decks_without_a_scale_are_refused_in_one_line(
    eos_ref_command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, arguments: Any, complaint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("step.inc").write_text("timestep 0.5\n")
    outcome = eos_ref_command("advise", saved(Path(), text), *arguments)
    assert (outcome.code, complaint in outcome.err) == (2 if complaint else 0, True), outcome
    assert outcome.err.strip().count("\n") == 0
    assert not Path("new").exists()


@pytest.mark.lammps
def test_command_prints_and_writes(eos_ref_command: Command, tmp_path: Path) -> None:
    deck, target = saved(tmp_path, TANK), tmp_path / "in.advised"
    shown = eos_ref_command("advise", deck).out
    assert "-timestep        0.5\n-" not in shown and "+timestep        0.16" in shown
    printed = json.loads(eos_ref_command("advise", deck, "--write", target, "--json").out)
    assert {line["subject"]: line["advised"] for line in printed["chosen"]}["time step"] == 0.16
    assert printed["limits"]["h/4(c+U)"] == pytest.approx(0.25 / 1.55) and printed["fails"] > 0.3
    assert "timestep        0.16" in target.read_text()
    assert eos_ref_command("advise", "fluids.unit", "--write", tmp_path / "a.yaml").code == 0
    assert eos_ref_command("advise", tmp_path / "a.yaml").out.endswith("quintic, advised\n") is False
    assert eos_ref_command("advise", tmp_path / "none").code == 2


FLOWS = {
    "in.column": ("tank", 0.0, "volume of particles"),
    "in.plates": ("poiseuille", 0.0, "background pressure"),
    "in.vortices": ("taylor-green-100", 0.05, "spacing"),
}


@pytest.mark.lammps
@pytest.mark.parametrize("name", FLOWS)
def test_flow_of_a_deck(name: str) -> None:
    like, speed, subject = FLOWS[name]
    _, choice = choice_of(DECKS / name)
    assert choice.flow.like == like and choice.line(subject).why
    assert not speed or choice.flow.speed == pytest.approx(speed, rel=0.05)
    if name == "in.column":  # m/rho0 is 0.01: LAMMPS' sound is ten times as fast
        assert choice.flow.pressures == pytest.approx(100)
        assert choice.limits["h/4(c+U)"] == pytest.approx(0.1 / 4 / 149, rel=0.02)


@pytest.mark.lammps
def test_particles_with_masses_of_their_own_fill_their_volume(tmp_path: Path) -> None:
    own = ("mass            * 1.0", "fix m all property/atom rmass ghost yes\nset group all mass 0.7")
    _, choice = choice_of(saved(tmp_path, edited(own)))
    assert choice.flow.pressures == pytest.approx(1.0, rel=1e-3)


# --- scenes


@pytest.mark.parametrize("units", ["lj", "cgs", "micro", "nano", "real", "metal"])
def test_scales_are_consistent_in_every_system_of_units(units: str) -> None:
    """The same flow in two systems of units has the same scales."""
    ready = prepare(casefile.only(casefile.load(), f"twins-units.walls.{units}"))
    sides = ready.sides
    one, other = (scales_of_scene(scene, atoms, Given(), "") for scene, atoms in sides)
    first, second = (UNITS[scene.units] for scene, _ in sides)
    length, time = first.length / second.length, first.time / second.time
    powers = {"spacing": (1, 0), "length": (1, 0), "speed": (1, -1), "head": (2, -2), "gravity": (1, -2)}
    powers |= {"sound": (1, -1), "nu": (2, -1), "smoothing": (2, -1), "cut": (1, 0), "timestep": (0, 1)}
    for name, (of_length, of_time) in powers.items():
        factor = length**of_length * time**of_time
        assert getattr(other, name) == pytest.approx(factor * getattr(one, name), rel=1e-3), name
    assert (one.like, one.surface, one.sudden) == (other.like, other.surface, other.sudden)
    assert one.head > 0 and one.nu > 0


def test_scale_of_pressures_in_real_units_is_that_of_the_finding() -> None:
    """`units-unconverted`: 2.52e-4 times in real, 5810 times in metal, apart from the volume."""
    for units, known in (("real", 2.52e-4), ("metal", 5810)):
        ready = prepare(casefile.only(casefile.load(), f"twins-units.walls.{units}"))
        of = scales_of_scene(*ready.sides[1], Given(), "")
        volume = min(t.mass / t.rho0 for t in ready.sides[1][0].types)
        assert of.pressures * volume == pytest.approx(known, rel=2e-3)


MOVING = [c for c in casefile.load() if c.scene.evolve and c.scene.interacts and not c.scene.expect]


def test_every_moving_scene_has_numbers_or_lacks_a_speed(tmp_path: Path) -> None:
    """Two and three dimensions, several types, walls, surfaces, heat, sums, every law, every system of units."""
    lacking = 0
    for case in MOVING[::25]:
        atoms = prepare(case).atoms
        try:
            of = scales_of_scene(case.scene, atoms, Given(), case.name)
        except InputError as error:
            assert "option --speed" in str(error), case.name
            lacking += 1
            of = scales_of_scene(case.scene, atoms, Given(speed=0.1), case.name)
        choice = strictest([of], 0.01, read())
        assert 0 < choice.of("time step") < math.inf, case.name
        assert math.isnan(of.sound) or 0 < choice.of("speed of sound") < math.inf, case.name
        assert choice.of("cut") > 0 and choice.of("kernel") in ("quintic", "RK1", "RK2"), case.name
        file = tmp_path / f"{case.name}.yaml"
        file.write_text(case_file(case, choice))
        [made] = casefile.load_file(file)
        assert made.scene.evolve is not None and made.scene.evolve.timestep == choice.of("time step")
    assert lacking < len(MOVING[::25]) / 2


def test_scene_at_rest_is_refused() -> None:
    case = casefile.only(casefile.load(), "near-rho0.linear.2d")
    with pytest.raises(InputError, match="must have particles that interact and move"):
        scales_of_scene(case.scene, prepare(case).atoms, Given(), case.name)
