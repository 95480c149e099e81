"""The rules that a scene can exercise: counted by hand in scenes of a few particles; each can be broken."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from eos_ref.syntax.fixes import FixRheo, Shift, SurfaceDetection
from lammps_cases.scene import casefile
from lammps_cases.scene.fields import FIELDS
from lammps_cases.scene.rules import RULES, SUBJECTS, Evaluated, fields
from tests.workshop.faults import formula

# Two fluid particles of type 1 and one of type 2 in a row, a solid of type 2 above the first; nothing near any face.
X = [[3.0, 3.0], [4.0, 3.0], [5.0, 3.0], [3.0, 4.0]]
TYPES, SOLID = [1, 1, 2, 2], [False, False, False, True]
V = [[0.3, 0.0], [0.0, 0.0], [0.1, 0.2], [0.0, 0.0]]
LAWS = EOSTable((EOS("linear", 1.2, 3.0, None, 0.4), EOS("cubic", 0.9, 5.0, -0.7)))


def evaluated(compared: tuple[str, ...] = ("f", "drho"), x: Any = X, v: Any = V, **changes: Any) -> Evaluated:
    """The first evaluation of four particles."""
    fix = FixRheo(1.8, "quintic", 0, rho0=(1.2, 0.9), cs=(3.0, 5.0), **changes.pop("fix", {}))
    constants = {"pair": PairRheo(1.8, 0.4, 0.1), "viscosity": (Viscosity("constant", 0.3),) * 2}
    model = Model(**{"dimension": 2, "fix": fix, "mass_t": (1.3, 0.7), "eos": LAWS, **constants, **changes})
    state = State(np.array(x), np.array(v), np.array([1.1, 1.3, 0.8, 0.9]), np.array(TYPES), np.array(SOLID))
    sim = Simulation(model, Box((0.0, 0.0), (9.0, 9.0), (True, True)), state, compared)
    sim.setup()
    return Evaluated(sim, state, compared, 0, sim.box)


def counts(at: Evaluated) -> dict[str, int]:
    return {name: count for name, rule in RULES.items() if (count := rule.count(at))}


def test_particles_and_pairs_are_counted_by_class() -> None:
    """Particles 1-2 and 2-3 are 1 apart, 1-4 too, 2-4 root of 2; 1-3 and 3-4 are too far apart to meet."""
    counted = counts(evaluated())
    artificial = {name: counted.pop(name) for name in list(counted) if name.startswith("artificial")}
    assert counted == {
        **{"law-linear": 2, "law-cubic-negative": 2, "background": 2, "below-rho0": 2, "above-rho0": 1},
        **{"rho0": 4, "sound-speed": 4, "laws-by-type": 4, "volumes": 3, "kernel-quintic": 4},
        **{"gradient-of-velocity": 3, "force-same-fluid": 1, "force-other-fluid": 1, "force-stored-wall": 2},
        **{"viscosity": 3, "density-diffusion": 2, "density-diffusion-types": 1, "density-diffusion-not": 2},
        **{"field/f": 4, "field/drho": 3, "values-shared": 2},
    }
    pairs = artificial["artificial-viscosity"] + artificial["artificial-viscosity-not"]
    assert 2 <= pairs <= 4, "those at rest relative to each other neither approach nor part"


def test_a_field_that_is_0_everywhere_is_not_witnessed() -> None:
    at = evaluated(("shift/v", "pressure", "phase"), fix={"shift": Shift()})
    assert {name for name in counts(at) if name.startswith("field/")} == {
        "field/shift/v",
        "field/pressure",
        "field/phase",
    }
    at.sim.fields["shift/v"] = np.zeros((4, 2))
    at.sim.state.solid_n = np.ones(4, bool)
    assert {name for name in counts(at) if name.startswith("field/")} == {"field/pressure"}


def test_surfaces_are_counted_by_style_and_class() -> None:
    """With a limit of 2 the third particle, with one neighbour, is at the surface; with limit/splash 2 it is splash."""
    of = {}
    for splash in (0, 2):
        detection = SurfaceDetection("coordination", 2, splash)
        of[splash] = counts(evaluated(("surface", "status", "f"), fix={"surface_detection": detection}))
    assert of[0]["surface-by-coordination"] == of[0]["surface-normal"] == 1
    assert of[0]["surface-distance"] == of[0]["layer"] == of[0]["pairs-bulk-surface"] == 1  # the second particle
    assert of[2]["splash-by-coordination"] == of[2]["pairs-splash"] == 1
    assert not {"surface-normal", "surface-distance", "layer", "surface-by-divergence"} & set(of[2])


THICK = (Viscosity("power", 0.3, 0.1, 0.2, 0.5), Viscosity("constant", 0.3))


@pytest.mark.parametrize(
    ("rule", "count", "fields", "changes"),
    [
        ("limit-met", 1, ("surface",), {"fix": {"surface_detection": SurfaceDetection("coordination", 2, 0)}}),
        ("limit-met", 0, ("surface",), {"fix": {"surface_detection": SurfaceDetection("divergence", 2.0, 0)}}),
        (
            *("splash-met-by-coordination", 1, ("surface",)),
            {"fix": {"surface_detection": SurfaceDetection("coordination", 2, 1)}},
        ),
        (
            *("splash-met-by-divergence", 1, ("surface",)),
            {"fix": {"surface_detection": SurfaceDetection("divergence", 9.0, 1)}},
        ),
        ("strain-rate-zero", 2, ("f",), {"v": np.zeros((4, 2)), "viscosity": THICK}),
        ("strain-rate-zero", 0, ("f",), {"viscosity": THICK}),
        ("values-shared", 0, ("f",), {"viscosity": THICK}),
    ],
)
def test_an_edge_is_counted_where_it_is_met(rule: str, count: int, fields: Any, changes: dict[str, Any]) -> None:
    """The particles have 2, 3, 1 and, the solid, 2 neighbours."""
    assert counts(evaluated(fields, **changes)).get(rule, 0) == count


def test_a_time_step_counts_once_it_has_changed() -> None:
    at = evaluated()
    assert not [name for name in counts(at) if name.startswith("step-changed")]
    changed = counts(replace(at, step_changed=True))
    assert changed["step-changed-velocity"] == changed["step-changed-density"] == 4
    assert "step-changed-energy" not in changed


def test_images_are_told_from_neighbours_inside_the_box() -> None:
    """Moved so that the row lies across a face, the second particle meets two others there."""
    moved = np.array(X) + np.array([5.5, 0.0])
    across = evaluated(x=np.where(moved >= 9.0, moved - 9.0, moved))
    assert counts(across)["images"] == 2
    assert "own-images" not in counts(across)


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda rule: rule.name)
def test_rule_has_a_name_a_sentence_and_mistakes_that_there_are(rule: Any) -> None:
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*|field/[a-z_/]+", rule.name)
    assert rule.sentence.endswith(".") and "\n" not in rule.sentence
    assert set(rule.faults) <= set(formula.faults())
    assert set(rule.dimensions) in ({2, 3}, set())


def test_every_rule_has_a_name_of_its_own_and_every_field_a_rule() -> None:
    assert len(RULES) == sum(len(rules) for rules in SUBJECTS.values())
    assert [rule.name for rule in fields.RULES if rule.name.removeprefix("field/") not in FIELDS] == []
    assert len(fields.RULES) == len(FIELDS)


def test_every_case_says_what_it_is_for() -> None:
    """Beside those that LAMMPS has to refuse: what `eos-ref explain CASE` counts helps to choose."""
    silent = [case.name for case in casefile.load() if not case.exercises and case.scene.expect is None]
    assert silent == [], "say in `exercises` of the file which rules these cases are for"
    assert [case.name for case in casefile.load() if case.exercises and case.scene.expect] == []
