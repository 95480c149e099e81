"""Rules of the manual that a scene may break on purpose, to see LAMMPS refuse it.

A scene names the rule; it cannot give commands of its own, so a case file from elsewhere runs nothing but the model.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal

TextEdits = tuple[tuple[str, str], ...]  # regular expressions of lines, and what stands in their place
_NO_PRESSURE = (r"^fix pressure .*\n", "")
_SOME = ("^fix rheo all", "group some id 1\nfix rheo all")

# What breaks each rule, in the commands of a scene that keeps it.
VIOLATIONS: Mapping[str, TextEdits] = MappingProxyType(
    {
        "atom-style-atomic": ((r"^atom_style .*", "atom_style atomic"), (r"^set type \d+ rheo/status .*\n", "")),
        "no-fix-rheo": ((r"^fix rheo .*\n", ""),),
        "no-fix-pressure": (_NO_PRESSURE, (r"^compute q .*\n", "")),
        "no-fix-pressure-read": (_NO_PRESSURE,),
        "no-fix-viscosity": ((r"^fix viscosity .*\n", ""),),
        "pressure-before-rheo": ((r"^(fix rheo (?:.*\n)+?)(fix pressure .*\n)", r"\2\1"),),
        "pressure-group": (_SOME, ("^fix pressure all", "fix pressure some")),
        "pressure-twice": ((r"^fix pressure (.*\n)", r"\g<0>fix pressure2 \1"),),
        "rheo-group": (_SOME, ("^fix rheo all", "fix rheo some")),
        "rheo-twice": ((r"^fix rheo (.*\n)", r"\g<0>fix rheo2 \1"),),
        "unknown-pressure-style": ((r"^(fix pressure all \S+ \S+) \S+", r"\1 taitwater"),),
        "missing-argument": ((r"^(fix pressure .*) \S+$", r"\1"),),
        "no-fix-thermal": ((r"^(fix rheo( \S+){5})( thermal)?", r"\1 thermal"), (r"^fix thermal .*\n", "")),
        "atom-style-rheo": ((r"^atom_style .*", "atom_style rheo"),),
    }
)
if TYPE_CHECKING:
    Violation = str
else:
    Violation = Literal[tuple(VIOLATIONS)]


def broken(commands: Iterable[str], violation: Violation | None) -> tuple[str, ...]:
    """Return the commands, one a line, that break a rule; as they are without one."""
    text = "".join(f"{line}\n" for line in commands)
    for pattern, new in VIOLATIONS[violation] if violation else ():
        text = re.sub(pattern, new, text, flags=re.MULTILINE)
    return tuple(text.split("\n")[:-1])
