"""The kit for LAMMPS' test programs: form, numbers, epsilon, and results from LAMMPS and the programs."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from check_jsonschema import main as check_jsonschema
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from eos_ref import InputError
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.model.quantities import needed_to_step
from lammps_cases.bugs.upstream import files, programs
from lammps_cases.bugs.upstream.files import TESTS, kit_files, write_folder, yaml_text
from lammps_cases.bugs.upstream.force_tests import (
    COEFFICIENTS,
    OWN,
    STAGES,
    TEMPLATE,
    WRITE_DATA,
    Expected,
    error,
    expected,
    relative,
    shipped,
    template,
)
from lammps_cases.bugs.upstream.programs import Commands, failing, replay
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.engine.workers import Workers
from lammps_cases.setup import reference_side
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
ROOT = Path(__file__).parents[4]
ALL = {test.name.partition("_")[2]: test for test in shipped()}
# One that fails for its virials alone, one for its forces, one for its motion, one that passes, one for a column alone.
FEW = ("quintic_unit_2d", "linear_own_2d", "rheo", "rheo_fall", "property_heat")
PAIR = FEW[:2]
TREE = os.environ.get("EOS_REF_TREE", "")


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    return Predictor()


@pytest.fixture
def folder(tmp_path: Path, predictor: Predictor) -> Path:
    """The files of a few tests."""
    write_folder(tmp_path, kit_files(predictor, [ALL[name] for name in FEW]))
    return tmp_path


def columns(text: str) -> Any:
    """The numbers of a block of a YAML file."""
    return np.array([[float(word) for word in line.split()] for line in text.strip().splitlines()])


# --- form


def test_every_option_is_tested_in_2d_and_3d_with_and_without_unit_volumes() -> None:
    pair = [test for test in shipped() if test.case.name.startswith(("pair.", "walls."))]
    of = {tuple(test.name.partition("_")[2].rsplit("_", 2)) for test in pair}
    options = {option for option, _, _ in of}
    assert of == {(option, volume, d) for option in options for volume in ("own", "unit") for d in ("2d", "3d")}
    assert options >= {"stored", "reconstructed"}
    kernels = {test.scene.rheo.kernel for test in pair}
    laws = {law.style for test in pair for law in test.scene.pressure}
    assert kernels == {"quintic", "RK0", "RK1", "RK2"}
    assert laws == {"linear", "cubic", "tait/water", "tait/general", "ideal/gas", "background"}
    for test in pair:
        volume_n = test.atoms.mass_n / test.atoms.rho_n
        assert np.all(volume_n == 1) if "_unit_" in test.name else np.all(volume_n != 1)
        assert set(test.atoms.type_n) == {1, 2} and not np.any(test.atoms.mass_n == 1)


def test_every_fix_has_a_test_of_its_name() -> None:
    fixes = {line for test in shipped() for line in test.post_commands if line.startswith("fix test ")}
    styles = {line.split()[3] for line in fixes}
    assert styles == {"rheo", "rheo/pressure", "rheo/viscosity", "rheo/thermal", "ave/time"}
    for test in shipped():
        tested = [line for line in test.post_commands if line.startswith("fix test ")]
        assert len(tested) == (test.program == "test_fix_timestep"), test.name
        assert "timestep" not in " ".join(test.post_commands) or test.program == "test_pair_style"


@pytest.mark.parametrize("name", ["rheo", "rheo_3d", "property_heat"])
def test_yaml_of_a_fix_holds_the_numbers_of_the_reference(name: str, predictor: Predictor) -> None:
    """After eight steps in two runs, from a simulation made here; columns of the compute are reduced independently."""
    test = ALL[name]
    found = yaml.safe_load(yaml_text(test, expected(test, predictor)))
    fields = (*test.scene.compare, *needed_to_step(reference_side.model(test.scene, test.atoms, "")))
    sim = reference_side.simulation(test.scene, test.atoms, fields, evaluator=ArrayEvaluator)
    sim.setup()
    for _ in range(2):
        sim.begin_again(np.zeros(len(test.atoms), dtype=bool))
        sim.run(4, 0.25)
    d = test.scene.dimension
    for key, field in (("run_pos", "x"), ("run_vel", "v")):
        np.testing.assert_array_equal(columns(found[key])[:, 1 : d + 1], sim.output(field))
    if name == "property_heat":
        size, *values = columns(found["global_vector"])[0]
        of = [np.asarray(sim.output(field), float) for field in test.scene.compare[2:]]
        by_hand = [*(sum(v * v for v in f) for f in of), *map(min, of), *map(max, of)]
        assert size == len(values) == len(by_hand)
        np.testing.assert_allclose(values, by_hand, rtol=len(test.atoms) * EPS)  # sums of squares


def test_particle_leaving_the_box_is_refused() -> None:
    """LAMMPS may wrap it when it builds its lists. All move to the right by at least 0.06."""
    test = ALL["rheo_fall"]
    atoms = replace(test.atoms, high_c=test.atoms.x_nc.max(axis=0) + np.array([0.05, 1.0, 1.0]))
    with pytest.raises(InputError, match="keep its particles in the box"):
        expected(replace(test, atoms=atoms), Predictor())


@pytest.mark.parametrize("name", PAIR)
def test_yaml_holds_the_numbers_of_the_reference(folder: Path, name: str) -> None:
    """To the last bit: those of a simulation made here."""
    test = ALL[name]
    found = yaml.safe_load((folder / f"{test.name}.yaml").read_text())
    sim = reference_side.simulation(test.scene, test.atoms, ("f", "virial"), evaluator=ArrayEvaluator)
    sim.setup()
    d, volume = test.scene.dimension, np.prod(sim.box.edge_c)
    for key in ("init_forces", "run_forces"):
        rows = columns(found[key])
        assert rows[:, 0].tolist() == test.atoms.id_n.tolist() == list(range(1, found["natoms"] + 1))
        np.testing.assert_array_equal(rows[:, 1 : d + 1], sim.output("f"))
        assert not rows[:, d + 1 :].any()
    w = volume * sim.output("virial")[0]
    np.testing.assert_array_equal(columns(found["init_stress"])[0], [w[0, 0], w[1, 1], 0, w[0, 1], 0, 0])
    assert [found[f"{when}_{of}"] for when in ("init", "run") for of in ("vdwl", "coul")] == [0, 0, 0, 0]


def test_template_has_every_variable_set_by_tests() -> None:
    given = set(re.findall(r"^variable +(\S+) ", template(), re.M))
    used = set(re.findall(r"\$\{(\w+)\}", template()))
    set_by_tests = {line.split()[1] for test in shipped() for line in test.pre_commands}
    assert set_by_tests - {WRITE_DATA} <= given and used <= given  # the one left out is the program's own
    assert set_by_tests >= {"data_file", "dimension", "atom_style"}


def test_particles_of_tests_named_phases_melt_and_freeze() -> None:
    """The listed ones do, and walls of other tests stay solid."""
    seen = {}
    for name in ("property_phases", "thermal_phases", "thermal_phases_3d", "rheo_reconstructed"):
        test = ALL[name]
        fields = ("phase", *needed_to_step(reference_side.model(test.scene, test.atoms, "")))
        sim = reference_side.simulation(test.scene, test.atoms, fields, evaluator=ArrayEvaluator)
        sim.setup()
        phases = [np.asarray(sim.output("phase"))]
        for _ in range(8):
            sim.run(1, 0.25)
            phases.append(np.asarray(sim.output("phase")))
        seen[name] = set(np.diff(phases, axis=0).ravel().tolist())
    assert seen.pop("rheo_reconstructed") == {0}
    assert all(changes == {-1, 0, 1} for changes in seen.values())


@pytest.mark.lammps
def test_walls_are_read_back_as_written(tmp_path: Path, workers: Workers) -> None:
    test = ALL["reconstructed_unit_2d"]
    (tmp_path / TEMPLATE).write_text(template())
    (tmp_path / test.data_name).write_text(test.data)
    given = Commands.of(test)
    plain = replace(given, before=tuple(line for line in given.before if WRITE_DATA not in line))
    assert len(plain.before) == len(given.before) - 1
    looks, refused = (workers.outcome(workers.call(replay, of, str(tmp_path), time_limit=60)) for of in (given, plain))
    assert set(looks) == {stage.name for stage in STAGES[test.program]}
    assert "rheo_interface_fix_property_atom" in refused.message
    others = {name for name, of in ALL.items() if WRITE_DATA in " ".join(of.pre_commands)}
    assert others == {name for name in ALL if name.startswith("reconstructed_")}


# --- epsilon


@given(st.floats(1e-3, 1e3), st.floats(0, 1e-4), st.floats(-1, 1), st.sampled_from([-1, 1]))
def test_value_within_its_bound_is_within_the_relative_error(b: float, bound: float, at: float, s: int) -> None:
    most = relative(np.array([s * b]), np.array([bound]))
    # What is obtained is rounded to half EPS of b, and b is at most 1.2 times what the difference is divided by.
    assert error(np.array([s * b + at * bound]), np.array([s * b])) <= most * (1 + 4 * EPS) + 2 * EPS
    np.testing.assert_allclose(error(np.array([s * (b - bound)]), np.array([s * b])), most, rtol=4 * EPS, atol=2 * EPS)


def test_expected_zero_is_compared_absolutely() -> None:
    assert relative(np.array([0.0]), np.array([1e-9])) == 1e-9
    assert error(np.array([1e-9]), np.array([0.0])) == 1e-9
    assert np.isinf(error(np.array([np.nan]), np.array([1.0])))


@pytest.mark.parametrize("name", FEW)
def test_epsilon_is_the_largest_relative_bound(name: str, predictor: Predictor) -> None:
    """It is attained, up to the rounding to two digits, by the number that the comment names."""
    numbers = expected(ALL[name], predictor)
    component, key, value, bound, factor = re.match(
        r"component (\d+) of (\w+)(?: of atom \d+)? \(.*\) is (\S+) within ([\d.e-]+)(?:, compared with (\d) epsilon)?",
        numbers.why,
    ).groups()
    # Of four digits, the last is half a thousandth at most.
    assert np.any(np.isclose(numbers.values[key][..., int(component) - 1], float(value), rtol=0.5e-3, atol=0))
    ratio = float(bound) / abs(float(value)) / float(factor or 1)
    assert ratio * 0.9 < numbers.epsilon < ratio * 1.2
    assert f"epsilon: {numbers.epsilon:g}\n" in yaml_text(ALL[name], numbers)


def test_component_of_pure_rounding_is_refused() -> None:
    """A fluid at rest on a lattice: the forces on its particles are pure rounding."""
    test = ALL["quintic_unit_2d"]
    x_nc = 0.9 * np.array([(i + 0.4, k + 0.3, 0.0) for i in range(6) for k in range(5)])
    one_n = np.ones(len(x_nc), dtype=int)
    atoms = replace(test.atoms, x_nc=x_nc, v_nc=None, type_n=one_n, mass_n=1.31 * one_n, rho_n=1.31 * one_n)
    with pytest.raises(InputError, match="rounding alone could make 0"):
        expected(replace(test, atoms=atoms), Predictor())


# --- LAMMPS, by its Python module


@pytest.mark.lammps
@pytest.mark.slow
def test_lammps_fails_as_the_test_programs_did(folder: Path, workers: Workers, predictor: Predictor) -> None:
    """The commands of the YAML files, stage by stage; the findings are determined again."""
    engine = workers.outcome(workers.identify())["distribution"]
    chosen = [ALL[name] for name in (*FEW, "reconstructed_unit_2d")]
    write_folder(folder, kit_files(predictor, chosen[-1:]))
    found = programs.replayed(chosen, folder, workers, engine)
    assert found == {test.name: programs.measured().tests[test.name] for test in chosen}


@pytest.mark.lammps
def test_error_above_epsilon_is_detected(folder: Path, workers: Workers, predictor: Predictor) -> None:
    test = ALL["quintic_unit_2d"]
    seen = workers.outcome(workers.call(replay, Commands.of(test), str(folder), time_limit=60))
    numbers = expected(test, predictor)
    right = {stage.checks[field] for stage, field in failing(test, numbers, seen)}

    def with_error(times: float) -> set[str]:
        values = {**numbers.values, "init_forces": numbers.values["init_forces"].copy()}
        values["init_forces"][7, 1] *= 1 + times * numbers.epsilon
        wrong = Expected(values, numbers.epsilon, "")
        return {stage.checks[field] for stage, field in failing(test, wrong, seen)} - right

    assert with_error(0.9) == set()
    all_of_it = {s.checks["f"] for s in STAGES[test.program] if s.keys["f"] == "init_forces"}
    assert (
        with_error(1.1)
        == all_of_it
        == {*("init_forces (newton on)", "init_forces (newton off)", "restart_forces", "nofdotr_forces", "data_forces")}
    )


# --- what was measured, and the command


def test_no_file_can_have_a_name_of_lammps() -> None:
    """Of the names in names.txt: those of our kinds in the tests of 4 Jul 2026, and those added in October 2026."""
    theirs = (Path(__file__).parent / "names.txt").read_text().split()
    ours = {TEMPLATE, COEFFICIENTS, *(of for test in shipped() for of in (test.data_name, f"{test.name}.yaml"))}
    assert {"in.rheo", "data.rheo", "atomic-pair-rheo_solid.yaml", "fix-timestep-nve.yaml"} < {*theirs}
    assert not any(OWN in name for name in theirs) and all(OWN in name for name in ours)


def test_page_shows_the_measurement_of_every_test() -> None:
    result = programs.measured()
    assert set(result.tests) == {test.name for test in shipped()}
    assert all(by for failed in result.tests.values() for by in failed.values()), "a failure without a finding"
    page = (ROOT / programs.PAGE).read_text()
    assert programs.updated(page, result) == page
    assert programs.MEASURED.read_text() == programs.text(result)


@pytest.mark.lammps
def test_kit_follows_the_layout_of_the_lammps_tree(
    tmp_path: Path, eos_ref_command: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = [ALL[name] for name in FEW]
    monkeypatch.setattr(files, "shipped", lambda: few)  # all of them are written for the page
    done = eos_ref_command("kit", "unittest", "--repository", "me/eos-ref", "--out", tmp_path)
    assert done.code == 0, done.err
    names = {path.name for path in (tmp_path / TESTS).iterdir()}
    shared = {TEMPLATE, COEFFICIENTS, *(test.data_name for test in few)}
    assert names == {f"{test.name}.yaml" for test in few} | shared
    assert all(OWN in str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())
    assert "me/eos-ref" in (tmp_path / "unittest" / "force-styles" / "README.eosref.md").read_text()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    again = eos_ref_command("kit", "unittest", "--repository", "me/eos-ref", "--out", tmp_path)
    assert again.code == 0, again.err
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_kit_is_not_printed(eos_ref_command: Run) -> None:
    done = eos_ref_command("kit", "unittest")
    assert done.code == 2 and "--out: is needed" in done.err and not done.out


# --- LAMMPS' own programs (make unittest)


@pytest.mark.unittest
@pytest.mark.lammps
def test_programs_reproduce_the_measurement() -> None:
    assert TREE, "make unittest LAMMPS=TREE names a source tree with a serial build of LAMMPS in its folder build"
    assert programs.measure(Path(TREE).resolve()) == programs.measured()


@pytest.mark.unittest
def test_files_satisfy_the_schema_of_the_tree(tmp_path: Path) -> None:
    """Of LAMMPS' own tree: tools/json/force-style-test-schema.json."""
    write_folder(tmp_path, kit_files())
    schema = Path(TREE) / "tools" / "json" / "force-style-test-schema.json"
    done = CliRunner().invoke(check_jsonschema, ["--schemafile", str(schema), *map(str, tmp_path.glob("*.yaml"))])
    assert done.exit_code == 0, done.output
