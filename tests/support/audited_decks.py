"""Decks for audits: those of tests/decks, and short ones that tests write."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from lammps_cases.audit.options import AuditResult
from lammps_cases.records.run_record import CaseRecord

DECKS = Path(__file__).parents[1] / "decks"
PLAIN = "import sys; from lammps_cases.engine.session import open_lammps; open_lammps().file(sys.argv[1])"
FIXES = "fix 1 all rheo 3.0 quintic 0\nfix 2 all rheo/viscosity * constant 0.1\n"
MELT = """lattice fcc 0.8
region cell block 0 3 0 3 0 3
create_box 1 cell
create_atoms 1 box
mass 1 1.0
pair_style lj/cut 2.5
pair_coeff 1 1 1.0 1.0
run 5
"""


def case_of(result: AuditResult) -> CaseRecord:
    return result.record.cases[0]


def write_deck(folder: Path, commands: str) -> Path:
    """A deck for a fluid that is already defined."""
    shutil.copy(DECKS / "fluid.inc", folder)
    deck = folder / "in.deck"
    deck.write_text("variable style string rheo\ninclude fluid.inc\n" + commands)
    return deck


def run_plain(deck: str, folder: Path) -> None:
    """Run a deck of a folder in LAMMPS, without an audit."""
    subprocess.run([sys.executable, "-c", PLAIN, deck], cwd=folder, check=True, capture_output=True)


def written(folder: Path) -> dict[str, bytes]:
    """The output of a deck, by file."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".dump", ".txt")}
