"""A deck in the unit of length in which m/rho0 is 1."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from eos_ref.errors import InputError
from eos_ref.syntax.manual import FIRST
from lammps_cases.audit import rescale as module
from lammps_cases.audit import scaling
from lammps_cases.audit.messages import ScriptCommand, StartState
from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.rescale import REPULSION, rescale
from lammps_cases.audit.scaling import Scaling
from lammps_cases.audit.supervise import described
from lammps_cases.setup.twins import Scale
from tests.support.audited_decks import DECKS
from tests.support.outcome import Outcome

COLUMN = (DECKS / "in.column").read_text()
DRY = COLUMN.replace(" interface/reconstruct", "")  # without the walls' repulsion, which has no dimension in 2D
RUN = "run             100\n"


def command(written: str, runs: int = 0) -> ScriptCommand:
    return ScriptCommand("in.deck:7", written, runs, written.split())


# Commands, and their numbers in a unit of length of 1/2.
SCALED = """
pair_style rheo 3 artificial/visc 0.5 rho/damp 0.5 harmonic/means | 6.0 0.5 2.0
fix 1 all rheo 3 RK1 4 shift exclude/type 2 1*2 scale/cross/type 0.5 0.1 8 | 6.0 4 2 0.5 0.1 2.0
fix 1 all rheo 3 RK1 4 surface/detection divergence 1.5 8 density 4 8 | 6.0 4 1.5 8 1.0 2.0
fix 1 all rheo 3 RK1 4 speed/sound 1 2 thermal | 6.0 4 2.0 4.0
fix 2 all rheo/viscosity 1 constant 0.1 2*3 power 0.1 2 3 0.5 | 1 0.1 0.1 2 3.0 0.5
fix 3 all rheo/pressure 1 cubic 2 2 tait/general 7 * background 3 | 1 32.0 2 7 3.0
fix 4 all rheo/thermal conductivity * constant 1 specific/heat 1 constant 3 Tfreeze 1 constant 5 | 4.0 1 12.0 1 5
fix 5 water gravity 9.81 vector 0 -1 0 | 19.62 0 -1 0
fix 6 walls setforce 0 NULL 1 | 0 2.0
fix 7 all add/heat linear 1 2 overwrite yes | 1 8.0
neighbor 0.25 bin | 0.5
comm_modify mode single cutoff 2 vel yes | 4.0
timestep 0.1 | 0.1
compute 2 all reduce max c_p[1] | 2
"""
AMBIGUOUS = """
fix 5 water addforce v_push 0 0
fix 5 water addforce 1 0 0 region left
fix 5 box deform 1 x erate 0.1
fix 5 all rheo 3 quintic 0 unheard 1
fix 5 all rheo/viscosity 1-2 constant 0.1
fix 5 all wall/reflect ylo EDGE
pair_style hybrid/overlay rheo 3 soft 1
compute 1 all coord/atom cutoff 2
run 100 every 10 NULL
dump_modify 1 thresh x > 2
neigh_modify binsize 1
run_style verlet
minimize 0 0 1 1
read_restart file
"""


@pytest.mark.parametrize("row", SCALED.strip().splitlines())
def test_numbers_are_scaled_by_their_dimensions(row: str) -> None:
    written, scaled = row.split(" | ")
    words = Scaling(Scale(2, 2.0), FIRST).command(command(written))
    after = words[4 if words[0] == "fix" else 1 :]
    assert [word for word in after if word.lstrip("-")[:1].isdigit() and "*" not in word] == scaled.split()
    assert [w for w in words if w[:1].isalpha()] == [w for w in written.split() if w[:1].isalpha()]


@pytest.mark.parametrize("written", AMBIGUOUS.strip().splitlines())
def test_ambiguous_command_is_refused(written: str) -> None:
    with pytest.raises(InputError, match=r"^command .*cannot be rescaled with certainty.*found .*\(in.deck:7\)$"):
        Scaling(Scale(2, 2.0), FIRST).command(command(written))


@pytest.mark.parametrize(
    ("written", "runs", "kept"),
    [
        ("region left block 0 1 0 1 0 1", 0, False),
        ("set group all rheo/rho 1", 0, False),
        ("print hello", 0, False),
        ("jump SELF loop", 1, False),
        ("unfix 5", 1, True),
        ("set group all rheo/rho 1", 1, None),
        ("group wet dynamic all every 1", 0, True),  # `Scaling` refuses it
        ("timestep ${dt}", 0, True),
        ("timestep ${dt}", 1, None),
        ("newton off", 1, None),
        ('if "$(ke) > 1" then "run 1"', 0, False),  # conditions are evaluated only before the first run
        ('if "$(ke) > 1" then "run 1"', 1, None),
    ],
)
def test_state_before_the_first_run_is_kept(written: str, runs: int, kept: bool | None) -> None:
    script = [ScriptCommand("in.deck:7", written, runs) if written.startswith("if") else command(written, runs)]
    if kept is None:
        with pytest.raises(InputError, match=r"(after the first run|command if: ).*\(?in.deck:7\)?"):
            list(scaling.kept_commands(script))
    else:
        assert bool(list(scaling.kept_commands(script))) is kept


def test_only_referenced_variables_are_kept() -> None:
    script = ["variable a equal v_b+1", "variable b equal 2", "variable c equal 3", "thermo_style custom step v_a"]
    assert scaling.needed_variables([*map(command, script)]) == {"a", "b"}


def test_groups_are_defined_by_types_or_ids() -> None:
    type_n, id_n, no = np.array([1, 2, 2, 1, 1]), np.array([9, 1, 2, 4, 5]), np.zeros(0)
    members = {"all": type_n > 0, "wall": type_n == 2, "some": id_n < 5, "none": type_n == 3}
    groups = module._groups(StartState(no, no, [], id_n, type_n, no, no, no, no, no, members))
    assert list(groups) == ["group wall type 2", "group some id 1:2", "group some id 4:4", "group none empty"]


# --- with LAMMPS


def written(text: str, folder: Path) -> list[str]:
    (folder / "in.deck").write_text(text)
    return rescale(folder / "in.deck", AuditOptions(), folder / "new" / "in.new")


@pytest.mark.lammps
@pytest.mark.slow
def test_column_unstable_in_lammps_runs_in_another_unit_of_length(
    tmp_path: Path, eos_ref_command: Callable[..., Outcome]
) -> None:
    (tmp_path / "in.deck").write_text(COLUMN)
    words = ("--rescale", tmp_path / "in.new", "--out", tmp_path / "r")
    code, out, err = eos_ref_command("audit", tmp_path / "in.deck", *words)
    assert code == 3, "the deck itself loses particles"
    text = " ".join((out + err).split())
    assert "unit of length 0.1, in which m/rho0 is 1 instead of 0.01; LAMMPS runs it, 100 steps, 180 atoms" in text
    assert "100 times too large in LAMMPS before" in text and REPULSION in text
    deck = (tmp_path / "in.new").read_text().splitlines()
    lines = {
        "fix 4 water gravity 10.0 vector 0 -1 0",
        "neighbor 3.0 bin",
        "group floor type 2",
        "read_data in.new.data",
    }
    assert lines <= {*deck}
    assert "outputs times these factors are those of the deck: x 0.1, v 0.1, f 0.1, rho 100," in "\n".join(deck)


THREE = """units cgs
dimension 3
atom_style rheo/thermal
boundary p s p
comm_modify vel yes
newton off
lattice sc 0.02
region box block 0 6 0 7 0 6
create_box 2 box
region low block INF INF 0 2.5 INF INF
region up block INF INF 2.6 INF INF INF
create_atoms 2 region low
create_atoms 1 region up
group up type 1
group few id 150 157:159
mass * 9.6e-6
set group all rheo/rho 1.2
set type 2 rheo/status 1
set group all sph/e 0.001
set type 2 sph/e 0.002
displace_atoms up random 0.002 0.002 0.002 77
velocity up set 0.01 0 0.02
timestep 1e-5
pair_style rheo 0.06 artificial/visc 0.2 rho/damp 0.002 harmonic/means
pair_coeff * *
fix 1 all rheo 0.06 quintic 0 thermal interface/reconstruct shift surface/detection divergence 2.5 4 &
  density 1.2 1.2 speed/sound 20 20
fix 2 all rheo/viscosity 1 constant 0.01 2 power 0.02 1.0 0.01 0.7
fix 3 all rheo/pressure 1 linear 2 tait/general 1.4
fix 4 all rheo/thermal conductivity * constant 0.3 specific/heat * constant 1.5 Tfreeze 2 constant 5 &
  latent/heat 2 constant 0.3
fix 5 up gravity 9.81 vector 0 -1 0
fix 6 few addforce 1e-6 0 0
fix 7 all add/heat constant 1e-5
run 10
unfix 5
run 10
"""


@pytest.mark.lammps
@pytest.mark.slow
def test_three_dimensions_and_heat(tmp_path: Path) -> None:
    first, second = written(THREE, tmp_path)
    assert "unit of length 0.02, in which m/rho0 is 1 instead of 8e-06; LAMMPS runs it, 20 steps" in first
    assert second.startswith("same physics: ") and "120 000 times too large in LAMMPS before" in second
    deck = (tmp_path / "new" / "in.new").read_text()
    assert "fix 7 all add/heat constant 0.025" in deck and "group few id 157:159\n" in deck
    assert deck.index("run 10") < deck.index("unfix 5") < deck.rindex("run 10")


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (DRY.replace("* 0.01\n", "* 1.0\n", 1), "is 1 already"),
        (DRY.replace("density 1.0 1.0", "density 1.0 2.0"), "must be the same for all types"),
        (DRY.replace("units           lj", "units           micro"), "must be one of lj, si, cgs"),
        (DRY.replace(RUN, "fix 7 all nve\nrun 1\n"), r"command fix nve: .*\(in.deck:27\)"),
        (DRY.replace(RUN, "run 1\nset type 1 rheo/rho 2\nrun 1\n"), r"command set: .*\(in.deck:28\)"),
    ],
)
def test_deck_that_no_unit_of_length_can_fix_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        written(text, tmp_path)
    assert not (tmp_path / "new").exists()


@pytest.mark.lammps
def test_number_with_the_wrong_factor_is_detected(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the reference, from the particles of the set-up; with LAMMPS once, as all set-ups of a folder are equal."""
    (tmp_path / "in.deck").write_text(THREE)
    _, setups = described(tmp_path / "in.deck", AuditOptions())
    right = Scaling.factor
    assert module.rescaled(setups, "in.deck", "in.new").same <= 1
    for wrong in ("acceleration", "x", "rho", "v", "viscosity", "conductivity", "cv", "diffusivity", "f"):
        off = {wrong: 1.001}
        monkeypatch.setattr(Scaling, "factor", lambda s, of, off=off: right(s, of) * off.get(of, 1.0))
        with pytest.raises(InputError, match=r"must be the same to the reference: .* differs by"):
            module.rescaled(setups, "in.deck", "in.new")
