"""The name of a field in a record is made, and taken apart, in one place."""

from __future__ import annotations

import re
from pathlib import Path

import lammps_cases
from lammps_cases.records.wording import GIVEN, after_stop, given, parted
from lammps_cases.scene.fields import FIELDS


def test_what_is_named_is_taken_apart() -> None:
    assert [parted(name) for name in FIELDS] == [(name, "") for name in FIELDS]
    assert parted(given("rho")) == ("rho", GIVEN)
    assert parted(after_stop("grad/v", "data nofix", 12)) == ("grad/v", "data nofix at 12")


def test_nobody_else_reads_a_name() -> None:
    """Not the ending of input, nor the bracket that begins it."""
    read = re.compile(r"""["'}] ?\(given\)|partition\(" \("|split\(" \(""")
    modules = Path(lammps_cases.__file__).parent.rglob("*.py")
    assert [path.name for path in modules if read.search(path.read_text(encoding="utf-8"))] == ["wording.py"]
