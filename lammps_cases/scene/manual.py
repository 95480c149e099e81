"""The example lines of the two manual pages, which a scene may give to LAMMPS as they stand."""

from __future__ import annotations

from typing import Annotated, Literal

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
