"""Models of a scene: values that they accept, properties derived from their keys, and what their numbers are.

What they refuse is listed in ``tests/support/bad_scenes.yaml``; see `test_complaints`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

import lammps_cases
from eos_ref import EOS, InputError, resolve
from eos_ref.model.quantities import named
from eos_ref.syntax.fixes import PressureEntry
from lammps_cases.scene import Scene, casefile, check_name, models, particles, runs, settings, values
from lammps_cases.scene.manual import EXAMPLES, ExampleSettings
from lammps_cases.setup.twins import Scale, rescaled
from tests.conftest import BASE

MODEL = {"compare": ["f"]}
POWER = {"eta": 0.1, "gd0": 0.2, "K": 0.3, "n": 0.7}


def scene(**changes: Any) -> Scene:
    return Scene.model_validate(BASE | changes)


# --- values and models


@pytest.mark.parametrize(
    ("kind", "value", "taken"),
    [
        (values.Finite, -3, -3.0),
        (values.Positive, 5e-324, 5e-324),
        (values.NonNegative, 0, 0.0),
        (values.Vector, [1, 2.5], (1.0, 2.5)),
        *((values.TypeRange, text, text) for text in ("*", "2", "*2", "2*", "1*3")),
        (values.TypeRange, 2, "2"),
        (values.LocalFile, "data/a.xyz", "data/a.xyz"),
    ],
)
def test_valid_values_are_accepted(kind: Any, value: Any, taken: Any) -> None:
    assert TypeAdapter(kind).validate_python(value) == taken


def test_models_are_immutable_forbid_extra_keys_and_are_all_listed() -> None:
    class Part(values.SceneModel):
        a: int = 1

    class Below(Part):
        b: int = 2

    with pytest.raises(ValidationError, match="frozen"):
        Part().a = 2
    with pytest.raises(ValidationError, match="Extra inputs"):
        Below.model_validate({"c": 3})
    assert [*models(Part)] == [Below] and {Scene, Part, Below} <= {*models()}


@pytest.mark.parametrize("name", ["", "A", "a.b", "a--b", "-a", "a b", "a" * 61])
def test_names_are_words_joined_by_hyphens(name: str) -> None:
    check_name("near-rho0+2d")
    with pytest.raises(InputError, match="name: "):
        check_name(name)


@pytest.mark.parametrize(
    ("content", "kind"),
    [
        (BASE["positions"], particles.Lattice),
        ({"x": [[0.0, 0.0], [0.5, 0.5]], "low": [0.0, 0.0], "high": [1.0, 1.0]}, particles.Listed),
        ({"extxyz": "a.xyz"}, particles.FromXYZ),
        ({"data": "a.data"}, particles.FromData),
        ({"dump": "a.dump", "step": 5}, particles.FromDump),
    ],
)
def test_one_key_determines_the_kind_of_positions(content: dict[str, Any], kind: type) -> None:
    adapter = TypeAdapter(particles.Positions)
    positions = adapter.validate_python(content)
    assert type(positions) is kind and adapter.validate_python(positions) == positions
    with pytest.raises(ValidationError) as refused:
        adapter.validate_python(content | {"odd": 1})
    assert [each["type"] for each in refused.value.errors()] == ["extra_forbidden"], "a mistake of one kind alone"


def test_only_periodic_axes_may_be_tilted() -> None:
    particles.check_tilt(None, (False, False), 2)
    particles.check_tilt((0.0, 0.2, 0.0), (True, False, True), 3)
    particles.check_tilt((0.1, 0.0, 0.0), None, 3)  # periodic by default
    with pytest.raises(ValueError, match="tilt must be 0"):
        particles.check_tilt((0.0, 0.0, 0.2), (True, False, True), 3)


def test_unusual_settings_are_accepted() -> None:
    assert particles.Values(range=(-1.0, -2.0), spacing="log").range == (-1.0, -2.0)
    assert settings.SurfaceDetectionSettings(style="divergence", limit=0.5, splash=4).limit == 0.5
    assert settings.ForceSettings(style="setforce", vector=(None, 1.0)).vector == (None, 1.0)
    assert settings.RheoSettings(rho_sum=True, self_mass=True).self_mass
    assert runs.EngineSettings(processors=(2, 1, 1), ranks=2) and runs.EngineSettings(balance=5, communication="tiled")


# --- types and laws


@pytest.mark.parametrize(
    ("law", "value", "needs_energy"),
    [
        ({"style": "linear"}, None, False),
        ({"style": "cubic", "A3": 2.5}, 2.5, False),
        ({"style": "tait/water"}, None, False),
        ({"style": "tait/general", "gamma": 3.0}, 3.0, False),
        ({"style": "ideal/gas", "gamma": 1.4}, 1.4, True),
        ({"style": "background", "P_b": -0.5}, -0.5, False),
    ],
)
def test_entry_has_the_argument_of_its_style(law: dict[str, Any], value: float | None, needs_energy: bool) -> None:
    of_law = particles.LawSettings(types="1*2", **law)
    assert (of_law.value, of_law.needs_energy) == (value, needs_energy)
    assert of_law.entry == PressureEntry("1*2", law["style"], value)


@pytest.mark.parametrize(
    "law",
    [
        EOS("linear", 1.0, 1.0),
        EOS("cubic", 1.0, 1.0, 2.5),
        EOS("tait/general", 1.0, 1.0, 3.0, background=0.5),
        EOS("ideal/gas", parameter=1.4, background=-0.5),
    ],
)
def test_entries_of_a_law_resolve_to_it_for_all_types(law: EOS) -> None:
    of_law = [particles.LawSettings(**entry) for entry in particles.entries(law)]
    assert len(of_law) == 1 + bool(law.background)
    assert list(resolve([each.entry for each in of_law], 2)) == [law, law]


def test_type_without_a_law_is_refused_with_its_location() -> None:
    types = [{"mass": 1.0}] * 2
    with pytest.raises(InputError, match=r"\(here\)"):
        scene(types=types, pressure=[{"types": "1", "style": "linear"}]).eos("here")
    assert len(scene(types=types, pressure=[{"types": "*", "style": "linear"}]).eos().laws) == 2


def test_viscosity_is_a_number_or_a_power_law() -> None:
    assert particles.AtomType(mass=1.0).viscosity == 0.1, "the manual's default of this harness"
    assert particles.AtomType(mass=1.0, viscosity=0.0).viscosity == 0.0
    assert particles.AtomType.model_validate({"mass": 1.0, "viscosity": POWER}).viscosity == particles.PowerLaw(**POWER)


def test_thermal_keys_make_a_type_thermal() -> None:
    assert not particles.AtomType(mass=1.0, rho0=2.0, cs=3.0, phase="solid").thermal
    given = [{"conductivity": 0.1}, {"specific_heat": 1.0}, {"T_freeze": 0.0}, {"latent_heat": 0.5, "T_freeze": 0.1}]
    assert all(particles.AtomType.model_validate({"mass": 1.0, **each}).thermal for each in given)


def test_only_defaults_in_use_are_listed() -> None:
    bare = {"types": [{"mass": 1.0}]}
    gas = {"pressure": [{"types": "*", "style": "ideal/gas", "gamma": 1.4}], "energy": {"constant": 1.0}}
    assert scene().defaults == ()
    assert scene(**bare).defaults == ("rho0 = 1", "cs = 1")
    assert scene(**bare, **gas).defaults == ("rho0 = 1",), "an ideal gas takes no speed of sound"
    assert scene(**bare, **MODEL).defaults == ("rho0 = 1", "cs = 1", "viscosity = 0.1")
    assert scene(**gas).thermal and not scene().thermal


# --- settings


def test_shift_is_on_off_or_has_arguments() -> None:
    assert settings.RheoSettings().shifting is None and settings.RheoSettings(shift=False).shifting is None
    assert settings.RheoSettings(shift=True).shifting == settings.ShiftSettings(exclude=(), scale_cross_type=None)
    assert settings.ShiftSettings.model_validate({"exclude": 2}).exclude == ("2",)
    assert settings.ShiftSettings.model_validate({"exclude": ["1*2", 3]}).exclude == ("1*2", "3")


def test_newton_of_bonds_defaults_to_that_of_pairs() -> None:
    flags = [
        runs.EngineSettings(newton=pair, newton_bond=bond).newton_flags
        for pair in (True, False)
        for bond in (None, True)
    ]
    assert flags == [(True, True), (True, True), (False, False), (False, True)]


@pytest.mark.parametrize(("key", "value"), [("rescale", 0.25), ("newton", False), ("tilt", [1, 0, 0]), ("ranks", 2)])
def test_kind_of_a_twin_is_its_key(key: str, value: Any) -> None:
    assert runs.TwinSettings.model_validate({key: value}).kind == key


def test_line_of_the_manual_is_found_by_its_location() -> None:
    for number in (1, 2, 3):
        of_rheo, of_pressure = ExampleSettings(rheo=number), ExampleSettings(pressure=number)
        assert (of_rheo.line("rheo"), of_rheo.line("pressure")) == (EXAMPLES["rheo"][number - 1], None)
        assert (of_pressure.line("rheo"), of_pressure.line("pressure")) == (None, EXAMPLES["pressure"][number - 1])


# --- steps and stops


def evolved(**keys: Any) -> settings.Evolve:
    return settings.Evolve.model_validate({"timestep": 0.1} | keys)


@pytest.mark.parametrize(
    ("keys", "snapshots"),
    [
        ({"steps": 1}, (0, 1)),
        ({"steps": 9}, (0, 1, 9)),
        ({"steps": 100}, (0, 1, 10, 100)),
        ({"steps": 250}, (0, 1, 10, 100, 250)),
        ({"steps": 250, "compare_at": [250]}, (250,)),
        ({"steps": 8, "stops": [{"at": 3}, {"at": 5}]}, (0, 1, 3, 5, 8)),
        ({"steps": 6, "stops": [{"at": 3}, {"at": 5}], "compare_at": [5, 6]}, (5, 6)),
        ({"steps": 7, "every": 2, "stops": [{"at": 3}]}, (7,)),
    ],
)
def test_steps_that_are_compared(keys: dict[str, Any], snapshots: tuple[int, ...]) -> None:
    assert evolved(**keys).snapshots == snapshots


def test_each_piece_of_a_run_begins_with_a_set_up() -> None:
    """LAMMPS counts pieces from the beginning of a run: after the stop at 5, from there."""
    pieces = evolved(steps=9, every=2, stops=[{"at": 5, "by": "set"}])
    assert [(stop.at, stop.by) for stop in pieces.beginnings] == [(2, "run"), (4, "run"), (5, "set"), (7, "run")]
    whole = pieces.model_copy(update={"every": None})
    assert whole.beginnings == whole.stops and whole.halts == (5,)


def test_law_is_compared_at_the_end_and_model_at_requested_steps() -> None:
    evolve = {"steps": 4, "timestep": 0.01}
    law, model = scene(evolve=evolve), scene(**MODEL, evolve=evolve | {"compare_at": [0, 4]})
    assert (scene().snapshots, law.snapshots, model.snapshots) == ((0,), (4,), (0, 4))
    assert [one.whole_model for one in (scene(), law, model)] == [False, False, True]
    assert [one.interacts for one in (scene(), law, model)] == [False, True, True]


def test_box_shrinks_separately_before_and_after_a_stop() -> None:
    """The longer of the two runs has 3 steps: 1 - 2.5 x 0.1 x 3 = 1/4 of an edge remains."""
    assert evolved(steps=4, stops=[{"at": 1}], deform={"y": -2.5}).deform is not None


def test_deformation_rates_by_axis() -> None:
    deform = settings.DeformSettings(x=1.0, y=2.0, z=3.0, xy=4.0, xz=5.0, yz=6.0)
    assert (deform.rates, deform.shears, deform.remap) == ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0), "x")


def test_shipped_cases_cover_every_route() -> None:
    assert {*runs.AS_TEXT, *runs.REDEFINED, *runs.FOR_EACH_ATOM} <= set(runs.ROUTES)
    cases = [case.scene.evolve for case in casefile.load()]
    assert {stop.by for evolve in cases if evolve for stop in evolve.stops} == set(runs.ROUTES)


def test_step_count_continues_from_the_value_set_at_a_stop() -> None:
    stops = (runs.Stop(at=2, count=100), runs.Stop(at=4), runs.Stop(at=5, count=7))
    assert runs.counted((0, 1, 2, 3, 4, 5, 6), stops) == (0, 1, 100, 101, 102, 7, 8)


@pytest.mark.parametrize(("by", "renewed"), [("run", 0), ("restart", 0), ("recreated", 2), ("redefined", 9)])
def test_number_of_recreated_atoms_by_route(by: str, renewed: int) -> None:
    assert runs.Stop.model_validate({"at": 0, "by": by}).count_recreated_atoms(9) == renewed


def test_stretches_accumulate_in_upper_corners() -> None:
    stops = [
        runs.Stop(at=1, stretch=runs.Stretch(x=2.0)),
        runs.Stop(at=3),
        runs.Stop(at=4, stretch=runs.Stretch(x=0.5, z=1.5)),
    ]
    assert runs.upper_corners(stops, (-1.0, -1.0, 0.1), (2.0, 0.7, 2.1)) == {1: [5.0, 0.7, 2.1], 4: [2.0, 0.7, 3.1]}
    assert runs.upper_corners([runs.Stop(at=1, stretch=runs.Stretch())], (0.1,) * 3, (0.3,) * 3) == {1: [0.3] * 3}


# --- what numbers are


def test_number_without_a_quantity_is_no_model() -> None:
    with pytest.raises(AssertionError, match=r"Part.a holds numbers: its type needs a Dim"):

        class Part(values.SceneModel):
            a: tuple[values.Positive | None, ...] = ()

    with pytest.raises(KeyError, match="densty"):
        values.Dim("densty")


def test_every_number_is_listed_with_its_quantity() -> None:
    types = [{"mass": 1.0, "viscosity": POWER}]
    law = [{"types": 1, "style": "cubic", "A3": 2.0}]
    forces = [{"style": "gravity", "vector": [0.5, 1.5]}, {"style": "setforce", "vector": [None, 2.5]}]
    found = {
        ".".join(map(str, path)): (value, dict(powers))
        for path, value, powers in values.numbers(
            scene(types=types, pressure=law, forces=forces, rho={"per_type": [0.5]})
        )
    }
    assert found["types.0.rho0"] == (1.0, {"rho": 1}), "a number that is left out"
    assert found["types.0.viscosity.K"] == (0.3, {"viscosity": 1, "grad/v": 1 - 0.7})
    assert found["pressure.0.A3"] == (2.0, {"A3": 1})
    assert found["rho.per_type.0"] == (0.5, {"rho": 1}), "that of the field"
    assert found["forces.0.vector.1"] == (1.5, {"acceleration": 1})
    assert found["forces.1.vector.1"] == (2.5, {"f": 1}) and "forces.1.vector.0" not in found
    assert found["positions.disorder"] == (0.2, {"number": 1})


def test_change_keeps_the_other_keys() -> None:
    for case in casefile.load()[::20]:
        same = values.changed(case.scene, lambda _, value, __: value)
        assert same == case.scene and same.model_fields_set == case.scene.model_fields_set
        twice = values.changed(case.scene, lambda _, value, powers: value * 2.0 ** sum(power for _, power in powers))
        given = [(path, value) for path, value, _ in values.numbers(case.scene)]
        assert [path for path, _, _ in values.numbers(twice)] == [path for path, _ in given]
        assert twice.thermal == case.scene.thermal
        for _, value, powers in values.numbers(case.scene):
            assert isinstance(value, float) and all(named(quantity) for quantity, _ in powers)


EVERYTHING: dict[str, Any] = {
    "types": [{"mass": 1.5, "viscosity": POWER | {"n": 0.5}, "latent_heat": 0.5, "T_freeze": 0.25}],
    "pressure": [{"types": 1, "style": "cubic", "A3": 2.0}, {"types": 1, "style": "background", "P_b": 0.5}],
    "mass": {"constant": 1.25},
    "rho": {"range": [0.75, 1.5]},
    "energy": {"constant": 2.5},
    "velocity": {"random": 0.5},
    "rheo": {"cut": 2.0, "shift": {"scale_cross_type": [0.5, 0.25, 0.125]}},
    "pair": {"artificial_visc": 1.5, "rho_damp": 0.75},
    "forces": [{"style": "gravity", "vector": [0.5, 1.5]}, {"style": "addforce", "vector": [0.5, 2.5]}],
    "evolve": {"steps": 9, "timestep": 0.01, "deform": {"x": 0.5}, "stops": [{"at": 2, "displace": {"y": 0.5}}]},
    "compare": ["f"],
}
# Powers of length, mass and time in a plane, where a density is a mass per area.
POWERS = {
    "types.0.mass": (0, 1, 0),
    "types.0.rho0": (-2, 1, 0),
    "types.0.cs": (1, 0, -1),
    "types.0.viscosity.eta": (0, 1, -1),
    "types.0.viscosity.gd0": (0, 0, -1),
    "types.0.viscosity.K": (0, 1, -1.5),  # K rate^(n - 1) is a viscosity
    "types.0.conductivity": (2, 1, -3),
    "types.0.specific_heat": (2, 0, -2),
    "types.0.latent_heat": (2, 0, -2),
    "positions.spacing": (1, 0, 0),
    "pressure.0.A3": (4, -2, 0),
    "pressure.1.P_b": (0, 1, -2),
    "mass.constant": (0, 1, 0),
    "rho.range.0": (-2, 1, 0),
    "rho.range.1": (-2, 1, 0),
    "energy.constant": (2, 0, -2),
    "velocity.random": (1, 0, -1),
    "rheo.cut": (1, 0, 0),
    "rheo.shift.scale_cross_type.2": (-2, 0, 0),  # a sum of kernel values
    "pair.rho_damp": (2, 0, -1),
    "forces.0.vector.0": (1, 0, -2),
    "forces.0.vector.1": (1, 0, -2),
    "forces.1.vector.0": (1, 1, -2),
    "forces.1.vector.1": (1, 1, -2),
    "evolve.timestep": (0, 0, 1),
    "evolve.deform.x": (0, 0, -1),
    "evolve.stops.0.displace.y": (1, 0, 0),
}


def test_numbers_of_another_size_follow_their_dimensions() -> None:
    given = scene(**EVERYTHING)
    scale = Scale(2, length=2.0, mass=2.0**10, time=2.0**20)
    before, after = (
        {path: value for path, value, _ in values.numbers(of)} for of in (given, rescaled(given, scale, 2.0))
    )
    found = {".".join(map(str, path)): after[path] / value for path, value in before.items() if after[path] != value}
    assert found == {key: 2.0 ** (length + 10 * mass + 20 * time) for key, (length, mass, time) in POWERS.items()}


USE = """
import sys
from lammps_cases.run.schemas import scene_schema
from lammps_cases.scene import casefile
from lammps_cases.scene.values import numbers
from lammps_cases.setup.twins import Scale, rescaled

(case,) = casefile.load_file("good.yaml")
assert (("pair", "slip_length"), 0.5, (("x", 1.0),)) in numbers(case.scene)
assert rescaled(case.scene, Scale.of_size(4.0, 2), 1.5).pair.slip_length == 2.0
print(scene_schema()["$defs"]["PairSettings"]["properties"]["slip_length"]["description"])
for name in ("bad", "odd"):
    try:
        casefile.load_file(f"{name}.yaml")
    except ValueError as error:
        print(error)
"""
SAID = """\
of walls; unit of positions
pair.slip_length: must be at least 0, found -0.5 (bad.yaml, line 4, column 24)
pair.slip_lenght: unknown key (did you mean 'slip_length'?) (odd.yaml, line 4, column 11)
"""
FILE = """name: a
about: a new key
scene:
  pair: { slip_length: 0.5 }
  dimension: 2
  types: [{mass: 1.0}]
  positions: {lattice: sq, spacing: 0.8, cells: [5, 4]}
  pressure: [{types: "*", style: linear}]
  rho: {constant: 1.0}
"""


@pytest.mark.slow
def test_new_key_needs_one_line(tmp_path: Path) -> None:
    """A key of a copy of the package: in schema, complaints and twins, and among the numbers."""
    root = Path(lammps_cases.__file__).parents[1]
    shutil.copytree(root / "lammps_cases", tmp_path / "lammps_cases", ignore=shutil.ignore_patterns("__pycache__"))
    file = tmp_path / "lammps_cases" / "scene" / "settings.py"
    before = "    harmonic_means: bool = False\n"
    line = '    slip_length: Annotated[NonNegative, Dim("x")] = Field(0.0, description="of walls")\n'
    assert before in file.read_text()
    file.write_text(file.read_text().replace(before, before + line))
    for name, old, new in (("good", "", ""), ("bad", "0.5", "-0.5"), ("odd", "length", "lenght")):
        (tmp_path / f"{name}.yaml").write_text(FILE.replace(old, new))
    environment = os.environ | {"PYTHONPATH": f"{tmp_path}:{root}"}
    ran = subprocess.run([sys.executable, "-c", USE], env=environment, cwd=tmp_path, capture_output=True, text=True)
    assert (ran.stdout, ran.stderr) == (SAID, "")


# --- case files


def test_tag_skips_files_but_no_tagged_case() -> None:
    every = casefile.load()
    for tag in ("eos", "quick", "twin"):
        assert casefile.select(casefile.load(tag=tag), tag=tag) == casefile.select(every, tag=tag) != []
    assert len({case.source for case in casefile.load(tag="eos")}) < len({case.source for case in every}) / 2
    assert casefile.load(tag="particle") == casefile.load(tag="no such word") == every, "a word, but no tag"


def test_cases_tagged_more_or_long_run_only_if_chosen() -> None:
    every = casefile.load()
    default, more = casefile.select(every), casefile.select(every, tag="more")
    assert {case.name for case in more} == casefile.more()
    assert casefile.select(every, tag="all") == sorted([*default, *more], key=lambda case: case.name)
    assert casefile.select(every, [more[0].name]) == more[:1]
    assert casefile.load(tag="more") == casefile.load(tag="all") == every


def test_shipped_cases_are_cached_and_each_caller_gets_its_own_list() -> None:
    mine = casefile.load()
    mine.clear()
    assert casefile.load() and casefile.load()[0] is casefile.load()[0]
