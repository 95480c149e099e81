"""Decks for audits: those of tests/decks, and short ones that tests write."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

from lammps_cases.audit.options import AuditResult
from lammps_cases.records.run_record import CaseRecord

DECKS = Path(__file__).parents[1] / "decks"
PLAIN = """import os, sys
from lammps_cases.engine.session import open_lammps
for deck in sys.argv[1:]:
    os.chdir(os.path.dirname(os.path.abspath(deck)))
    open_lammps().file(os.path.basename(deck))
"""
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


def inlined(name: str) -> list[str]:
    """The lines of a deck, with those of its includes."""
    lines: list[str] = []
    for line in (DECKS / name).read_text().splitlines():
        included = re.fullmatch(r"include\s+(\w+\.inc)", line)
        lines += inlined(included[1]) if included else [line]
    return lines


def fluid_deck(commands: str) -> str:
    """The text of a deck for a fluid that is already defined."""
    return "variable style string rheo\n" + (DECKS / "fluid.inc").read_text() + commands


def write_deck(folder: Path, commands: str) -> Path:
    """A deck for a fluid that is already defined."""
    shutil.copy(DECKS / "fluid.inc", folder)
    deck = folder / "in.deck"
    deck.write_text("variable style string rheo\ninclude fluid.inc\n" + commands)
    return deck


def run_plain(*decks: Path) -> None:
    """Run decks in LAMMPS, without an audit, each in its folder."""
    subprocess.run([sys.executable, "-c", PLAIN, *map(str, decks)], check=True, capture_output=True)


def written(folder: Path) -> dict[str, bytes]:
    """The output of a deck, by file."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.suffix in (".dump", ".txt")}
