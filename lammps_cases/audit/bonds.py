"""The bonds of a sample, with the reference lengths that LAMMPS keeps: computes of the audit's own, evaluated there.

What compute bond/local shows has to be put right. bond_style hybrid shows ``b1`` of a bond in the next row of the same
style, of the last one in the first such row of the evaluation that follows: two computes are evaluated. A bond of
rheo/shell that was not enabled when neighbour lists were last built repeats what others left: ``b1`` of the shell bond
before it, and the force per distance of the row before it. Whether these bonds are all is known by nbond/shell.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from eos_ref.eos.bounds import EPS
from eos_ref.model.bonds import BondLaw, Bonds, ShellBond
from eos_ref.model.box import BoolArray
from lammps_cases.audit import arrays

Array = npt.NDArray[Any]
WHO, FIRST, AGAIN, ENABLED = "eosref_bond", "eosref_length", "eosref_length_again", "eosref_enabled"
LOCAL, ARRAY = 2, 2  # of extract_compute
SAME = 4 * EPS  # a product and a quotient on either side


def define(lmp: Any, shells: bool) -> None:
    """Define the computes; ``shells``: whether the deck has fix rheo/oxidation."""
    lmp.command(f"compute {WHO} all property/local btype batom1 batom2")
    for name in (FIRST, AGAIN):
        lmp.command(f"compute {name} all bond/local b1 dist force")
    if shells:
        lmp.command(f"compute {ENABLED} all rheo/property/atom pressure nbond/shell")


def drop(lmp: Any) -> None:
    """Remove the computes, if there are any."""
    for name in (WHO, FIRST, AGAIN, ENABLED):
        if lmp.has_id("compute", name):
            lmp.command(f"uncompute {name}")


def read(lmp: Any, laws: Sequence[BondLaw], tag_n: Array, hybrid: bool) -> tuple[Bonds, BoolArray]:
    """Return the bonds that act, particles numbered as in the ids ``tag_n``, and for which particles these are all."""
    n = len(tag_n)
    who_bk = lmp.numpy.extract_compute(WHO, LOCAL, ARRAY)
    if who_bk is None:
        return Bonds(), np.ones(n, bool)
    type_b, *ends = who_bk.astype(int).T
    length_b, r_b, force_b = lmp.numpy.extract_compute(FIRST, LOCAL, ARRAY).T.copy()
    again_b = lmp.numpy.extract_compute(AGAIN, LOCAL, ARRAY)[:, 0]
    order_n = np.argsort(tag_n)
    i_b, j_b = (order_n[np.searchsorted(tag_n[order_n], end_b)] for end_b in ends)
    shell_b = np.array([isinstance(law, ShellBond) for law in laws])[type_b - 1]
    if hybrid:
        for row_s in (np.flatnonzero(shell_b), np.flatnonzero(~shell_b)):
            length_b[row_s] = np.append(length_b[row_s[1:]], again_b[row_s[:1]])
    acts_b = ~shell_b
    acts_b[shell_b] = ~_repeats(length_b[shell_b], force_b / r_b, np.flatnonzero(shell_b))
    bonds = Bonds(i_b[acts_b], j_b[acts_b], type_b[acts_b], length_b[acts_b])
    if not lmp.has_id("compute", ENABLED):
        return bonds, np.ones(n, bool)
    found_n = np.bincount(np.concatenate([i_b[acts_b & shell_b], j_b[acts_b & shell_b]]), minlength=n)
    return bonds, found_n == arrays.compute(lmp, ENABLED, 2, n)[:, 1]


def _repeats(length_s: Array, ratio_b: Array, row_s: Array) -> BoolArray:
    """Return which shell bonds repeat what the rows before them had, (s,); of the first, nothing is known but that."""
    with np.errstate(invalid="ignore"):
        ratio_s, before_s = ratio_b[row_s], ratio_b[row_s - 1]
        as_before = np.abs(ratio_s - before_s) <= SAME * np.abs(ratio_s)
    return np.asarray((length_s == np.roll(length_s, 1)) & (as_before | (row_s == 0)))
