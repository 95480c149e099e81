"""Faults in LAMMPS' input: options, materials, forces and time steps of the particle model."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lammps_cases.scene import AtomType, ForceSettings, PowerLaw, RheoSettings, Scene
from lammps_cases.scene.settings import Evolve, PairSettings, ShiftSettings, SurfaceDetectionSettings
from lammps_cases.studies.mutation.fault import Kind
from lammps_cases.studies.mutation.input_faults import InputFault, SceneChange
from lammps_cases.studies.mutation.input_faults_laws import TINY, dealt_on, scaled, types

Changes = dict[str, Any]


def rheo(change: Callable[[RheoSettings], Changes]) -> SceneChange:
    """Options of fix rheo changed."""
    return lambda scene: scene.model_copy(update={"rheo": scene.rheo.model_copy(update=change(scene.rheo))})


def _kernel(old: str, new: str) -> SceneChange:
    return rheo(lambda r: {"kernel": new} if r.kernel == old else {})


def _surface(change: Callable[[SurfaceDetectionSettings], Changes]) -> SceneChange:
    def of(r: RheoSettings) -> Changes:
        found = r.surface_detection
        return {} if found is None else {"surface_detection": found.model_copy(update=change(found))}

    return rheo(of)


def _cross_type(change: Callable[[float, float, float], tuple[float, float, float]]) -> SceneChange:
    def of(r: RheoSettings) -> Changes:
        if r.shifting is None or r.shifting.scale_cross_type is None:
            return {}
        numbers = change(*r.shifting.scale_cross_type)
        return {"shift": r.shifting.model_copy(update={"scale_cross_type": numbers})}

    return rheo(of)


def _excluding(change: Callable[[tuple[str, ...]], tuple[str, ...]]) -> SceneChange:
    def of(r: RheoSettings) -> Changes:
        if r.shifting is None or not r.shifting.exclude:
            return {}
        return {"shift": ShiftSettings(exclude=change(r.shifting.exclude))}

    return rheo(of)


def _pair(change: Callable[[PairSettings], Changes]) -> SceneChange:
    return lambda scene: scene.model_copy(update={"pair": scene.pair.model_copy(update=change(scene.pair))})


def _power(change: Callable[[PowerLaw], Any]) -> SceneChange:
    """Power-law viscosities changed; a number in place of the law makes it constant."""

    def of(t: AtomType) -> Changes:
        if not isinstance(t.viscosity, PowerLaw):
            return {}
        new = change(t.viscosity)
        return {"viscosity": t.viscosity.model_copy(update=new) if isinstance(new, dict) else new}

    return types(of)


def _times(name: str, factor: float) -> Callable[[PowerLaw], Changes]:
    return lambda law: {name: getattr(law, name) * factor}


def _forces(change: Callable[[tuple[ForceSettings, ...]], tuple[ForceSettings, ...]]) -> SceneChange:
    return lambda scene: scene.model_copy(update={"forces": change(scene.forces)})


def _each_force(style: str, change: Callable[[ForceSettings], Changes | None]) -> SceneChange:
    def of(forces: tuple[ForceSettings, ...]) -> tuple[ForceSettings, ...]:
        changes = [(force, change(force) if force.style == style else {}) for force in forces]
        return tuple(force.model_copy(update=new) for force, new in changes if new is not None)

    return _forces(of)


def _vector(change: Callable[[float], float]) -> Callable[[ForceSettings], Changes]:
    return lambda force: {"vector": tuple(None if v is None else change(v) for v in force.vector)}


def _evolve(change: Callable[[Evolve], Changes]) -> SceneChange:
    def change_scene(scene: Scene) -> Scene:
        if scene.evolve is None:
            return scene
        return scene.model_copy(update={"evolve": scene.evolve.model_copy(update=change(scene.evolve))})

    return change_scene


def _cut(factor: float) -> SceneChange:
    def change_scene(scene: Scene) -> Scene:
        spacing = getattr(scene.positions, "spacing", None)
        cut = scene.rheo.cut or (3.0 * spacing if spacing else None)
        if cut is None or not scene.interacts:
            return scene
        return scene.model_copy(update={"rheo": scene.rheo.model_copy(update={"cut": cut * factor})})

    return change_scene


def _latent(change: Callable[[float], float | None]) -> SceneChange:
    return types(lambda t: {} if t.latent_heat is None else {"latent_heat": change(t.latent_heat)})


def _freezing(change: Callable[[float], float]) -> SceneChange:
    return types(lambda t: {} if t.T_freeze is None else {"T_freeze": change(t.T_freeze)})


def _lower(surface: SurfaceDetectionSettings) -> float:
    lower = 0.9 * surface.limit
    return lower if surface.style == "divergence" else float(int(lower))


def _fault(name: str, kind: Kind, what: str, change_scene: SceneChange) -> InputFault:
    return InputFault(f"told.{name}", kind, what, change_scene)


FAULTS = (
    # --- kernel
    _fault("cut-off", "constant", "cutoff times 1 + 1e-6", _cut(TINY)),
    _fault("cut-larger", "constant", "cutoff 10 % larger", _cut(1.1)),
    _fault("rk1-for-quintic", "option", "kernel RK1 in place of quintic", _kernel("quintic", "RK1")),
    _fault("quintic-for-rk0", "option", "kernel quintic in place of RK0", _kernel("RK0", "quintic")),
    _fault("quintic-for-rk1", "option", "kernel quintic in place of RK1", _kernel("RK1", "quintic")),
    _fault("rk2-for-rk1", "option", "kernel RK2 in place of RK1", _kernel("RK1", "RK2")),
    _fault("rk1-for-rk2", "option", "kernel RK1 in place of RK2", _kernel("RK2", "RK1")),
    _fault("zmin-above-all", "neighbours", "zmin that no particle reaches", rheo(lambda r: {"zmin": 500})),
    _fault("zmin-larger", "neighbours", "zmin larger by 3", rheo(lambda r: {"zmin": r.zmin + 3 if r.zmin else 0})),
    # --- options of fix rheo
    _fault("rho-sum-dropped", "option", "rho/sum left out", rheo(lambda r: {"rho_sum": False})),
    _fault("rho-sum-added", "option", "rho/sum although densities are given", rheo(lambda r: {"rho_sum": True})),
    _fault(
        "interface-dropped",
        "option",
        "interface/reconstruct left out",
        rheo(lambda r: {"interface_reconstruct": False}),
    ),
    _fault("interface-added", "option", "interface/reconstruct added", rheo(lambda r: {"interface_reconstruct": True})),
    _fault("surface-dropped", "option", "surface/detection left out", rheo(lambda r: {"surface_detection": None})),
    _fault(
        "surface-style",
        "option",
        "the other style of surface/detection",
        _surface(
            lambda s: {
                "style": "divergence" if s.style == "coordination" else "coordination",
                "limit": 1.5 if s.style == "coordination" else 20.0,
            }
        ),
    ),
    _fault(
        "surface-limit", "constant", "limit of surface/detection 10 % lower", _surface(lambda s: {"limit": _lower(s)})
    ),
    _fault("surface-splash", "constant", "splash limit larger by 4", _surface(lambda s: {"splash": s.splash + 4})),
    _fault("shift-dropped", "option", "shift left out", rheo(lambda r: {"shift": False})),
    _fault("shift-added", "option", "shift added", rheo(lambda r: {"shift": True} if r.shift is False else {})),
    _fault("exclude-dropped", "type range", "exclude/type left out", _excluding(lambda e: ())),
    _fault("exclude-other", "type range", "exclude/type of type 1 in place of 2", _excluding(lambda e: ("1",))),
    _fault("exclude-all", "type range", "exclude/type of all types", _excluding(lambda e: ("*",))),
    _fault(
        "shiftscale",
        "constant",
        "shiftscale of scale/cross/type larger by 0.1",
        _cross_type(lambda s, c, w: (s + 0.1, c, w)),
    ),
    _fault("shift-cmin", "constant", "cmin of scale/cross/type tripled", _cross_type(lambda s, c, w: (s, 3 * c, w))),
    _fault(
        "shift-wmin", "constant", "wmin of scale/cross/type larger by 0.2", _cross_type(lambda s, c, w: (s, c, w + 0.2))
    ),
    _fault(
        "cross-type-dropped",
        "missing term",
        "scale/cross/type left out",
        rheo(lambda r: {"shift": True} if r.shift else {}),
    ),
    # --- pair rheo
    _fault(
        "artificial-off",
        "constant",
        "artificial viscosity times 1 + 1e-6",
        _pair(lambda p: {"artificial_visc": p.artificial_visc * TINY}),
    ),
    _fault(
        "artificial-dropped", "missing term", "artificial viscosity left out", _pair(lambda p: {"artificial_visc": 0.0})
    ),
    _fault(
        "artificial-added",
        "option",
        "artificial viscosity 0.1 added",
        _pair(lambda p: {"artificial_visc": p.artificial_visc or 0.1}),
    ),
    _fault("damp-off", "constant", "rho/damp times 1 + 1e-6", _pair(lambda p: {"rho_damp": p.rho_damp * TINY})),
    _fault("damp-dropped", "missing term", "rho/damp left out", _pair(lambda p: {"rho_damp": 0.0})),
    _fault("damp-added", "option", "rho/damp 0.05 added", _pair(lambda p: {"rho_damp": p.rho_damp or 0.05})),
    _fault(
        "other-mean",
        "option",
        "harmonic for arithmetic means, and the reverse",
        _pair(lambda p: {"harmonic_means": not p.harmonic_means}),
    ),
    _fault(
        "other-two-terms",
        "exchanged",
        "coefficients of artificial viscosity and rho/damp exchanged",
        _pair(lambda p: {"artificial_visc": p.rho_damp, "rho_damp": p.artificial_visc}),
    ),
    # --- viscosity
    _fault("eta-off", "constant", "constant viscosities times 1 + 1e-6", scaled("viscosity", TINY)),
    _fault("eta-zero", "missing term", "constant viscosities 0", scaled("viscosity", 0.0)),
    _fault("eta-exchanged", "exchanged", "viscosities of the types exchanged", dealt_on("viscosity")),
    _fault("power-eta", "constant", "eta of power times 1 + 1e-6", _power(_times("eta", TINY))),
    _fault("power-gd0", "constant", "gd0 of power times 1 + 1e-6", _power(_times("gd0", TINY))),
    _fault("power-K", "constant", "K of power times 1 + 1e-6", _power(_times("K", TINY))),
    _fault("power-n", "exponent", "n of power times 1 + 1e-6", _power(_times("n", TINY))),
    _fault("power-n-less-one", "exponent", "n - 1 given for n of power", _power(lambda law: {"n": law.n - 1})),
    _fault(
        "power-K-and-eta", "exchanged", "K and eta of power exchanged", _power(lambda law: {"K": law.eta, "eta": law.K})
    ),
    _fault("power-as-constant", "option", "constant in place of power", _power(lambda law: law.eta)),
    # --- heat
    _fault("kappa-off", "constant", "conductivities times 1 + 1e-6", scaled("conductivity", TINY)),
    _fault("kappa-exchanged", "exchanged", "conductivities of the types exchanged", dealt_on("conductivity")),
    _fault("cv-off", "constant", "specific heats times 1 + 1e-6", scaled("specific_heat", TINY)),
    _fault("cv-exchanged", "exchanged", "specific heats of the types exchanged", dealt_on("specific_heat")),
    _fault(
        "cv-and-kappa",
        "exchanged",
        "conductivity given as specific heat and the reverse",
        types(lambda t: {"specific_heat": t.conductivity, "conductivity": t.specific_heat}),
    ),
    _fault("latent-off", "constant", "latent heats times 1 + 1e-6", _latent(lambda heat: heat * TINY)),
    _fault("latent-zero", "missing term", "latent heats 0", _latent(lambda heat: 0.0)),
    _fault("freezing-off", "constant", "freezing temperatures 10 % higher", _freezing(lambda T: 1.1 * T)),
    _fault("freezing-of-zero", "constant", "freezing temperatures 0", _freezing(lambda T: 0.0)),
    _fault(
        "freezing-dropped",
        "missing term",
        "latent heat and freezing left out",
        types(lambda t: {} if t.T_freeze is None else {"latent_heat": None, "T_freeze": None}),
    ),
    # --- forces
    _fault("gravity-dropped", "missing term", "gravity left out", _each_force("gravity", lambda f: None)),
    _fault("gravity-sign", "sign", "gravity of the other sign", _each_force("gravity", _vector(lambda v: -v))),
    _fault("gravity-off", "constant", "gravity times 1 + 1e-6", _each_force("gravity", _vector(lambda v: v * TINY))),
    _fault(
        "gravity-as-force",
        "volume or mass",
        "addforce of the vector of gravity",
        _each_force("gravity", lambda f: {"style": "addforce"}),
    ),
    _fault("addforce-dropped", "missing term", "addforce left out", _each_force("addforce", lambda f: None)),
    _fault("addforce-sign", "sign", "addforce of the other sign", _each_force("addforce", _vector(lambda v: -v))),
    _fault(
        "addforce-as-gravity",
        "volume or mass",
        "gravity in place of addforce",
        _each_force("addforce", lambda f: {"style": "gravity"}),
    ),
    _fault(
        "addforce-for-all",
        "type range",
        "addforce of some types on all",
        _each_force("addforce", lambda f: {"types": None}),
    ),
    _fault(
        "force-axes",
        "exchanged",
        "components of gravity exchanged",
        _each_force("gravity", lambda f: {"vector": f.vector[::-1]}),
    ),
    _fault("setforce-dropped", "missing term", "setforce left out", _each_force("setforce", lambda f: None)),
    _fault(
        "setforce-other",
        "type range",
        "setforce on type 1 in place of 2",
        _each_force("setforce", lambda f: {"types": "1" if f.types == "2" else "2"}),
    ),
    _fault(
        "setforce-whole",
        "missing term",
        "setforce of all axes for one",
        _each_force("setforce", lambda f: {"vector": tuple(v or 0.0 for v in f.vector)}),
    ),
    _fault(
        "forces-reversed", "order of operations", "forces of other fixes in reverse order", _forces(lambda f: f[::-1])
    ),
    # --- time steps
    _fault("timestep-off", "constant", "time step times 1 + 1e-6", _evolve(lambda e: {"timestep": e.timestep * TINY})),
    _fault("timestep-halved", "constant", "time step halved", _evolve(lambda e: {"timestep": e.timestep / 2})),
    _fault(
        "one-step-more",
        "constant",
        "one step more at the end",
        _evolve(lambda e: {"steps": e.steps + 1, "compare_at": (*e.snapshots[:-1], e.steps + 1)}),
    ),
    # --- the rest of a scene
    _fault(
        "units-real",
        "units",
        "units real in place of lj",
        lambda s: s.model_copy(update={"units": "real"}) if s.units == "lj" else s,
    ),
    _fault(
        "units-metal",
        "units",
        "units metal in place of lj",
        lambda s: s.model_copy(update={"units": "metal"}) if s.units == "lj" else s,
    ),
    _fault("phase-fluid", "option", "solid types taken for fluid", types(lambda t: {"phase": "fluid"})),
    _fault("phase-exchanged", "exchanged", "phases of the types exchanged", dealt_on("phase")),
    _fault(
        "refusal-not-asked",
        "option",
        "a scene to be refused told without the broken rule",
        lambda s: s.model_copy(update={"violate": None}),
    ),
)
