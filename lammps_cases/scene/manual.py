"""Input that a scene takes from the manual: example lines passed to LAMMPS unchanged, and rules broken on purpose.

A scene names the example or the rule; it cannot give its own commands, so a foreign case file runs nothing
but the model.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from lammps_cases.scene.values import BrokenRule, SceneModel

Page = Literal["rheo", "pressure"]
EXAMPLES: dict[Page, tuple[str, ...]] = {
    "rheo": (
        "fix 1 all rheo 3.0 quintic 0 thermal density 0.1 0.1 speed/sound 10.0 1.0",
        "fix 1 all rheo 3.0 RK1 10 shift surface/detection coordination 40",
        "fix 1 all rheo 3.0 RK1 10 rhosum self/mass",
    ),
    "pressure": (
        "fix 1 all rheo/pressure * linear",
        "fix 1 all rheo/pressure 1 linear 2 cubic 10.0",
        "fix 1 all rheo/pressure * linear * background 0.1",
    ),
}
Number = Annotated[int, Field(strict=True, ge=1, le=3)]
TextEdits = tuple[tuple[str, str], ...]  # regular expressions of lines, and their replacements
_NO_PRESSURE = (r"^fix pressure .*\n", "")
_SOME = ("^fix rheo all", "group some id 1\nfix rheo all")
# The edits that break each rule, in the commands of a scene that keeps it.
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


class ExampleSettings(SceneModel):
    """An example of the manual, by its place: LAMMPS gets the line as it stands, in place of the scene's own.

    The scene still says the same in its keys, for the reference; see `lammps_cases.scene.case`.
    """

    rheo: Number | None = Field(None, description="line of the page fix rheo")
    pressure: Number | None = Field(None, description="line of the page fix rheo/pressure")

    @model_validator(mode="after")
    def _exactly_one(self) -> ExampleSettings:
        if (self.rheo is None) == (self.pressure is None):
            raise BrokenRule("needs exactly one of rheo, pressure: all lines of the manual have the same fix ID")
        return self

    def line(self, page: Page) -> str | None:
        """Return the line of a page, if the scene takes it from there."""
        number = self.rheo if page == "rheo" else self.pressure
        return None if number is None else EXAMPLES[page][number - 1]


def with_broken_rule(commands: Iterable[str], violation: Violation | None) -> tuple[str, ...]:
    """Return the commands, one a line, that break a rule; as they are without one."""
    text = "".join(f"{line}\n" for line in commands)
    for pattern, new in VIOLATIONS[violation] if violation else ():
        text = re.sub(pattern, new, text, flags=re.MULTILINE)
    return tuple(text.split("\n")[:-1])
