"""Texts of the findings about outputs, checked with LAMMPS."""

from __future__ import annotations

import numpy as np
import pytest

from lammps_cases.claims.probes.run import Reply
from tests.support.printed import quoted
from tests.support.small_scene import Engine

pytestmark = pytest.mark.lammps


def asked(lammps: Engine, words: str) -> Reply:
    """The deck of the probes with shift and a compute, without steps."""
    return lammps.reply(
        "deck", ("quintic 0", "quintic 0 shift"), ("run 3", f"compute q all rheo/property/atom {words}\nrun 0")
    )


def test_nbond_shell_segfault(lammps: Engine) -> None:
    (name,) = quoted("nbond-shell-segfault", "observed")
    reply = asked(lammps, name)
    assert reply.ended == "crashed" and reply.error.endswith("SIGSEGV"), "nothing more, so no message"
    assert lammps.reply("oxide", (f"surface {name}", f"surface {name}")).ended == "answered", "with fix rheo/oxidation"


def test_component_names_unchecked(lammps: Engine) -> None:
    """Names too long are read by their last letters; a star next to a letter never gives a right answer."""
    tensor, vector, row, stars = quoted("component-names-unchecked", "observed")
    for long, short in ((tensor, "grad/v/yx"), (vector, "shift/v/x")):
        ours, theirs = asked(lammps, f"{long} rho"), asked(lammps, f"{short} rho")
        assert np.array_equal(ours.arrays["q"], theirs.arrays["q"]) and ours.arrays["q"].any(axis=0).all()
    for word in (row, stars):
        reply = asked(lammps, f"{word} rho")
        assert reply.ended == "crashed" or reply.arrays["q"].shape[1] != 5
    assert asked(lammps, "grad/v/xy shift/v/y grad/v/* shift/v/* rho").arrays["q"].shape[1] == 1 + 1 + 4 + 2 + 1
    refused = quoted("component-names-unchecked", "argument")[0]
    assert asked(lammps, f"{refused} rho").ended == "refused"
