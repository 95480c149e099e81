"""What a cell is called: on the command line, in a page, as a file."""

from __future__ import annotations

import re
import shlex

from eos_ref import InputError
from lammps_cases.studies.stability.model import MapCell


def name(cell: MapCell) -> str:
    """``MAP:LAYER:X:Y``, with numbers that read back as the same doubles."""
    return f"{cell.map}:{cell.layer}:{float(cell.x)!r}:{float(cell.y)!r}"


def parse(text: str) -> MapCell:
    """The cell of a name.

    Raises
    ------
    InputError
    """
    # A layer may hold colons; the others may not.
    first, _, rest = text.partition(":")
    layer, *numbers = rest.rsplit(":", 2)
    try:
        x, y = (float(number) for number in numbers)
    except ValueError:
        raise InputError("cell", "must be MAP:LAYER:X:Y with two numbers", text) from None
    return MapCell(first, x, y, layer)


def command(cell: MapCell) -> str:
    """The command that runs a cell again."""
    return f"eos-ref stability --cell {shlex.quote(name(cell))}"


def anchor(cell: MapCell) -> str:
    """A name that can stand in an address or be a file's, different for every cell."""
    return re.sub(r"[^A-Za-z0-9.+-]", lambda m: "__" if m[0] == ":" else f"_{ord(m[0]):x}_", name(cell))
