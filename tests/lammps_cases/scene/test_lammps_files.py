"""Scenes from LAMMPS' own files: the scene takes the numbers that LAMMPS writes, bit by bit."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import InputError
from lammps_cases.engine import session
from lammps_cases.scene import casefile, lammps_files
from lammps_cases.scene.atoms import Atoms, build
from tests.support.hostile import BINARY_DUMP

SCENE = """
name: from-file
about: Particles of a file.
exercises: {{"*": [water-of-six]}}
scene:
  dimension: {dimension}
  types: [{{mass: 1.5}}, {{mass: 0.7, phase: {phase}}}]
  positions: {positions}
  pressure: [{{types: "*", style: tait/water}}]
  rheo: {{cut: 1.2}}
  {more}
"""


def _built(folder: Path, positions: str, dimension: int = 3, phase: str = "solid", more: str = "") -> Atoms:
    path = folder / "case.yaml"
    path.write_text(SCENE.format(dimension=dimension, phase=phase, positions=positions, more=more))
    (case,) = casefile.load([path])
    return build(case, case.scene.eos(case.where))


@pytest.fixture(scope="module", params=[(2, "rheo"), (3, "rheo"), (3, "rheo/thermal")], ids=str)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int, Any]:
    """A folder with the files of real LAMMPS, the dimension, and its arrays by id."""
    (dimension, style), folder = request.param, tmp_path_factory.mktemp("files")
    lmp = session.open_lammps()
    depth = "-0.25 0.25 0.3 0 0" if dimension == 2 else "-0.7 2.1 0.3 -0.2 0.4"
    lmp.commands_string(f"""
        dimension {dimension}
        atom_style {style}
        region box prism 0 3.1 -1 2 {depth}
        create_box 2 box
        create_atoms 1 random 20 73 NULL
        create_atoms 2 random 10 99 NULL
        mass * 1.0
        set group all rheo/rho 1.0
        set type 2 rheo/status 1
        velocity all create 1.0 4711
    """)
    rng = np.random.default_rng(8)
    arrays = {name: np.array(lmp.numpy.extract_atom(name)) for name in ("id", "type", "x", "v")}
    for name in ("rho", "esph")[: 1 + style.endswith("thermal")]:
        lmp.numpy.extract_atom(name)[:] = arrays[name] = rng.uniform(0.9, 1.1, 30)
    columns = "id type x y z vx vy vz modify sort -1"
    lmp.command(f"write_dump all custom {folder / 'a.dump'} {columns} format float %.17g")
    lmp.command(f"write_dump all custom {folder / 'a.bin'} {columns} time yes units yes")
    lmp.command(f"write_data {folder / 'a.data'}")  # which moves particles of a tilted box
    order_n = np.argsort(arrays["id"])
    return folder, dimension, {name: values_n[order_n] for name, values_n in arrays.items()}


@pytest.mark.parametrize("positions", ["{data: a.data}", "{dump: a.dump}"])
def test_scene_has_the_numbers_that_lammps_wrote(written: tuple[Path, int, Any], positions: str) -> None:
    folder, dimension, arrays = written
    dumped = "dump" in positions
    found = _built(folder, positions, dimension, more="rho: {constant: 1.0}" if dumped else "")
    assert found.v_nc is not None and found.rho_n is not None
    # A data file has 16 digits: half a unit of the last one, and rounding to a double. Before writing, LAMMPS converts
    # positions to fractions of a tilted box and back: three products and sums each way, of lengths below 4.
    np.testing.assert_allclose(found.v_nc, arrays["v"], rtol=0 if dumped else 5e-16 + 2.0**-53)
    np.testing.assert_allclose(found.x_nc, arrays["x"], rtol=0, atol=0 if dumped else 12 * 4 * 2.0**-53)
    np.testing.assert_array_equal(found.type_n, arrays["type"])
    if not dumped:
        np.testing.assert_allclose(found.rho_n, arrays["rho"], rtol=5e-16 + 2.0**-53)
    if not dumped and "esph" in arrays:
        assert found.energy_n is not None
        np.testing.assert_allclose(found.energy_n, arrays["esph"], rtol=5e-16 + 2.0**-53)
    box = found.box(dimension)
    tilt = (0.3,) if dimension == 2 else (0.3, -0.2, 0.4)
    # A dump gives the bounds of the upright box around the tilted one: a sum and a difference for each.
    np.testing.assert_allclose(found.low_c, [0, -1, -0.25 if dimension == 2 else -0.7], atol=4 * 2.0**-52)
    np.testing.assert_allclose(found.high_c, [3.1, 2, 0.25 if dimension == 2 else 2.1], atol=4 * 2.0**-52)
    assert box.tilt == tilt and all(found.periodic)


def test_scene_overrides_its_file(written: tuple[Path, int, Any]) -> None:
    folder, dimension, _ = written
    more = "velocity: {uniform: [1" + ", 0" * (dimension - 1) + "]}\n  rho: {constant: 1.25}"
    found = _built(folder, "{data: a.data}", dimension, more=more)
    assert found.v_nc is not None and found.rho_n is not None
    assert (found.rho_n == 1.25).all() and (found.v_nc[found.type_n == 1] == [1, 0, 0]).all()


def _edited(old: str, new: str) -> Callable[[str], str]:
    return lambda text: text.replace(old, new, 1)


DATA = """LAMMPS data file

3 atoms
2 atom types

0 4 xlo xhi
0 4 ylo yhi
0 4 zlo zhi

Atoms # rheo

1 1 0 1.0 1 1 1
2 1 0 1.1 2 1 1
3 2 1 1.2 3 1 1 0 0 0
"""
DUMP = """ITEM: TIMESTEP
{step}
ITEM: NUMBER OF ATOMS
1
ITEM: BOX BOUNDS pp ff pp
0 4
0 4
0 4
ITEM: ATOMS id type x y z c_rho
7 1 1 1 1 {rho}
"""
GOOD = DATA.replace(" 0 0 0\n", "\n")


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (lambda _: DATA, "Atoms: must hold 7 or 10 columns on every line, found '3 2 1 1.2 3 1 1 0 0 0'"),
        (_edited("Atoms # rheo", "Atoms # atomic"), "Atoms: must be of one of the styles rheo, rheo/thermal"),
        (_edited("3 atoms", "4 atoms"), "Atoms: must hold the 4 atoms that the header says, found 3"),
        (_edited("0 4 xlo", "0 x xlo"), "xlo xhi: must follow 2 numbers, found '0 x'"),
        (_edited("0 4 xlo", "4 0 xlo"), "box: needs low < high"),
        (_edited("3 2 1", "2 2 1"), "id: must differ from particle to particle"),
        (_edited("1 1 0 1.0", "1 1 0 one"), "column rho: must hold numbers"),
        (_edited("1 1 0 1.0", "\u1000 1 0 1.0"), "Atoms: must be ASCII except in comments"),
        (_edited("3 2 1", "3 2 0"), "phase: of type 2 must be that of the particles of the file, found 'fluid'"),
        (lambda text: text + "\nVelocities\n\n1 0 0 0\n", "Velocities: must hold those of the particles of Atoms"),
    ],
)
def test_malformed_data_file_is_refused(tmp_path: Path, edit: Callable[[str], str], said: str) -> None:
    (tmp_path / "a.data").write_text(edit(GOOD))
    with pytest.raises(InputError) as caught:
        _built(tmp_path, "{data: a.data}")
    assert said in str(caught.value) and "case.yaml" in str(caught.value)


def test_binary_dump_equals_text_dump_with_all_digits(written: tuple[Path, int, Any]) -> None:
    (text,), (binary,) = (list(lammps_files.snapshots(written[0] / name)) for name in ("a.dump", "a.bin"))
    assert (binary.step, binary.periodic, binary.exact) == (text.step, text.periodic, True)
    assert np.array_equal([*binary.tilt, *binary.low_c, *binary.high_c], [*text.tilt, *text.low_c, *text.high_c])
    assert [*binary.columns] == [*text.columns]
    assert all(np.array_equal(binary.numbers(name), text.numbers(name)) for name in text.columns)


@pytest.mark.parametrize(
    ("at", "form", "value", "rule"),
    [
        (18, "<i", 16777216, "byte order"),
        (22, "<i", 1, "revision"),
        (34, "<q", 3, "atoms: must be the 3"),
        (118, "<i", 4, "columns: must be the 4"),
        (-80, "<d", 1.5, "column id: must hold whole numbers"),
        (-80, "<d", float("nan"), "column id: must hold whole numbers"),
        (-80, "<d", 1e19, "column id: must hold whole numbers"),
    ],
)
def test_unsupported_binary_dumps_are_refused(at: int, form: str, value: float, rule: str, tmp_path: Path) -> None:
    content = bytearray(BINARY_DUMP)
    struct.pack_into(form, content, at % len(content), value)
    (tmp_path / "a.bin").write_bytes(content)
    with pytest.raises(InputError, match=rule):
        [shot.numbers("id", int) for shot in lammps_files.snapshots(tmp_path / "a.bin")]


def test_snapshot_of_a_dump_is_chosen_by_step(tmp_path: Path) -> None:
    (tmp_path / "a.dump").write_text(DUMP.format(step=0, rho=1.5) + DUMP.format(step=10, rho=1.25))
    last = _built(tmp_path, "{dump: a.dump, columns: {rho: c_rho}}", phase="fluid")
    first = _built(tmp_path, "{dump: a.dump, columns: {rho: c_rho}, step: 0}", phase="fluid")
    assert last.rho_n is not None and first.rho_n is not None
    assert (last.rho_n.tolist(), first.rho_n.tolist()) == ([1.25], [1.5])
    assert last.periodic == (True, False, True) and last.v_nc is None
    with pytest.raises(InputError, match=r"positions\.step: must be one of 0, 10, found 5"):
        _built(tmp_path, "{dump: a.dump, columns: {rho: c_rho}, step: 5}")
    with pytest.raises(InputError, match=r"column: must be one of id, type, x, y, z, c_rho.*found 'c_rh'"):
        _built(tmp_path, "{dump: a.dump, columns: {rho: c_rh}}")
    with pytest.raises(InputError, match="rho: must be given"):
        _built(tmp_path, "{dump: a.dump}", phase="fluid")


@pytest.mark.parametrize("cut", range(9))
def test_truncated_dump_is_refused(tmp_path: Path, cut: int) -> None:
    whole = DUMP.format(step=0, rho=1.5).splitlines(keepends=True)
    (tmp_path / "a.dump").write_text("".join(whole[: cut + 1]))
    with pytest.raises(InputError, match=r"dump: must end with a whole snapshot|dump: cannot be read|ATOMS: must hold"):
        _built(tmp_path, "{dump: a.dump}")


TWO = [DUMP.format(step=step, rho=1.5).encode() for step in (0, 10)]


@pytest.mark.parametrize("shots", [TWO, [BINARY_DUMP, BINARY_DUMP]], ids=["text", "binary"])
def test_truncated_dump_still_yields_its_whole_snapshots(shots: list[bytes], tmp_path: Path) -> None:
    whole, ends = b"".join(shots), [0, len(shots[0]), len(shots[0]) + len(shots[1])]
    for cut in range(len(whole) + 1):
        (tmp_path / "a.dump").write_bytes(whole[:cut])
        found, complaint = [], None
        try:
            found.extend(lammps_files.snapshots(tmp_path / "a.dump"))
        except InputError as error:
            complaint = error
        assert len(found) == sum(end <= cut for end in ends[1:])
        assert (complaint is None) == (cut in ends)
        assert isinstance(complaint, lammps_files.CutOff) or cut in ends or cut < 12  # too short to identify


def test_other_files_are_refused_as_dumps(tmp_path: Path) -> None:
    (tmp_path / "a.dump").write_bytes(b"\xff\x00binary")
    with pytest.raises(InputError, match="must be text, or a binary file"):
        list(lammps_files.snapshots(tmp_path / "a.dump"))
    (tmp_path / "a.dump").write_text("hello\n")
    with pytest.raises(InputError, match="must be one of text"):
        list(lammps_files.snapshots(tmp_path / "a.dump"))
