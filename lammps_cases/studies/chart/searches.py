"""Chart of neighbour searches, and of how often to search: a list built at every step against one with a skin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import combinations, pairwise
from typing import Any

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.analytic.waves import taylor_green
from eos_ref.compiled.neighbours import Neighbours
from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import Box
from eos_ref.model.parameters import Model, PairRheo, Viscosity
from eos_ref.model.state import State
from eos_ref.syntax.fixes import FixRheo
from lammps_cases.records import measure
from lammps_cases.records.measure import ConfidenceInterval, Timing
from lammps_cases.scene.atoms import seed
from lammps_cases.studies.chart.points import Crossing, MethodPoint, Panel, bisected, measured
from lammps_cases.studies.chart.search_methods import METHODS, SearchMethod, truth, wrong
from lammps_cases.studies.flows.layout import rows

CUT = 3.0  # spacings
EDGES = (32, 100, 316)  # particles along an edge: about 1 000, 10 000 and 100 000
SMALL = 6  # particles along the smallest box in which crossings are looked for
NEAR, SCENES = 1000, 4  # particles of a scene for errors, half of them with a partner at the cutoff; such scenes
SKINS = (0.0, 0.05, 0.1, 0.2, 0.3)  # of the cutoff
MACH = {"Mach number 0.1": 0.1, "Mach number 0.01": 0.01}
REBUILDS, LEAST_STEPS, MOST_STEPS = 5, 60, 1500


def _lattice(edge: int, name: str) -> tuple[FloatArray, Box]:
    """Return the square lattice of unit spacing, disordered by a tenth, and its periodic box."""
    random = np.random.default_rng(seed(f"{name}/{edge}"))
    x_nc = rows(0, edge, edge)
    return x_nc + random.uniform(-0.1, 0.1, x_nc.shape), Box((0.0, 0.0), (float(edge),) * 2, (True, True))


# --- searches


def at_the_cutoff(edge: float, n: int, number: int = 0) -> tuple[FloatArray, Box]:
    """Place half the particles at random, each with a partner at the cutoff times 1 +/- 10^-k, k from 6 to 17."""
    random = np.random.default_rng(seed(f"at the cutoff/{edge}/{number}"))
    x_nc, angle_n = random.uniform(0, edge, (n // 2, 2)), random.uniform(0, 2 * np.pi, n // 2)
    off_n = random.choice([-1.0, 1.0], n // 2) * 10.0 ** random.uniform(-17, -6, n // 2)
    partner_nc = x_nc + (CUT * (1 + off_n))[:, None] * np.stack([np.cos(angle_n), np.sin(angle_n)], axis=1)
    partner_nc -= edge * np.floor(partner_nc / edge)
    return np.concatenate([x_nc, partner_nc]), Box((0.0, 0.0), (float(edge),) * 2, (True, True))


def _calls(edge: int, methods: Sequence[SearchMethod]) -> dict[str, Callable[[], object]]:
    x_nc, box = _lattice(edge, "searches")
    return {m.name: partial(m.pairs, x_nc, box, CUT) for m in methods if len(x_nc) <= m.most}


def _crossings(edges: Sequence[int], quick: bool) -> tuple[Crossing, ...]:
    """Return the crossings of the times of two methods between two sizes of a scene."""
    timings = {edge: measure.in_turns(_calls(edge, METHODS), measure.ROUNDS, 0.003) for edge in edges}
    crossings = []
    for one, other in combinations(METHODS, 2):
        both = [e for e in edges if {one.name, other.name} <= timings[e].keys()]
        answers = {e: measure.verdict(timings[e][one.name].against(timings[e][other.name])) for e in both}
        decided = [e for e in both if answers[e] != "cannot tell"]
        for low, high in pairwise(decided):
            if answers[low] != answers[high]:
                crossings.append(_crossing(one, other, low, high, answers[low], quick))
    return tuple(crossings)


def _crossing(one: SearchMethod, other: SearchMethod, low: int, high: int, below: str, quick: bool) -> Crossing:
    def is_below(edge: float) -> bool | None:
        timings = measure.in_turns(_calls(int(edge), (one, other)), measure.ROUNDS, measure.effort(quick)[1])
        answer = measure.verdict(timings[one.name].against(timings[other.name]))
        return None if answer == "cannot tell" else answer == below

    edge = bisected(is_below, low, high, ratio=1.0, whole=True)
    n = ConfidenceInterval(float(edge.low * edge.high), float(edge.low**2), float(edge.high**2))
    first, second = (one.name, other.name) if below == "faster" else (other.name, one.name)
    return Crossing("pairs closer than a cutoff", (first, second), "particles", "less time", n)


def _search_points(edge: int, quick: bool) -> tuple[MethodPoint, ...]:
    calls = _calls(edge, METHODS)
    timings = measure.in_turns(calls, *measure.effort(quick or edge > 100))
    scenes = [at_the_cutoff(float(edge), NEAR, k) for k in range(1 if quick else SCENES)]
    trues = [truth(x_nc, box, CUT) for x_nc, box in scenes]

    def error(m: SearchMethod) -> float:
        pairs = (m.pairs(x_nc, box, CUT) for x_nc, box in scenes)
        return sum(map(wrong, pairs, trues)) / (len(scenes) * NEAR // 2)

    errors, reasons = {m.name: error(m) for m in METHODS if m.name in calls}, {m.name: m.reason for m in METHODS}
    return measured("pairs", f"{edge**2:,} particles", errors, timings, edge**2, reasons)


def _searches(quick: bool) -> Panel:
    edges = EDGES[:2] if quick else EDGES
    points = [p for edge in edges for p in _search_points(edge, quick)]
    return Panel(
        "searches",
        "Finding neighbours",
        f"Periodic 2D box, disordered square lattice, cutoff of {CUT:g} spacings; one thread, from positions to a list "
        f"of pairs. Errors belong to other scenes in the same box: {NEAR} particles, half of them with a partner at "
        "the cutoff but for a fraction of 1e-6 to 1e-17.",
        "pairs missed or invented over pairs laid at the cutoff, against exact arithmetic",
        "particle",
        tuple(points),
        crossings=_crossings((SMALL, 12, *edges), quick),
    )


# --- how often


def fluid(mach: float, skin: float, edge: int) -> tuple[Simulation, float]:
    """Return a vortex flow of a disordered fluid, with a neighbour list of a skin (in cutoffs), and its time step."""
    from eos_ref.compiled.evaluator import CompiledEvaluator

    x_nc, box = _lattice(edge, "rebuild")
    v_nc = np.stack(taylor_green(x_nc[:, 0], x_nc[:, 1], 0.0, 2 * np.pi / edge, 0.0, mach)[:2], axis=1)
    law = EOSTable((EOS("linear", 1.0, 1.0),))
    model = Model(2, FixRheo(CUT, "quintic", 0), (1.0,), law, PairRheo(CUT, 1.0), (Viscosity("constant", 0.02),))
    n = len(x_nc)
    state = State(x_nc, v_nc, np.ones(n), np.ones(n, int), np.zeros(n, bool))
    return Simulation(model, box, state, (), partial(CompiledEvaluator, skin=skin * CUT)), 0.25 / (1 + mach)


def _ran(mach: float, skin: float, edge: int, most: int) -> tuple[Simulation, float, FloatArray]:
    """Return a fluid that has run, its rebuilds per step, and its densities (n,) after `LEAST_STEPS`."""
    from eos_ref.compiled.evaluator import CompiledEvaluator

    sim, dt = fluid(mach, skin, edge)
    sim.run(LEAST_STEPS, dt)
    rho_n, steps = sim.state.rho_n.copy(), LEAST_STEPS
    assert isinstance(sim.evaluator, CompiledEvaluator)
    near = sim.evaluator.neighbours
    while near.built < REBUILDS + 1 and steps < most:
        sim.run(10, dt)
        steps += 10
    return sim, (near.built - 1) / steps, rho_n


def _rebuild_points(regime: str, mach: float, edge: int, quick: bool) -> tuple[MethodPoint, ...]:
    rates: dict[float, float] = {}
    densities: dict[float, FloatArray] = {}
    calls: dict[str, Callable[[], object]] = {}
    for skin in SKINS:
        sim, rates[skin], densities[skin] = _ran(mach, skin, edge, MOST_STEPS // 5 if quick else MOST_STEPS)
        # So short a step moves no coordinate: the list holds.
        calls[f"held {skin}"] = partial(sim.run, 1, 1e-200)
        calls[f"build {skin}"] = partial(Neighbours(sim.box, CUT, skin * CUT).build, sim.state.x_nc.copy())
    took = measure.in_turns(calls, *measure.effort(quick))
    timings: dict[str, Timing] = {}
    errors, reasons, notes = {}, {}, {}
    for skin in SKINS:
        held, build = took[f"held {skin}"], took[f"build {skin}"]
        pairs_r = zip(held.seconds_r, build.seconds_r, strict=True)
        name = f"skin {skin:g}"
        timings[name] = Timing(tuple(h + rates[skin] * b for h, b in pairs_r), held.calls, held.first)
        errors[name] = float(np.max(np.abs(densities[skin] / densities[0.0] - 1)))
        share = rates[skin] * build.seconds.median / timings[name].seconds.median
        ns = build.seconds.median * 1e9 / edge**2
        reasons[name] = f"a list of the pairs within {1 + skin:g} cutoffs, kept until one may be missing"
        notes[name] = f"{rates[skin]:.3g} lists a step, {ns:.0f} ns each: {100 * share:.0f} % of the time"
    return measured("step", regime, errors, timings, edge**2, reasons, notes=notes)


def _rebuilds(quick: bool) -> Panel:
    edge = 40 if quick else 64
    return Panel(
        "rebuild",
        "How far beyond the cutoff",
        f"A vortex flow of {edge**2} disordered particles with the whole model, cutoff of {CUT:g} spacings. A step "
        "costs its evaluation, with the pairs beyond the cutoff, and its share of the lists: the time of one times "
        f"the rate counted in the running flow (until {REBUILDS} lists are built or {MOST_STEPS} steps taken).",
        f"densities after {LEAST_STEPS} steps against those with a list built at every step, relative; worst particle",
        "particle and step",
        tuple(
            p
            for regime, mach in list(MACH.items())[: 1 if quick else None]
            for p in _rebuild_points(regime, mach, edge, quick)
        ),
    )


def panels(quick: bool, lmp: Any | None) -> Iterator[Panel]:
    """Time searches and lists with a skin; LAMMPS builds its lists within its steps and cannot be timed alone."""
    yield _searches(quick)
    yield _rebuilds(quick)
