"""What is said by some versions of LAMMPS' manual, and not by others."""

from __future__ import annotations

from pydantic import BaseModel, model_validator

from eos_ref.syntax.manual import FIRST, MANUALS, Manual


class OfManual(BaseModel):
    """A statement of the manual.

    Attributes
    ----------
    since, until : the first and the last version of the manual that makes it; by default the first and the newest
    """

    since: Manual = FIRST
    until: Manual = MANUALS[-1]

    @model_validator(mode="after")
    def _in_order(self) -> OfManual:
        if MANUALS.index(self.since) > MANUALS.index(self.until):
            raise ValueError("since must not be later than until")
        return self

    def made_in(self, manual: Manual) -> bool:
        """Return whether a version of the manual makes it."""
        return MANUALS.index(self.since) <= MANUALS.index(manual) <= MANUALS.index(self.until)
