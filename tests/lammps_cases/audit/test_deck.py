"""What a deck says: its text as LAMMPS reads it, its commands, its runs followed without executing them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable, InputError, parse_fix_rheo
from eos_ref.model.parameters import Model, PairRheo, Thermal, Viscosity
from lammps_cases.audit import deck, fields, share, supervise, text
from lammps_cases.audit.follow import ENDLESS, SetupWatch
from lammps_cases.audit.messages import DeckSetups
from lammps_cases.audit.options import AuditOptions


@pytest.mark.parametrize(
    ("script", "lines"),
    [
        ("a b # c", ["a b"]),
        ("# a &\nb\nc", ["", "c"]),
        ("a & # b\nc", ["a &", "c"]),
        ("a &  \n b\nc\r\n", ["a  b", "c", ""]),
        ('a """b\n# c""" # d\ne', ['a """b\n# c"""', "e"]),
        ("a 'b # c' \"# d\" # e", ["a 'b # c' \"# d\""]),
    ],
)
def test_logical_lines(script: str, lines: list[str]) -> None:
    assert [text.without_comment(line.text) for line in text.logical_lines(script)] == lines


def test_words() -> None:
    found = text.words('if "a b" \'c "d"\' """e \'f\' """ g"h')
    assert [word.value for word in found] == ["if", "a b", 'c "d"', "e 'f' ", 'g"h']
    assert [word.raw for word in found][1:3] == ['"a b"', "'c \"d\"'"]


@pytest.mark.parametrize(
    "words", ["fix 1-2 all rheo/pressure * background 1e-2", "fix 1 all deposit 1-2 3", "pair_coeff 1-2 *"]
)
def test_words_that_are_not_ranges_are_ignored(words: str) -> None:
    assert deck.hyphens(words.split()) == []


@pytest.mark.parametrize(
    ("command", "steps"),
    [("run  45 pre no", 65), ("run ${n}", None), ("run 45 upto", None), ("minimize 0 0 10 10", None)],
)
def test_steps_of_a_run_are_read_from_its_command(command: str, steps: int | None) -> None:
    assert supervise.steps_after(command, 20) == steps


# --- commands


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
THERMAL = "fix 3 all rheo/thermal conductivity * constant 1 specific/heat * constant 3 Tfreeze 1 constant 4"
PAIRS = "pair_style rheo 3.0\npair_coeff * *\n"
SHIFTING = Model(
    *(2, parse_fix_rheo("fix 1 all rheo 3.0 quintic 0 shift"), (1.0,), EOSTable((EOS("linear"),)), PairRheo(3.0)),
    (Viscosity("constant", 0.1),),
)


def test_parameters_of_a_hybrid_deck() -> None:
    found, laws = followed(MODEL), EOSTable((EOS("linear"),) * 2)
    assert deck.rheo_words(found.pair) == ["rheo", "3.0", "artificial/visc", "0.1", "harmonic/means"]
    assert deck.pair_rheo(found.pair) == PairRheo(3.0, 0.1, 0.0, True)
    with pytest.raises(InputError, match="atom type 2: needs a conductivity"):
        found.model(2, 2, (1.0, 1.0), laws)
    found.note(THERMAL.split())
    model = found.model(2, 2, (1.0, 1.0), laws)
    assert model.viscosity == (Viscosity("constant", 0.1), Viscosity("power", 1, 2, 3, 4))
    assert model.thermal == (Thermal(1, 3, T_freeze=4), Thermal(1, 3))


@pytest.mark.parametrize(
    ("commands", "available"),
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
def test_when_force_of_pair_rheo_is_available(commands: str, available: bool) -> None:
    assert share.can_be_had(followed(MODEL + commands)) is available


@pytest.mark.parametrize(
    ("commands", "why"),
    [
        ("", "special_bonds: must weigh second and third neighbours by 1"),
        ("special_bonds lj 0 1 1\npair_coeff 1 1 rheo/solid 1 1", "damping of rheo/solid: is missing"),
        ("special_bonds lj 0 1 1\npair_coeff * * rheo/solid 1 1 1", ""),
        (PAIRS, ""),
        (f"{PAIRS}bond_style bpm/spring", "bond type 1: needs coefficients"),
        (f"{PAIRS}bond_style bpm/spring smooth no break no\nbond_coeff 1 1 1 1", ""),
        (f"{PAIRS}bond_style bpm/spring volume/factor yes\nbond_coeff 1 1 1 1 1", "volume/factor: cannot be followed"),
        (
            f"{PAIRS}bond_style hybrid bpm/spring rheo/shell t/form 2 store/local f 5 x\nbond_coeff * rheo/shell 1 1 1",
            "",
        ),
        (f"{PAIRS}bond_style hybrid harmonic rheo/shell t/form 2", "must be one of bpm/spring, rheo/shell, found"),
        (f"{PAIRS}bond_style rheo/shell\nbond_coeff * 1 1 1", "t/form: is missing"),
        (f"{PAIRS}angle_style harmonic", "angle_style harmonic adds to it"),
        ("pair_style rheo 3.0\npair_coeff 1 1", "pair_coeff gives rheo to some types only"),
        (f"{PAIRS}bond_style harmonic", "bond_style harmonic adds to it"),
        (f"{PAIRS}fix 9 all wall/harmonic ylo EDGE 1 1 1", "fix 9 (wall/harmonic)"),
        (f"{PAIRS}fix 9 all gravity v_g vector 0 -1 0", "fix 9 (gravity): cannot be"),
        (f"{PAIRS}fix 9 all gravity 1 vector 0 -1 0", ""),
        (f"{PAIRS}fix 9 all setforce 0 0 0 region r", "cannot be followed"),
        (f"{PAIRS}fix 9 all spring/self 1\nunfix 9", ""),
    ],
)
def test_contributions_to_the_force(commands: str, why: str) -> None:
    found = followed(MODEL + commands)
    reason = found.adds_unfollowed(2, 1) or found.acts_on_forces() or found.changes_pairs()
    assert why in reason and bool(why) == bool(reason)


IMAGES = "gives images other velocities (remap v)"


@pytest.mark.parametrize(
    ("commands", "reasons"),
    [
        ("", dict.fromkeys(("shift/v", "grad/v", "coordination"), "")),
        ("fix 5 all rheo/oxidation 1.5 2 1.0", {"shift/v": fields.SHELLS, "grad/v": ""}),
        (
            "fix 5 all deform 1 xy erate 0.1 remap v",
            {**dict.fromkeys(("grad/v", "stress/v", "f", "shift/v"), IMAGES), "coordination": ""},
        ),
        ("fix 5 all deform 1 xy erate 0.1 remap x", {"grad/v": ""}),
    ],
)
def test_fields_that_a_deck_makes_unpredictable(commands: str, reasons: dict[str, str]) -> None:
    setting = fields.Setting(followed(MODEL + commands), "lj")
    for name, reason in reasons.items():
        found = fields.why_not(name, SHIFTING, setting)
        assert found.endswith(reason) and bool(found) == bool(reason), name


def test_types_without_rheo_pairs_have_other_cutoffs() -> None:
    some = "pair_style hybrid rheo 3.0\npair_coeff 1 1 rheo\npair_coeff 1 2 none"
    for style in (some, some.replace("hybrid ", "hybrid/overlay soft 2.0 ")):
        found = followed(style)
        assert found.hides_pairs() == found.changes_pairs() == deck.SOME_TYPES


@pytest.mark.parametrize(
    ("commands", "hidden"),
    [
        (MODEL, False),
        ("pair_style hybrid rheo 3.0\npair_coeff * * rheo", False),
        ("pair_style rheo 3.0\npair_coeff 1 1", False),
        ("neigh_modify exclude type 1 1", True),
        ("neigh_modify exclude type 1 1\nneigh_modify exclude none", False),
    ],
)
def test_commands_that_remove_pairs(commands: str, hidden: bool) -> None:
    assert bool(followed(commands).hides_pairs()) == hidden


def test_bonds_that_remove_pairs() -> None:
    bonds = "bond_style bpm/spring\nspecial_bonds lj 0 1 1 "
    assert followed(bonds).unlists_bonded and not followed(f"{bonds}coul 1 1 1").unlists_bonded


# --- runs that are set up and not executed


def lammps() -> Any:
    """A stub of LAMMPS with two atoms at step 100."""
    per_atom = {"id": np.array([2, 1]), "mass": np.array([0.0, 1.5])}
    return SimpleNamespace(
        extract_setting={"world_size": 1, "nlocal": 2, "dimension": 2, "ntypes": 1}.get,
        extract_global={"ntimestep": 100, "dt": 0.01, "units": "lj"}.get,
        extract_atom=lambda name: None,
        numpy=SimpleNamespace(extract_atom=per_atom.get),
        version=lambda: 20250722,
    )


@pytest.fixture
def watch() -> SetupWatch:
    return SetupWatch(lammps(), AuditOptions(), lambda message: None)


def set_up(watch: SetupWatch, *lines: str) -> DeckSetups:
    """The set-ups recorded from commands; LAMMPS is given runs of no steps."""
    for line in lines:
        words = line.split()
        if words[0] == "run":
            executed: list[str] = []
            assert not watch.run(words, executed.append), "a deck goes on to its end"
            assert executed == ["run 0"]
        else:
            watch.note(words)
    return watch.setups()


def test_steps_of_successive_runs_are_counted_without_stepping(watch: SetupWatch) -> None:
    runs = set_up(watch, "run 20", "run 150 upto", "run 5", "reset_timestep 0", "run 7").runs
    assert [(run.first, run.last) for run in runs] == [(100, 120), (120, 150), (150, 155), (100, 107)]
    assert runs[0].id_n.tolist() == [2, 1] and runs[0].mass_t == [0.0, 1.5] and not runs[0].solid_n.any()


def test_run_records_the_commands_before_it(watch: SetupWatch) -> None:
    lines = ["timestep 0.01", "print hello", "compute p all pressure", "run 1", "uncompute p", "fix 1 all nve", "run 1"]
    kept = set_up(watch, *lines)
    assert kept.commands == ["timestep 0.01", "compute p all pressure", "uncompute p", "fix 1 all nve"]
    assert [run.before for run in kept.runs] == [2, 4]
    assert [list(run.computes) for run in kept.runs] == [["p"], []]
    watch.note(["variable", "v", "equal", "1 + 1"])
    assert watch.setups().commands[-1] == 'variable v equal """1 + 1"""'


def test_dump_covers_the_runs_from_definition_to_end(watch: SetupWatch) -> None:
    lines = ["run 1", "dump d all custom 5 f id x", "dump_modify d sort id", "run 1", "undump d", "run 1"]
    last = ["write_dump all custom g id modify sort id", "dump d all custom 9 h id", "clear", "run 1"]
    first, written, second = set_up(watch, *lines, *last).dumps
    assert (first.words[3], first.modify, first.begin, first.end) == ("5", ["sort", "id"], 1, 2)
    assert (written.words[3:], written.modify, written.step) == (["0", "g", "id"], ["sort", "id"], 103)
    assert (second.begin, second.end) == (3, 3), "clear ends it"
    assert set_up(watch, "dump e all custom 1 f id").dumps[-1].end == ENDLESS
