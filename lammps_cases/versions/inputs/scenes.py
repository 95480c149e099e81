"""Inputs by hand: scenes that the project refuses, and what each is in LAMMPS' commands (``probes/inputs.yaml``).

They are the mistakes that no command alone shows: particles, boxes, runs, forces, and what fits no other part of the
scene. The words of the commands themselves are generated (`lammps_cases.versions.inputs.generate`).
"""

from __future__ import annotations

import functools
from typing import Any

from lammps_cases.claims.probes.probe import Input, Probe, base, commands, load, offending
from lammps_cases.versions.inputs.refusals import refusal


class BadInput(Probe):
    """An input that the project refuses, its id the name of the refusal in words joined by hyphens.

    Attributes
    ----------
    area : subject of the input
    names : the manual's words for the quantity that is wrong; a clear error has one of them, or the offending word
    promise : what LAMMPS' manual says about it, if anything
    scene : keys of the equivalent scene; without them, and without a check, the edited fixes are parsed
    """

    base: str = "one"
    area: str
    names: tuple[str, ...]
    promise: str = ""
    scene: dict[str, Any] | None = None

    @property
    def refusal(self) -> str:
        """Error message of this project."""
        return refusal(self, self.scene)

    @property
    def words(self) -> str:
        """Commands in which it differs from its base, as a deck would hold them."""
        before = set(commands(base(self.base)))
        lines = [line for line in commands(self.input) if line not in before]
        return "; ".join(lines) or f"without {', '.join(self.drop)}"

    @property
    def clear(self) -> tuple[str, ...]:
        """Words of which a clear error has one."""
        return (*self.names, *offending(self))

    @property
    def others(self) -> tuple[str, ...]:
        """Words by which an error speaks of something else; nothing says which those of a scene are."""
        return ()

    @property
    def control(self) -> Input:
        """The same without what is wrong."""
        return base(self.base)


@functools.cache
def bad_inputs() -> tuple[BadInput, ...]:
    """Return all inputs, in the order of the list."""
    return load("inputs.yaml", BadInput)
