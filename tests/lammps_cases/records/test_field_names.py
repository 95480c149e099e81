"""Names of fields in records are made and parsed in one place."""

from __future__ import annotations

import re
from pathlib import Path

import lammps_cases
from lammps_cases.records.wording import GIVEN, after_stop, given, parted
from lammps_cases.scene.fields import FIELDS


def test_names_are_parsed() -> None:
    assert [parted(name) for name in FIELDS] == [(name, "") for name in FIELDS]
    assert parted(given("rho")) == ("rho", GIVEN)
    assert parted(after_stop("grad/v", "data nofix", 12)) == ("grad/v", "data nofix at 12")


def test_no_other_module_parses_a_name() -> None:
    """Neither the suffix of input nor its opening bracket."""
    read = re.compile(r"""["'}] ?\(given\)|partition\(" \("|split\(" \(""")
    modules = Path(lammps_cases.__file__).parent.rglob("*.py")
    assert [path.name for path in modules if read.search(path.read_text(encoding="utf-8"))] == ["wording.py"]
