"""The share of pair_style rheo in forces with other contributions: a second deck, with that style alone.

The user's run is not changed; another LAMMPS, in its own process, runs the particles of a sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from lammps_cases.audit.deck import Deck, rheo_words
from lammps_cases.audit.evaluation import ParticleSample
from lammps_cases.audit.fields import Array
from lammps_cases.audit.messages import PairShare

STYLES = ("rheo", "rheo/viscosity", "rheo/pressure", "rheo/thermal")  # of the fixes that the forces of pairs depend on
SCRIPT, DATA = "in.share", "share.data"


def can_be_had(deck: Deck) -> bool:
    """Return whether a second deck can have all that the forces of pair_style rheo depend on."""
    of_all = all(values[2] == "all" for values in deck.fixes.values() if values[3] in STYLES)
    return of_all and "rheo" in deck.pair and not (deck.bonded or deck.hides_pairs() or deck.changes_pairs())


def share(
    deck: Deck, sample: ParticleSample, id_n: Array, box_c: Array, units: str, reason: str, run: int, step: int
) -> PairShare:
    """Return the second deck for a sample, and its data file.

    Along axes that are not periodic the box is longer by a cutoff on either side: nothing may be lost at its faces.
    """
    model, d, periodic = sample.model, sample.model.dimension, (*sample.box.periodic, True)[:3]
    heat = sample.state.energy_n is not None
    style = "rheo/thermal" if heat else "rheo"
    commands = [
        f"units {units}", f"dimension {d}", f"atom_style {style}",
        f"boundary {' '.join('p' if flag else 'f' for flag in periodic)}",
        "comm_modify vel yes", "newton off", f"neighbor {0.1 * model.cut!r} bin", f"read_data {DATA}",
        *(f"mass {t} {mass!r}" for t, mass in enumerate(model.mass_t, 1)),
        f"pair_style {' '.join(rheo_words(deck.pair))}", "pair_coeff * *",
        *(" ".join(values) for values in deck.fixes.values() if values[3] in STYLES),
        "run 0",
    ]  # fmt: skip
    room_c = np.where(periodic, 0.0, model.cut)
    low_c, high_c = box_c[0] - room_c, box_c[1] + room_c
    tilt = box_c[2] if len(box_c) > 2 else None
    s, n = sample.state, len(id_n)
    heat_n = [] if s.energy_n is None else [s.energy_n]
    x_nc = _in_space(s.x_nc, np.zeros(n) if sample.z_n is None else sample.z_n)
    columns = (id_n, s.type_n, s.solid_n.astype(int), s.rho_n, *heat_n, *x_nc.T)
    velocities = (id_n, *_in_space(s.v_nc, np.zeros(n)).T)
    lines = data(columns, velocities, len(model.mass_t), style, low_c, high_c, tilt)
    return PairShare(run, step, reason, commands, lines)


def data(
    atoms: Sequence[Array],
    velocities: Sequence[Array],
    ntypes: int,
    style: str,
    low_c: Array,
    high_c: Array,
    tilt_c: Array | None,
) -> list[str]:
    """Return the lines of a data file, by the columns of its two sections."""
    edges = [
        f"{low!r} {high!r} {a}lo {a}hi" for low, high, a in zip(low_c.tolist(), high_c.tolist(), "xyz", strict=True)
    ]
    edges += [] if tilt_c is None else [" ".join(map(repr, tilt_c.tolist())) + " xy xz yz"]
    head = ["particles of a deck", "", f"{len(atoms[0])} atoms", f"{ntypes} atom types", "", *edges]
    return [*head, "", f"Atoms # {style}", "", *_rows(*atoms), "", "Velocities", "", *_rows(*velocities), ""]


def _in_space(values_nc: Array, third_n: Array) -> Array:
    return values_nc if values_nc.shape[1] == 3 else np.column_stack([values_nc, third_n])


def _rows(*columns: Array) -> list[str]:
    lists: Sequence[list[float]] = [column.tolist() for column in columns]
    return [" ".join(map(repr, row)) for row in zip(*lists, strict=True)]


def write(pairs: PairShare, folder: Path) -> Path:
    """Write the second deck into a folder, and return its path."""
    (folder / DATA).write_text("\n".join(pairs.data), encoding="utf-8")
    script = folder / SCRIPT
    script.write_text("\n".join([*pairs.commands, ""]), encoding="utf-8")
    return script
