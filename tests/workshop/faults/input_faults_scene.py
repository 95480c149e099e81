"""Faults in LAMMPS' input that a scene can express: types, equations of state, options, forces and time steps."""

from __future__ import annotations

from functools import partial

from lammps_cases.scene.changes import Kind
from lammps_cases.scene.particles import LawSettings
from lammps_cases.scene.settings import SurfaceDetectionSettings
from tests.workshop.faults.scene_changes import (
    InputFault,
    SceneChange,
    Updates,
    altered,
    as_style,
    cross_type,
    cut,
    dropped,
    entry,
    evolve,
    exchanged,
    excluding,
    force,
    kernel,
    laws,
    only,
    pair,
    plus,
    power,
    put,
    put_if_unset,
    rheo,
    rotated,
    surface,
    times,
    type_range,
    types,
    vector,
)

TINY = 1 + 1e-6
_SURFACE_LIMITS = {"coordination": 20.0, "divergence": 1.5}


def _other_single(law: LawSettings) -> Updates:
    return {"types": str(3 - int(law.types))} if law.types in ("1", "2") else {}


def _one_less(number: str) -> str:
    return str(int(number) - 1) if number and int(number) > 1 else number


def _other_surface(settings: SurfaceDetectionSettings) -> Updates:
    style = "divergence" if settings.style == "coordination" else "coordination"
    return {"style": style, "limit": _SURFACE_LIMITS[style]}


def _lower_limit(settings: SurfaceDetectionSettings) -> Updates:
    lower = 0.9 * settings.limit
    return {"limit": lower if settings.style == "divergence" else float(int(lower))}


tait, gas, water = (partial(entry, style) for style in ("tait/general", "ideal/gas", "tait/water"))
gravity, addforce, setforce = (partial(force, style) for style in ("gravity", "addforce", "setforce"))
entries = partial(altered, "pressure")
opposite = vector(lambda v: -v)
_TABLE: tuple[tuple[str, Kind, str, SceneChange], ...] = (
    # --- types
    ("cs-off", "constant", "speed of sound of every type times 1 + 1e-6", types(times("cs", TINY))),
    ("cs-doubled", "constant", "speed of sound of every type doubled", types(times("cs", 2))),
    ("cs-of-one", "constant", "speed of sound 1 for all types", types(lambda t: {"cs": 1.0 if t.cs else None})),
    ("cs-dropped", "missing term", "keyword speed/sound left out", types(put(cs=None))),
    ("cs-squared", "exponent", "square of the speed of sound given for it", types(lambda t: {"cs": t.cs and t.cs**2})),
    ("cs-exchanged", "exchanged", "speeds of sound of the types exchanged", rotated("cs")),
    ("rho0-off", "constant", "equilibrium density of every type times 1 + 1e-6", types(times("rho0", TINY))),
    ("rho0-halved", "constant", "equilibrium density of every type halved", types(times("rho0", 0.5))),
    ("rho0-dropped", "missing term", "keyword density left out", types(put(rho0=None))),
    ("rho0-exchanged", "exchanged", "equilibrium densities of the types exchanged", rotated("rho0")),
    (
        *("rho0-and-cs-exchanged", "exchanged", "equilibrium density given as speed of sound and the reverse"),
        types(exchanged("rho0", "cs")),
    ),
    ("mass-off", "volume or mass", "mass of every type times 1 + 1e-6", types(times("mass", TINY))),
    ("mass-doubled", "volume or mass", "mass of every type doubled", types(times("mass", 2))),
    ("mass-of-one", "volume or mass", "mass 1 for all types", types(put(mass=1.0))),
    ("mass-exchanged", "exchanged", "masses of the types exchanged", rotated("mass")),
    # --- laws
    ("gamma-off", "exponent", "exponent of tait/general times 1 + 1e-6", tait(times("gamma", TINY))),
    ("gamma-plus-one", "exponent", "exponent of tait/general larger by 1", tait(plus("gamma", 1.5))),
    ("gamma-of-seven", "exponent", "exponent 7 for tait/general", tait(put(gamma=7.0))),
    ("gamma-inverted", "exponent", "inverse of the exponent of tait/general", tait(lambda t: {"gamma": 1 / t.gamma})),
    ("gas-gamma-off", "constant", "gamma of ideal/gas times 1 + 1e-6", gas(times("gamma", TINY))),
    ("gas-gamma-less-one", "missing term", "gamma - 1 given to ideal/gas for gamma", gas(plus("gamma", -1))),
    ("gas-as-linear", "option", "linear in place of ideal/gas", gas(as_style("linear"))),
    ("A3-off", "constant", "A3 times 1 + 1e-6", entry("cubic", times("A3", TINY))),
    ("A3-sign", "sign", "A3 of the other sign", entry("cubic", times("A3", -1))),
    ("A3-zero", "missing term", "A3 of 0", entry("cubic", put(A3=0.0))),
    ("cubic-as-linear", "option", "linear in place of cubic", entry("cubic", as_style("linear"))),
    ("cubic-as-tait", "option", "tait/water in place of cubic", entry("cubic", as_style("tait/water"))),
    ("water-as-linear", "option", "linear in place of tait/water", water(as_style("linear"))),
    (
        *("water-of-7.15", "exponent", "tait/general with 7.15 in place of tait/water"),
        water(as_style("tait/general", gamma=7.15)),
    ),
    ("general-as-water", "option", "tait/water for tait/general", tait(as_style("tait/water"))),
    ("linear-as-water", "option", "tait/water in place of linear", entry("linear", as_style("tait/water"))),
    ("linear-as-cubic", "option", "cubic, A3 1e-3, for linear", entry("linear", as_style("cubic", A3=1e-3))),
    ("P_b-off", "constant", "background times 1 + 1e-6", entry("background", times("P_b", TINY))),
    ("P_b-sign", "sign", "background of the other sign", entry("background", times("P_b", -1))),
    ("P_b-twice", "constant", "background doubled", entry("background", times("P_b", 2))),
    ("P_b-dropped", "missing term", "background left out", entry("background", dropped)),
    ("P_b-everywhere", "type range", "background of some types given to all", entry("background", put(types="*"))),
    # --- type ranges, entries
    ("range-ends-early", "type range", "m*(n-1) in place of m*n", type_range(lambda m, n: (m, _one_less(n)))),
    ("range-ends-late", "type range", "m* in place of m*n", type_range(lambda m, n: (m, ""))),
    ("range-begins-late", "type range", "(m+1)* in place of m*", type_range(lambda m, n: (str(int(m or 1) + 1), n))),
    ("range-begins-early", "type range", "*n in place of m*n", type_range(lambda m, n: ("", n))),
    ("range-of-first", "type range", "m in place of m*n", laws(lambda w: {"types": w.types.partition("*")[0] or "1"})),
    ("single-types-exchanged", "exchanged", "1 in place of 2 and the reverse in ranges", laws(_other_single)),
    ("entries-reversed", "exchanged", "entries of fix rheo/pressure in reverse", entries(lambda e: e[::-1])),
    ("entries-rotated", "exchanged", "first entry of fix rheo/pressure last", entries(lambda e: (*e[1:], e[0]))),
    ("last-entry-dropped", "missing term", "last entry left out", entries(lambda e: e[:-1] or e)),
    ("first-entry-for-all", "type range", "first law for all types", entries(lambda e: only(0, put(types="*"))(e)[:1])),
    # --- kernel
    ("cut-off", "constant", "cutoff times 1 + 1e-6", cut(TINY)),
    ("cut-larger", "constant", "cutoff 10 % larger", cut(1.1)),
    ("rk1-for-quintic", "option", "kernel RK1 in place of quintic", kernel("quintic", "RK1")),
    ("quintic-for-rk0", "option", "kernel quintic in place of RK0", kernel("RK0", "quintic")),
    ("quintic-for-rk1", "option", "kernel quintic in place of RK1", kernel("RK1", "quintic")),
    ("rk2-for-rk1", "option", "kernel RK2 in place of RK1", kernel("RK1", "RK2")),
    ("rk1-for-rk2", "option", "kernel RK1 in place of RK2", kernel("RK2", "RK1")),
    ("zmin-above-all", "neighbours", "zmin that no particle reaches", rheo(put(zmin=500))),
    ("zmin-larger", "neighbours", "zmin larger by 3", rheo(lambda r: {"zmin": r.zmin + 3 if r.zmin else 0})),
    # --- options of fix rheo
    ("rho-sum-dropped", "option", "rho/sum left out", rheo(put(rho_sum=False))),
    ("rho-sum-added", "option", "rho/sum although densities are given", rheo(put(rho_sum=True))),
    ("interface-dropped", "option", "interface/reconstruct left out", rheo(put(interface_reconstruct=False))),
    ("interface-added", "option", "interface/reconstruct added", rheo(put(interface_reconstruct=True))),
    ("surface-dropped", "option", "surface/detection left out", rheo(put(surface_detection=None))),
    ("surface-style", "option", "the other style of surface/detection", surface(_other_surface)),
    ("surface-limit", "constant", "limit of surface/detection 10 % lower", surface(_lower_limit)),
    ("surface-splash", "constant", "splash limit larger by 4", surface(plus("splash", 4))),
    ("shift-dropped", "option", "shift left out", rheo(put(shift=False))),
    ("shift-added", "option", "shift added", rheo(lambda r: {"shift": True} if r.shift is False else {})),
    ("exclude-dropped", "type range", "exclude/type left out", excluding()),
    ("exclude-other", "type range", "exclude/type of type 1 in place of 2", excluding("1")),
    ("exclude-all", "type range", "exclude/type of all types", excluding("*")),
    (
        *("shiftscale", "constant", "shiftscale of scale/cross/type larger by 0.1"),
        cross_type(lambda s, c, w: (s + 0.1, c, w)),
    ),
    ("shift-cmin", "constant", "cmin of scale/cross/type tripled", cross_type(lambda s, c, w: (s, 3 * c, w))),
    ("shift-wmin", "constant", "wmin of scale/cross/type larger by 0.2", cross_type(lambda s, c, w: (s, c, w + 0.2))),
    (
        *("cross-type-dropped", "missing term", "scale/cross/type left out"),
        rheo(lambda r: {"shift": True} if r.shift else {}),
    ),
    # --- pair rheo
    ("artificial-off", "constant", "artificial viscosity times 1 + 1e-6", pair(times("artificial_visc", TINY))),
    ("artificial-dropped", "missing term", "artificial viscosity left out", pair(put(artificial_visc=0.0))),
    ("artificial-added", "option", "artificial viscosity 0.1 added", pair(put_if_unset(artificial_visc=0.1))),
    ("damp-off", "constant", "rho/damp times 1 + 1e-6", pair(times("rho_damp", TINY))),
    ("damp-dropped", "missing term", "rho/damp left out", pair(put(rho_damp=0.0))),
    ("damp-added", "option", "rho/damp 0.05 added", pair(put_if_unset(rho_damp=0.05))),
    (
        *("other-mean", "option", "harmonic for arithmetic means, and the reverse"),
        pair(lambda p: {"harmonic_means": not p.harmonic_means}),
    ),
    (
        *("other-two-terms", "exchanged", "coefficients of artificial viscosity and rho/damp exchanged"),
        pair(exchanged("artificial_visc", "rho_damp")),
    ),
    # --- viscosity
    ("eta-off", "constant", "constant viscosities times 1 + 1e-6", types(times("viscosity", TINY))),
    ("eta-zero", "missing term", "constant viscosities 0", types(times("viscosity", 0.0))),
    ("eta-exchanged", "exchanged", "viscosities of the types exchanged", rotated("viscosity")),
    ("power-eta", "constant", "eta of power times 1 + 1e-6", power(times("eta", TINY))),
    ("power-gd0", "constant", "gd0 of power times 1 + 1e-6", power(times("gd0", TINY))),
    ("power-K", "constant", "K of power times 1 + 1e-6", power(times("K", TINY))),
    ("power-n", "exponent", "n of power times 1 + 1e-6", power(times("n", TINY))),
    ("power-n-less-one", "exponent", "n - 1 given for n of power", power(plus("n", -1))),
    ("power-K-and-eta", "exchanged", "K and eta of power exchanged", power(exchanged("K", "eta"))),
    ("power-as-constant", "option", "constant in place of power", power(lambda law: law.eta)),
    # --- heat
    ("kappa-off", "constant", "conductivities times 1 + 1e-6", types(times("conductivity", TINY))),
    ("kappa-exchanged", "exchanged", "conductivities of the types exchanged", rotated("conductivity")),
    ("cv-off", "constant", "specific heats times 1 + 1e-6", types(times("specific_heat", TINY))),
    ("cv-exchanged", "exchanged", "specific heats of the types exchanged", rotated("specific_heat")),
    (
        *("cv-and-kappa", "exchanged", "conductivity given as specific heat and the reverse"),
        types(exchanged("specific_heat", "conductivity")),
    ),
    ("latent-off", "constant", "latent heats times 1 + 1e-6", types(times("latent_heat", TINY))),
    ("latent-zero", "missing term", "latent heats 0", types(times("latent_heat", 0.0))),
    ("freezing-off", "constant", "freezing temperatures 10 % higher", types(times("T_freeze", 1.1))),
    ("freezing-of-zero", "constant", "freezing temperatures 0", types(times("T_freeze", 0.0))),
    (
        *("freezing-dropped", "missing term", "latent heat and freezing left out"),
        types(lambda t: {} if t.T_freeze is None else {"latent_heat": None, "T_freeze": None}),
    ),
    # --- forces
    ("gravity-dropped", "missing term", "gravity left out", gravity(dropped)),
    ("gravity-sign", "sign", "gravity of the other sign", gravity(opposite)),
    ("gravity-off", "constant", "gravity times 1 + 1e-6", gravity(vector(lambda v: v * TINY))),
    ("gravity-as-force", "volume or mass", "addforce of the vector of gravity", gravity(put(style="addforce"))),
    ("addforce-dropped", "missing term", "addforce left out", addforce(dropped)),
    ("addforce-sign", "sign", "addforce of the other sign", addforce(opposite)),
    ("addforce-as-gravity", "volume or mass", "gravity in place of addforce", addforce(put(style="gravity"))),
    ("addforce-for-all", "type range", "addforce of some types on all", addforce(put(types=None))),
    ("force-axes", "exchanged", "components of gravity exchanged", gravity(lambda f: {"vector": f.vector[::-1]})),
    ("setforce-dropped", "missing term", "setforce left out", setforce(dropped)),
    (
        *("setforce-other", "type range", "setforce on type 1 in place of 2"),
        setforce(lambda f: {"types": "1" if f.types == "2" else "2"}),
    ),
    (
        *("setforce-whole", "missing term", "setforce of all axes for one"),
        setforce(lambda f: {"vector": tuple(v or 0.0 for v in f.vector)}),
    ),
    (
        *("forces-reversed", "order of operations", "forces of other fixes in reverse order"),
        altered("forces", lambda f: f[::-1]),
    ),
    # --- time steps
    ("timestep-off", "constant", "time step times 1 + 1e-6", evolve(times("timestep", TINY))),
    ("timestep-halved", "constant", "time step halved", evolve(times("timestep", 0.5))),
    (
        *("one-step-more", "constant", "one step more at the end"),
        evolve(lambda e: {"steps": e.steps + 1, "compare_at": (*e.snapshots[:-1], e.steps + 1)}),
    ),
    # --- the rest of a scene
    ("units-real", "units", "units real in place of lj", altered("units", lambda u: "real" if u == "lj" else u)),
    ("units-metal", "units", "units metal in place of lj", altered("units", lambda u: "metal" if u == "lj" else u)),
    ("phase-fluid", "option", "solid types taken for fluid", types(put(phase="fluid"))),
    ("phase-exchanged", "exchanged", "phases of the types exchanged", rotated("phase")),
    (
        *("refusal-not-asked", "option", "a scene to be refused without the broken rule"),
        altered("violate", lambda _: None),
    ),
)
FAULTS = tuple(InputFault(f"told.{name}", kind, what, change) for name, kind, what, change in _TABLE)
