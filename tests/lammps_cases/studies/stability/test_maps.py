"""Every map of the registry is put the same questions; how its cells end, and the theory that is drawn over it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS
from eos_ref.eos import bounds
from eos_ref.eos.bounds import EPS
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.time_step import MakeEvaluator
from eos_ref.kernels import reproducing
from eos_ref.kernels.quintic import QUINTIC
from lammps_cases.engine.session import Session
from lammps_cases.findings import LEDGER
from lammps_cases.findings.forces import ForcePerVolume
from lammps_cases.studies.flows.flow import Start
from lammps_cases.studies.flows.solve import FlowRun
from lammps_cases.studies.stability import kinds, probe
from lammps_cases.studies.stability.kinds import kinetic_energy
from lammps_cases.studies.stability.maps import MAPS, laws, matrices, tension, timestep, walls
from lammps_cases.studies.stability.model import (
    ENGINES,
    KINDS,
    CellOutcome,
    Engine,
    FailureCriteria,
    Kind,
    MapCell,
    StabilityMap,
)
from lammps_cases.studies.stability.runs import ReferenceRun, open_run
from tests.support.roundings import rounded

pytestmark = pytest.mark.slow
sides = pytest.mark.parametrize("side", ["reference", pytest.param("lammps", marks=pytest.mark.lammps)])


@cache
def living() -> Session:
    """The LAMMPS of this process."""
    return Session()


def begun(of: StabilityMap, x: float, y: float, layer: str = "", side: Engine = "reference") -> tuple[Start, FlowRun]:
    """The start of a cell, and its run."""
    cell = MapCell(of.id, x, y, layer)
    start = of.start(cell)
    return start, open_run(start, of.watch(cell), side, living())


def outcome(
    of: StabilityMap,
    x: float,
    y: float,
    layer: str = "",
    side: Engine = "reference",
    evaluator: MakeEvaluator | None = None,
) -> CellOutcome:
    """The outcome of a cell; with an evaluator, in a reference that uses it."""
    cell = MapCell(of.id, x, y, layer)
    start, watch = of.start(cell), of.watch(cell)
    run = (
        partial(ReferenceRun, start, watch, evaluator) if evaluator else partial(open_run, start, watch, side, living())
    )
    return probe.follow(run, kinds.subject(start), watch, start.steps[-1]).outcome


def theory(of: StabilityMap, y: float, layer: str = "") -> float:
    return next(t for t in of.theory if t.layer in (None, layer)).x_of_y(y)


# --- the same questions to every map


@pytest.mark.parametrize("of", MAPS.values(), ids=list(MAPS))
def test_every_map_is_well_formed(of: StabilityMap) -> None:
    """Axes are ordered, lines lie on them, cells at the ends of each line can be made."""
    assert MAPS[of.id] is of and of.title and of.about
    assert of.x.low < of.x.high and of.x.width > 0 and of.coarse >= 2
    assert all(of.y.low <= y <= of.y.high for y in of.lines)
    assert set(of.lines_run(True)) <= set(of.lines) == set(of.lines_run(False))
    assert {t.layer for t in of.theory} <= {None, *of.layers}
    for layer in of.layers:
        for y, x in itertools.product((min(of.lines), max(of.lines)), (of.x.low, of.x.high)):
            cell = MapCell(of.id, x, y, layer)
            start, watch = of.start(cell), of.watch(cell)
            assert len(start.atoms) > 0
            alone = of in laws.MAPS
            assert start.case.scene.interacts != alone
            if alone:
                assert np.isfinite(start.atoms.rho_n).all()
            matrix = of in matrices.MAPS and not layer.endswith("run")  # only the matrix is examined, nothing moves
            assert (start.steps == (0,)) == (alone or matrix)
            assert (watch.condition is not None) == matrix
            if of in timestep.MAPS:
                assert start.steps == (timestep.STEPS,)


def test_every_difference_of_engines_is_explained_once_by_a_finding_or_by_its_map() -> None:
    told = [where for entry in LEDGER for where in entry.expected_in_maps]
    assert told and all(where.why and where.layer in (None, *MAPS[where.map].layers) for where in told)
    assert len({(where.map, where.layer) for where in told}) == len(told)
    assert not {where.map for where in told} & {of.id for of in MAPS.values() if of.engines_differ}


# --- how cells end

Ends = Mapping[float, Kind | tuple[Kind, ...]]
FAILED: tuple[Kind, ...] = ("failed matrix", "ill-conditioned matrix")
THROUGH: Kind = "wall penetration"


def across(
    of: StabilityMap, y: float, below: Any, above: Any, layer: str = "", down: float = 0.0, up: float = 0.0
) -> tuple[StabilityMap, str, float, Ends]:
    """The ends on both sides of a limit of theory, by default one width away, which the axis reaches."""
    limit = theory(of, y, layer)
    places = [limit - down, limit + up]
    if not (down or up):
        places = [limit * 10 ** (k * of.x.width) if of.x.log else limit + k * of.x.width for k in (-1, 1)]
        assert of.x.low < places[0] < limit < places[1] < of.x.high, f"the axis of {of.id} does not reach the limit"
    return of, layer, y, {places[0]: below, places[1]: above}


def of_laws() -> Iterator[Any]:
    limits: dict[StabilityMap, dict[str, tuple[Kind, Kind]]] = {
        laws.OVERFLOW: {"": ("stable", "overflow")},
        laws.CUBIC: {
            **dict.fromkeys(("compressed", "stretched"), ("stable", "loss of hyperbolicity")),
            "sign": ("stable", "negative pressure"),
        },
        laws.ENERGY: {"": ("negative pressure", "stable")},
        laws.BACKGROUND: dict.fromkeys(laws.BACKGROUND.layers, ("negative pressure", "stable")),
    }
    for of, layers in limits.items():
        for (layer, ends), y in itertools.product(layers.items(), of.lines):
            yield across(of, y, *ends, layer)
    below: dict[float, Kind] = dict.fromkeys((-1.5, 1.4, 2.3), "non-finite")
    for gamma, kind in (below | {4.0: "loss of hyperbolicity", 7.0: "stable"}).items():
        yield laws.NEGATIVE, "", gamma, {-0.3: kind, 0.3: "stable"}
    for e, kind in ((-1.0, "negative pressure"), (0.5, "stable"), (2.0, "stable")):
        yield laws.GAS, "", e, {1.0: "error", 1.001: kind}
    for ratio in laws.LIMIT.lines:
        yield laws.LIMIT, "", ratio, dict.fromkeys((1e-18, 1e-9, 1.0), "stable")


def of_matrices() -> Iterator[Any]:
    for layer in ("RK0", "RK1", "RK2"):  # on a lattice without disorder, a shell of neighbours decides
        yield across(matrices.LATTICE, 0.0, "failed matrix", "stable", layer, 0.005, 0.05)
    for layer, cut in itertools.product(("RK1", "RK2"), matrices.ZMIN.lines):
        # The least sufficient zmin is one more than the largest insufficient number of neighbours.
        needed = matrices.zmin_needed("RK1" if layer == "RK1" else "RK2", cut)
        yield matrices.ZMIN, layer, cut, {needed: "stable", **({needed - 0.1: FAILED} if needed else {})}
    for layer in ("RK1", "RK2"):
        yield across(matrices.SURFACE, 0.0, FAILED, "stable", layer, 0.01, 0.1)
    for cut in matrices.ROW.lines:
        limit = theory(matrices.ROW, cut, "RK1")
        yield matrices.ROW, "RK1", cut, {limit / 1.05: FAILED, limit * 1.05: "stable", 1e-12: FAILED}


def of_the_reference() -> Iterator[Any]:
    yield from of_laws()
    yield from of_matrices()
    for cut in tension.WIDE.lines:  # positive pressure pairs no particles
        yield tension.WIDE, "", cut, {0.8: "stable", -0.2: "clumping"}
    # The estimate is linear and represents the disorder by one wave: it is accurate to 0.05 rho0 c^2.
    clumps = tension.clumps_below(1.0, 3.0)
    yield tension.TENSION, "", 1.0, {-0.2: "clumping", clumps - 0.05: "clumping", clumps: "stable"}
    yield tension.TENSION, "shift", 1.0, {-0.2: "stable", -0.6: "clumping"}
    # Harmonic means deprive the light particles of the heavy ones' viscosity, which damps them.
    unsound = KINDS[1:]
    limit = tension.viscous_limit(1.0)  # the boundary lies beyond it
    yield PHASES, "continuity", 1.0, {limit: "stable", 80.0: "stable", 1000.0: unsound}
    yield PHASES, "harmonic/means", 1.0, {80.0: "clumping"}
    yield PHASES, "rho/sum self/mass", 1.0, {10.0: "stable", 1000.0: unsound}
    # Reconstruction makes walls tighter; only with it their stiffness counts, only without it artificial viscosity.
    yield walls.THICKNESS, walls.STORED, 2.0, {0.36: THROUGH}
    yield walls.THICKNESS, walls.RECONSTRUCT, 2.0, {0.36: "stable"}
    yield walls.STIFFNESS, walls.RECONSTRUCT, 0.5, {0.5: THROUGH}
    yield walls.STIFFNESS, walls.RECONSTRUCT, 2.0, {0.5: "stable"}
    yield walls.VISCOSITY, walls.STORED, 0.0, {0.6: THROUGH}
    yield walls.VISCOSITY, walls.STORED, 2.0, {0.6: "stable"}
    yield walls.VISCOSITY, walls.RECONSTRUCT, 2.0, {0.6: THROUGH}
    yield walls.THICKNESS, walls.STORED, 1.0, {0.2: THROUGH}
    yield walls.THICKNESS, walls.STORED, 3.0, {0.2: "stable"}


def of_lammps() -> Iterator[Any]:
    """Where LAMMPS differs from the reference."""
    yield laws.GAS, "", 2.0, {0.9: "negative pressure"}  # where the reference refuses
    yield laws.LIMIT, "", 1.3, {1e-12: "lost digits"}  # where the reference has sixteen digits
    yield PHASES, "rho/sum self/mass", 1.0, {10.0: "error"}


def of_both() -> Iterator[Any]:
    yield laws.OVERFLOW, "", 7.0, {50.0: "overflow"}
    yield laws.NEGATIVE, "", 2.3, {-0.3: "non-finite"}
    for ratio in (0.1, 1.0, 10.0):
        limit = timestep.growth_limit(ratio, timestep.CUT)
        yield timestep.VISCOSITY, "", ratio, {0.97 * limit: "stable", 1.01 * limit: "energy growth"}
    for density in (0.8, 1.2):  # the boundary follows the background at which the total pressure is 0
        yield across(tension.TENSION, density, "clumping", "stable", down=0.1, up=0.05)
    # Summed densities tolerate a small density ratio only.
    yield PHASES, "continuity", 1.0, {10.0: "stable"}
    yield PHASES, "harmonic/means", 1.0, {10.0: "stable"}
    yield PHASES, "rho/sum", 1.0, {10.0: "clumping"}
    yield matrices.SUMMED, "rho/sum", 4.0, {0.5: "stable", 20.0: "clumping"}
    yield matrices.SUMMED, "continuity", 4.0, {20.0: "stable"}
    for of, layer in itertools.product(walls.MAPS, (walls.STORED, walls.RECONSTRUCT)):
        yield of, layer, of.lines[1], {0.1: "stable", 2.0: THROUGH}
    # Viscosity limits the step as in a shear wave, where the measured limit is 4.18 times Morris'.
    yield walls.COLUMN, "", 1.0, {1.0: "stable", 3.8: "stable", 4.6: "energy growth"}
    yield walls.DAM_BREAK, "", 0.3, {0.3: "stable", 1.5: THROUGH}
    yield walls.DROP, "", 0.2, {1.0: "stable", 9.0: tuple(k for k in KINDS if k not in ("stable", THROUGH))}
    yield walls.DROP, "", 0.4, {1.0: THROUGH}


PHASES = tension.PHASES_MAPS[0]
ROWS = [
    pytest.param(*row, side, marks=pytest.mark.lammps if side == "lammps" else (), id=f"{row[0].id}-{side}")
    for engines, rows in ((ENGINES[:1], of_the_reference), (ENGINES[1:], of_lammps), (ENGINES, of_both))
    for row in rows()
    for side in engines
]


@pytest.mark.parametrize(("of", "layer", "y", "ends", "side"), ROWS)
def test_cells_end_as_theory_or_known_behaviour_says(
    of: StabilityMap, layer: str, y: float, ends: Ends, side: Engine
) -> None:
    for x, wanted in ends.items():
        found = outcome(of, x, y, layer, side)
        assert found.kind in ((wanted,) if isinstance(wanted, str) else wanted), (x, found)
        if found.kind == THROUGH:
            face = of.watch(MapCell(of.id, x, y, layer)).behind
            assert face is not None and found.value is not None and found.value < face[1]


@sides
@pytest.mark.parametrize(
    ("of", "x", "y", "layer", "atom", "value"),
    [
        # A surface particle taken for bulk; a bulk particle taken for surface.
        *((matrices.DETECTION, 0.4, 0.05, layer, 1, 0.0) for layer in matrices.DETECTION.layers),
        *(
            (matrices.DETECTION, 1.25, 0.05, layer, matrices.DEEP * matrices.WIDTH + 1, 1.0)
            for layer in matrices.DETECTION.layers
        ),
        *((matrices.DETECTION, 0.8, 0.05, layer, None, None) for layer in matrices.DETECTION.layers),
        (matrices.SPLASH, 0.0, 2.0, "", matrices.LAYERS * matrices.WIDTH + 1, 1.0),
        (matrices.SPLASH, 0.8, 2.0, "", 1, 2.0),
        (matrices.SPLASH, 0.35, 2.0, "", None, None),
    ],
    ids=lambda part: getattr(part, "id", str(part)),
)
def test_wrong_limits_misclassify_surfaces(
    of: StabilityMap, x: float, y: float, layer: str, atom: int | None, value: float | None, side: Engine
) -> None:
    found = outcome(of, x, y, layer, side)
    assert (found.kind, found.atom, found.value) == ("misclassified surface" if atom else "stable", atom, value)


@pytest.mark.parametrize(
    ("of", "x", "y", "layer", "side", "words"),
    [
        (laws.GAS, 1.0, 2.0, "", "reference", "must exceed 1"),
        pytest.param(PHASES, 10.0, 1.0, "rho/sum self/mass", "lammps", "self/mass", marks=pytest.mark.lammps),
    ],
    ids=["gamma", "self-mass"],
)
def test_refusals_name_their_cause(of: StabilityMap, x: float, y: float, layer: str, side: Engine, words: str) -> None:
    assert words in outcome(of, x, y, layer, side).message


# --- laws


@pytest.mark.parametrize("gamma", [2.3, 7.0, 60.0, 4000.0])
def test_overflow_begins_at_the_largest_double(gamma: float) -> None:
    """To 1e-12 of the exponent, not only to the width of the axis; the value is the infinite pressure."""
    limit = theory(laws.OVERFLOW, gamma)
    assert outcome(laws.OVERFLOW, limit * (1 - 1e-12), gamma).kind == "stable"
    found = outcome(laws.OVERFLOW, limit * (1 + 1e-12), gamma)
    assert (found.kind, found.atom, found.value) == ("overflow", 1, math.inf)
    assert EOS("tait/general", laws.RHO0, laws.CS, gamma).pressure(laws.RHO0 * 10 ** (limit * (1 + 1e-12))) == math.inf


def test_tait_has_no_limit_at_negative_densities_for_odd_powers() -> None:
    for gamma in laws.NEGATIVE.lines:
        limit = theory(laws.NEGATIVE, gamma)
        assert math.isnan(limit) if gamma == 7.0 else limit == 0


def test_reference_has_the_limit_of_a_vanishing_exponent() -> None:
    """P -> c^2 rho0 ln(rho/rho0), to eight digits on the whole map."""
    for ratio in laws.LIMIT.lines:
        law, rho = EOS("tait/general", laws.RHO0, laws.CS, 1e-18), laws.RHO0 * ratio
        bound = float(bounds.reference(law, rho)) + 4 * 2.0**-53 * laws.STIFFNESS * abs(math.log(ratio))
        assert abs(law.pressure(rho) - laws.STIFFNESS * math.log(ratio)) <= bound


def test_lost_digits_are_detected() -> None:
    """A pressure wrong in its ninth digit passes, in its seventh it does not; the value is the count of digits left."""
    start, run = begun(laws.LIMIT, 0.5, 1.3)
    of, look = kinds.subject(start), run.snapshot()
    assert of.eos is not None
    for error, wanted in ((1e-9, None), (1e-7, "lost digits")):
        wrong = replace(look, pressure_n=look.pressure_n * (1 + error))
        found = kinds.first(of, FailureCriteria(digits=8), wrong, None)
        assert (found and found.kind) == wanted
        if found:
            # Except for the error of the pressure itself: 1e-7 of it is 1/ln 10 of a digit.
            wrong_n = [float(bounds.reference(of.eos[1], rho)) for rho in look.rho_n.tolist()]
            own = float((wrong_n / np.abs(look.pressure_n)).max())
            assert found.value == pytest.approx(7, rel=0, abs=own / 1e-7 / math.log(10))


# --- moment matrices and surfaces


def condition(start: Start, atom: int, order: int) -> Any:
    """Condition number of the matrix of a particle of an open box, from the definition; lengths over the cutoff.

    Sums over neighbours of products of ten roundings, on either side; the smallest singular value loses as many of them
    as the condition number, in every row.
    """
    cut = start.case.scene.rheo.cut
    assert cut is not None
    r_nc = start.atoms.x_nc[atom - 1, :2] - start.atoms.x_nc[:, :2]
    r_n = np.hypot(*r_nc.T)
    near = (r_n > 0) & (r_n < cut)
    h = np.stack([np.broadcast_to(b, near.sum()) for b in reproducing.basis(order, list(r_nc[near].T / cut))])
    w = QUINTIC.normalisation(2, cut) * QUINTIC.shape(QUINTIC.support * r_n[near] / cut)
    found = float(np.linalg.cond((h * w) @ h.T))
    return rounded(found, int(2 * len(h) * (near.sum() + 10) * found))


def test_limits_of_a_lattice_are_its_shells() -> None:
    assert [theory(matrices.LATTICE, 0.0, f"RK{k}") for k in range(3)] == [1.0, 1.0, math.sqrt(2)]
    assert [matrices.neighbours(cut) for cut in (1.2, 1.6)] == [(2, 3, 4), (3, 5, 8)]
    assert matrices.neighbours(3.0)[2] == 24


@pytest.mark.parametrize(("layer", "order"), [("RK1", 1), ("RK2", 2)])
def test_condition_number_is_that_of_the_definition(layer: str, order: int) -> None:
    x = theory(matrices.SURFACE, 0.0, layer) + 0.2
    start = matrices.SURFACE.start(MapCell("matrices-surface", x, 0.1, layer))
    of = kinds.subject(start)
    assert of.model is not None
    evaluator = ArrayEvaluator(of.model, of.box, of.type_n, of.solid_n)
    evaluator.move(start.atoms.x_nc[:, :2])
    m_nbb, definite_n, _ = kinds.moment_matrices(evaluator, np.ones(len(start.atoms)))
    assert definite_n.all()
    for atom in (1, 4, 25):
        assert np.linalg.cond(m_nbb[atom - 1]) == condition(start, atom, order)


@pytest.mark.lammps
@pytest.mark.parametrize("cut", matrices.ROW.lines)
def test_rows_fail_as_in_a_reference_with_the_finding(cut: float) -> None:
    """The same failure at the same step as with force-per-volume, at offsets where the plain reference differs."""
    offsets = np.geomspace(1e-3, 0.1, 13).tolist()
    ends = {
        what: [(end.kind, end.step) for end in (outcome(matrices.ROW, x, cut, "RK1 run", *how) for x in offsets)]
        for what, how in {"LAMMPS": ("lammps",), "": (), "finding": ("reference", ForcePerVolume)}.items()
    }
    assert ends["LAMMPS"] == ends["finding"] != ends[""]


@pytest.mark.lammps
@pytest.mark.parametrize("disorder", matrices.SURFACE.lines)
def test_surfaces_differ_only_where_matrices_fail(disorder: float) -> None:
    """Finding stale-gradient-below-zmin: also with zmin 0, where a matrix has no factor."""
    of = matrices.SURFACE
    differing = [
        cut
        for cut in np.linspace(0.8, 2.0, 25).tolist()
        if len({outcome(of, cut, disorder, "RK1 run", side).kind for side in ENGINES}) > 1
    ]
    assert {outcome(of, cut, disorder, "RK1").kind for cut in differing} <= set(FAILED)
    assert differing or disorder < max(of.lines)


def test_clumping_begins_at_the_surface_under_tension() -> None:
    start, run = begun(matrices.SUMMED, 20.0, 4.0, "rho/sum")
    look = run.snapshot()
    row_n = np.arange(len(start.atoms)) // matrices.WIDTH
    outer_n = np.isin(row_n, (0, matrices.ROWS - 1))
    assert look.pressure_n[outer_n].max() < 2 * look.pressure_n[~outer_n].min() < 0
    atom = outcome(matrices.SUMMED, 20.0, 4.0, "rho/sum").atom
    assert atom is not None
    assert min(row_n[atom - 1], matrices.ROWS - 1 - row_n[atom - 1]) <= 1


def test_share_of_the_circle_is_its_area() -> None:
    """Compare with strips of the circle, each as wide as the circle at its middle.

    Widths rise and fall once by 2 R at most: the error of their sum is at most half a strip times both.
    """
    R, strips = matrices.CUT, 100_000
    for height in (-2.0, -0.5, 0.0, 1.3):
        thick = (height + R) / strips
        y_n = -R + thick * (np.arange(strips) + 0.5)
        area = float((2 * np.sqrt(R**2 - y_n**2)).sum()) * thick
        assert matrices.share(height) == pytest.approx(area / (np.pi * R**2), rel=0, abs=2 * R * thick / (np.pi * R**2))
    assert (matrices.share(-4.0), matrices.share(4.0)) == (0.0, 1.0)


def test_expected_classes_follow_from_the_geometry() -> None:
    """Rows farther than the cutoff from the surface are bulk, the outermost ones surface, and no others are judged."""
    cell = MapCell(matrices.DETECTION.id, 0.8, 0.05, "coordination")
    known = matrices.DETECTION.watch(cell).surface
    y_n = matrices.DETECTION.start(cell).atoms.x_nc[:, 1]
    for atom, kind in known.items():
        depth = min(y_n[atom - 1], matrices.LAYERS - y_n[atom - 1])
        assert depth < 1 if kind else depth > matrices.CUT
    assert sorted(known.values()) == [0] * 3 * matrices.WIDTH + [1] * 2 * matrices.WIDTH


# --- time step


@sides
@pytest.mark.parametrize(
    ("fraction", "ratio", "cut"), [(1.5, 0.1, 3.0), (4.3, 1.0, 3.0), (4.5, 3.0, 2.5), (0.5, 1.0, 4.0)]
)
def test_energy_is_that_of_the_linearised_scheme(side: Engine, fraction: float, ratio: float, cut: float) -> None:
    tiny = 1e-9  # Mach number at which the scheme is linear
    start = timestep.box(fraction, ratio, cut, tiny)
    of, run = kinds.subject(start), open_run(start, timestep.watch(tiny), side, living())
    first = kinetic_energy(of.mass_n, run.snapshot().v_nc)
    measured = []
    for _ in range(5):
        run.advance(4)
        measured.append(kinetic_energy(of.mass_n, run.snapshot().v_nc) / first)
    # In a box of 10 spacings positions round by 1e-15; particles move by 2e-10 or more in a step: 5e-6 of it, and the
    # energy is a square.
    assert measured == pytest.approx(timestep.growth(fraction, ratio, cut, 4, 5), rel=1e-5)


def test_waves_grow_beyond_the_limits() -> None:
    """The largest eigenvalue of a step crosses 1 at the lower of the two limits."""
    of = timestep.waves(3.0)
    for ratio, limit in ((0.1, timestep.sound_limit), (10.0, timestep.viscous_limit)):
        at = limit(ratio, 3.0)
        sizes = []
        for fraction in (0.95 * at, 1.2 * at):
            dt, nu = timestep.step_of(fraction, ratio, 3.0), timestep.viscosity(ratio, 3.0)
            s_k, q_k = of.d_k * dt, nu * of.l_k * dt
            # Eigenvalues of [[1 - s^2/2 - q, -i s], [-i s, 1]]: z^2 - trace z + det
            trace_k, det_k = 2 - s_k**2 / 2 - q_k, 1 + s_k**2 / 2 - q_k
            root_k = np.sqrt(trace_k**2 / 4 - det_k + 0j)
            sizes.append(float(np.abs([trace_k / 2 + root_k, trace_k / 2 - root_k]).max()))
        assert sizes[0] <= 1 + 1e-12 < sizes[1]


@pytest.mark.parametrize("cut", [2.0, 3.0, 4.0])
def test_criteria_meet_where_viscosity_and_sound_limit_equally(cut: float) -> None:
    assert timestep.acoustic_criterion(1.0, cut) == rounded(1.0, 8) == timestep.viscous_criterion(1.0, cut)
    assert timestep.acoustic_criterion(3.0, cut) == rounded(3.0, 8)
    assert timestep.viscous_criterion(0.2, cut) == rounded(5.0, 8)


# --- tension and phases


def test_shift_raises_the_density_until_tension_vanishes() -> None:
    start, run = begun(tension.TENSION, -0.2, 1.0, "shift")
    assert np.mean(run.snapshot().pressure_n) == rounded(-0.2, 8, terms=1.0)
    run.advance(start.steps[-1])
    assert np.mean(run.snapshot().rho_n) > 1.1
    assert np.mean(run.snapshot().pressure_n) > -0.1


def fastest(background: float) -> tuple[np.ndarray, np.ndarray]:
    """Return wave vector and direction of the wave that grows fastest."""
    stiffness_kab, g_kc, damping_k = tension.waves(3.0)
    value_kc, vector_kab = np.linalg.eigh(2 * background * stiffness_kab + g_kc[:, :, None] * g_kc[:, None, :])
    half_k = tension.NU * damping_k / 2
    k = int(np.argmax(-half_k + np.sqrt(np.maximum(half_k**2 - value_kc[:, 0], 0.0))))
    _, edges = tension.triangles(tension.WIDTH, tension.HEIGHT)
    p, q = divmod(k + 1, tension.HEIGHT)  # the wave of infinite length is left out
    return 2 * np.pi * np.array([p, q]) / edges, vector_kab[k, :, 0]


@sides
def test_wave_grows_at_the_rate_of_the_theory(side: Engine) -> None:
    """A small wave on the perfect lattice grows at the rate of the theory, to first order in the time step."""
    background, dt, size = -0.3, 0.01, 1e-5
    x_nc, edges = tension.triangles(tension.WIDTH, tension.HEIGHT)
    k_c, e_c = fastest(background)
    wave_n = np.cos((x_nc - x_nc[0]) @ k_c)
    start = tension.TENSION.start(MapCell("tension", background, 1.0, ""))
    flat_nc = np.hstack([np.mod(x_nc + size * wave_n[:, None] * e_c, edges), np.zeros((len(x_nc), 1))])
    scene = start.case.scene
    assert scene.evolve is not None
    timed = scene.model_copy(update={"evolve": scene.evolve.model_copy(update={"timestep": dt})})
    start = replace(start, atoms=replace(start.atoms, x_nc=flat_nc), timestep=dt, case=replace(start.case, scene=timed))
    run = open_run(start, FailureCriteria(), side, living())
    sizes = []
    for steps in (500, 500):
        run.advance(steps)
        moved_nc = run.snapshot().x_nc - x_nc
        moved_nc -= np.round(moved_nc / edges) * edges
        sizes.append(float(wave_n @ moved_nc @ e_c) / float(wave_n @ wave_n))
    rate = tension.growth_rate(background, 1.0, 3.0)
    assert size < sizes[1] < 1e-2  # it has grown, and is still small
    assert np.log(sizes[1] / sizes[0]) / (500 * dt) == pytest.approx(rate, rel=rate * dt)


def test_no_growth_without_tension() -> None:
    # The lower eigenvalue, 0, rounds like g^2, and the root of its sum with (Gamma/2)^2 like Gamma/2.
    _, g_kc, damping_k = tension.waves(3.0)
    half_k, size_k = tension.NU * damping_k / 2, (g_kc**2).sum(axis=1)
    rounding = float((8 * EPS * size_k / (2 * half_k) + 2 * EPS * half_k).max())
    assert tension.growth_rate(0.0, 1.0, 3.0) == pytest.approx(0, abs=rounding)
    assert tension.growth_rate(0.3, 1.0, 3.0) < 1e-3
    assert tension.growth_rate(-0.3, 1.0, 3.0) > tension.growth_rate(-0.1, 1.0, 3.0) > 0.05
    assert -0.05 < tension.clumps_below(1.0, 3.0) < 0


def test_stability_depends_on_the_whole_sum_of_neighbours() -> None:
    """With 6 spacings W'' < 0 at the nearest neighbours, but the lattice is unstable only under tension."""

    def bend(cut: float) -> float:
        h, step = cut / QUINTIC.support, 1e-4
        slopes = [QUINTIC.slope(tension.EDGE / h + side) for side in (-step, step)]
        return float(slopes[1] - slopes[0])

    assert bend(6.0) < 0 < bend(3.0)
    for cut in (3.0, 6.0):
        eigenvalues = np.linalg.eigvalsh(tension.waves(cut)[0])
        assert -0.01 * eigenvalues.max() < eigenvalues.min() < eigenvalues.max()


def test_tension_of_summed_densities() -> None:
    """In the heavy fluid at the interface it agrees with the line of theory, which assumes an infinite ratio."""
    start, run = begun(PHASES, 1000.0, 1.0, "rho/sum")
    look, heavy_n = run.snapshot(), start.atoms.type_n == 1
    depth_n = tension.SIZE / 4 - np.abs(start.atoms.x_nc[:, 0] - tension.SIZE / 2)
    face_n, deep_n = heavy_n & (depth_n < 0.7), heavy_n & (depth_n > 2.2)
    assert look.pressure_n[face_n].max() < 0 < tension.BACKGROUND
    assert abs(np.mean(look.pressure_n[deep_n]) - tension.BACKGROUND) < 0.05
    # On the interface half of the mass is missing; the first particles lie half a spacing inside.
    assert -0.5 < np.mean(look.pressure_n[face_n]) - tension.BACKGROUND < -0.2
    assert tension.viscous_limit(1.0) == rounded(11.5, 8)  # 2 h^2/8 over nu dt = 0.1 x 0.2, less 1


# --- walls and whole scenes


def test_stiffness_of_a_wall_makes_no_difference_without_reconstruction() -> None:
    ends = []
    for sound in (0.5, 1.0):  # the same time step
        _, run = begun(walls.STIFFNESS, 0.2, sound, walls.STORED)
        run.advance(50)
        ends.append(run.snapshot().x_nc)
    assert np.array_equal(*ends)


@pytest.mark.lammps
def test_missing_volume_explains_tighter_walls_of_lammps() -> None:
    """Compressed fluid has volumes below 1, which LAMMPS' forces lack, so its walls push harder."""
    cell = walls.STIFFNESS, 0.74, 2.0, walls.RECONSTRUCT
    like_lammps: Callable[..., Any] = type("LikeLammps", (ForcePerVolume, ArrayEvaluator), {})
    ends = [outcome(*cell), outcome(*cell, "lammps"), outcome(*cell, "reference", like_lammps)]
    assert [end.kind for end in ends] == [THROUGH, "stable", "stable"]


def test_face_lies_behind_the_solids() -> None:
    for layers in (1.0, 2.0, 3.0):
        cell = MapCell(walls.THICKNESS.id, 0.2, layers, walls.STORED)
        start, watch = walls.THICKNESS.start(cell), walls.THICKNESS.watch(cell)
        solid_n = start.atoms.type_n == 2
        assert solid_n.sum() == layers * walls.BLOCK_WIDTH
        assert watch.behind == (1, start.atoms.x_nc[solid_n, 1].min() - 0.5)


def test_column_swings_about_its_weight() -> None:
    """Sound travels down and up twice in one period of the lowest mode; the mean pressure at the bottom is g H."""
    start, run = begun(walls.COLUMN, 1.0, 0.2)
    bottom_n = (start.atoms.type_n == 1) & (start.atoms.x_nc[:, 1] < 1)
    energies, pressures = [], []
    while run.step < start.steps[-1]:
        run.advance(1)
        look = run.snapshot()
        energies.append(kinetic_energy(start.atoms.mass_n, look.v_nc))
        pressures.append(np.mean(look.pressure_n[bottom_n]))
    supplied = walls.COLUMN.watch(MapCell("", 1.0, 0.2)).energy
    assert supplied is not None
    assert 0.1 * supplied < max(energies) < supplied  # the scale of the criterion has the right size
    weight = walls.COMPRESSION * (walls.TALL - 0.5) / walls.TALL
    # Except for the compression, of the fluid above and of the oscillating fluid.
    assert np.mean(pressures) == pytest.approx(weight, rel=2 * walls.COMPRESSION)


def test_dam_reaches_the_opposite_wall() -> None:
    start, run = begun(walls.DAM_BREAK, 0.3, 0.3)
    fronts = []
    for steps in (0, start.steps[-1]):
        run.advance(steps)
        fronts.append(run.snapshot().x_nc[start.atoms.type_n == 1, 0].max())
    assert fronts[0] < walls.DAM < walls.SPAN - 2 < fronts[1] < walls.SPAN


@pytest.mark.parametrize("of", [walls.COLUMN, walls.DROP], ids=lambda of: of.id)
def test_only_the_time_step_changes_along_x(of: StabilityMap) -> None:
    """So that the map gives limits of the time step."""
    a, b = (of.start(MapCell(of.id, x, 0.2, "")) for x in (0.5, 2.0))
    assert 3.5 < b.timestep / a.timestep < 4.5
    assert np.array_equal(a.atoms.x_nc, b.atoms.x_nc)
    assert a.case.scene.types == b.case.scene.types
