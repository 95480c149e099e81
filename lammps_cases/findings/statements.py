"""Findings about sentences of the two pages: what follows from one, as a number that a small deck measures, is not so.

The reference computes what LAMMPS does, as published or for want of another definition: it is the sentence that is
wrong, or does not say all.
"""

from __future__ import annotations

from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.entry import Finding

# The versions that were seen to have them: no case shows them, so that no accepted run does.
WHEELS = ("2025.7.22.0.1", "2025.7.22.0.2", "2025.7.22.1.0", "2025.7.22.2.0", "2025.7.22.4.0")
NEWER = ("2026.7.4",)


def corrects_nothing(problem: Problem) -> bool:
    """Return whether sums of a reproducing kernel are those of the quintic spline."""
    fix = problem.model.fix
    return fix.kernel == "RK0" or (problem.model.corrects_gradients and fix.rho_sum)


def pulls_walls(problem: Problem) -> bool:
    """Return whether solids are reconstructed beside fluid of less than its equilibrium density."""
    state, model = problem.state, problem.model
    rare_n = (state.rho_n < model.rho0[state.type_n - 1]) & ~state.solid_n
    return model.fix.interface_reconstruct and bool(state.solid_n.any() and rare_n.any())


def sums_solids(problem: Problem) -> bool:
    """Return whether the densities of solids are summed, which should stay as they are."""
    fix = problem.model.fix
    return fix.rho_sum and not fix.interface_reconstruct and bool(problem.state.solid_n.any())


KERNEL_CORRECTS_GRADIENTS_ONLY = Finding(
    id="kernel-corrects-gradients-only",
    number=40,
    title="Reproducing kernels correct only gradients, so RK0 is the quintic kernel",
    severity="medium",
    effect="RK0 corrects nothing, and summed densities at surfaces stay uncorrected with every kernel",
    documented="fix rheo: RK0, RK1 and RK2 are zeroth, first, and second order reproducing; rho/sum: W_ij is the "
    "kernel, whose type kstyle specifies.",
    observed="With RK0 every output is bit-identical to that of the quintic kernel. With RK1 and RK2 gradients are "
    "corrected; sums of W, such as those of rho/sum, use the quintic kernel.",
    argument="A kernel that reproduces constants exerts no force where the pressure is constant, and returns a "
    "constant density when it sums masses. In a block of 49 disordered particles forces exceed 2 with RK0, while RK1 "
    "has none beyond 1e-13, and summed densities miss 1.2 by 0.496 with any of the three.",
    workaround="Use RK1 for gradients, and leave out rho/sum where the support is incomplete.",
    acts=lambda setting: corrects_nothing(setting.problem),
    engines=WHEELS + NEWER,
    applies_to=("probes.order-zero.rk0", "probes.order-zero-3d.rk0", "probes.sum-of-constant.*"),
    outcome="differs",
    ended="answered",
    differing="error of a constant field",
)


NO_MASS_DIFFUSION = Finding(
    id="no-mass-diffusion",
    number=41,
    title="Densities follow an equation of continuity, not a diffusion equation",
    severity="low",
    effect="Densities of neighbours do not even out unless rho/damp is given",
    documented="fix rheo: by default, RHEO integrates particles' densities using a mass diffusion equation.",
    observed="Densities change by -rho div v. In a fluid at rest they do not change at all unless rho/damp of pair "
    "rheo is given.",
    argument="In a fluid at rest a density profile loses nothing but rounding in 20 steps; a mass diffusion equation "
    "makes every profile decay, and with rho/damp 0.1 it loses 1.36 %.",
    workaround="Use rho/damp of pair rheo where diffusion is wanted.",
    engines=WHEELS + NEWER,
    applies_to=("probes.density-diffuses",),
    outcome="differs",
    ended="answered",
    differing="part of a density profile that has diffused",
)


BONDS_ACROSS_BOUNDARY = Finding(
    id="bonds-across-boundary",
    number=68,
    title="Bonds created by react across a periodic boundary are missing or counted twice",
    severity="medium",
    effect="Solids that freeze across a periodic boundary do not hold together, or the number of bonds is wrong",
    documented="fix rheo/thermal, react: bonds are created between nearby solid particles, and broken as they "
    "melt; thermo_style: bonds is the number of these interactions.",
    observed="The two oldest versions create no bonds across a periodic boundary, and the keyword bonds of "
    "thermo_style stays 0. Later ones create them, and the keyword counts each of them twice, while compute "
    "property/local lists it once. As particles melt, all bonds disappear.",
    argument="Three rows of 9 particles that freeze, periodic along x, have 27 + 18 = 45 bonds with their neighbours. "
    "In the two oldest versions compute property/local lists 42, as many as with fixed faces; later it lists 45, and "
    "thermo_style prints 48, one more for every row.",
    acts=lambda setting: setting.reacts and any(setting.problem.box.periodic),
    workaround="Keep freezing particles away from periodic boundaries, or use a later version and count with compute "
    "property/local and compute reduce ('inputs local').",
    engines=WHEELS + NEWER,
    applies_to=("probes.thermal-react-count",),
    outcome="differs",
    ended="answered",
    differing="number of bonds",
)


SOLIDS_SUMMED = Finding(
    id="solids-summed",
    number=42,
    title="With rho/sum, the densities of solids are summed as well",
    severity="medium",
    effect="Solids do not keep the density they were given",
    documented="fix rheo: by default (without interface/reconstruct), the density of solid RHEO particles does not "
    "evolve.",
    observed="With rho/sum and without interface/reconstruct the densities of solids are also sums, in every step.",
    argument="A solid particle of density 0.8 below a fluid one of mass 1 (2D, distance 1, cutoff 3) has the density "
    "0.429 after the set-up, and by a linear law with rho0 = 1 and c = 2 the pressure -2.285 instead of -0.8: a wall "
    "thinner than the cutoff attracts fluid, whatever density it was given.",
    acts=lambda setting: sums_solids(setting.problem),
    workaround="Leave out rho/sum; or use interface/reconstruct, with which no force is that of the sum.",
    engines=WHEELS + NEWER,
    applies_to=("probes.solid-density-summed",),
    outcome="differs",
    ended="answered",
    differing="density of a solid",
)


WALL_DENSITY_STORED = Finding(
    id="wall-density-stored",
    number=43,
    title="The density stored for a reconstructed solid is neither temporary nor kept above rho0",
    severity="low",
    effect="Densities of solids in the output are not those used for the forces",
    documented="fix rheo, interface/reconstruct: a temporary apparent density is calculated for a solid; it cannot be "
    "less than the equilibrium density.",
    observed="The reconstructed density overwrites the solid's own, with another limit, a tenth of rho0: that of rho0 "
    "is applied only where forces use the density.",
    argument="A solid of density 1.7 beside a fluid of 1.2 has 1.2 from then on, even without the keyword. Beside a "
    "fluid of 0.8 it reports 0.8 and the corresponding pressure, where 1 and the pressure 0 act; beside one of 0.05 it "
    "reports 0.1 (rho0 = 1).",
    acts=lambda setting: pulls_walls(setting.problem),
    workaround="Set the densities of solids again before a run without the keyword; in output use the larger of the "
    "density and rho0.",
    engines=WHEELS + NEWER,
    applies_to=("probes.solid-density-floor", "probes.solid-density-temporary"),
    outcome="differs",
    ended="answered",
    differing="density of a solid",
)


WALLS_ATTRACT = Finding(
    id="walls-attract",
    number=44,
    title="The limit on a solid's density does not keep fluid from sticking to it",
    severity="low",
    effect="Fluid below its equilibrium density sticks to walls",
    documented="fix rheo, interface/reconstruct: the reconstructed density cannot be less than the equilibrium "
    "density; this prevents fluid particles from sticking to solid surfaces.",
    observed="A fluid particle below its equilibrium density is attracted to a solid with the limit as well as "
    "without it, though with less force.",
    argument="The force of a pair is proportional to the sum of both pressures. With the density 0.8 (linear law, "
    "rho0 = 1, c = 2) the fluid has -0.8 and the solid, by the limit, 0: the sum is negative, half of what it is "
    "without the limit.",
    acts=lambda setting: pulls_walls(setting.problem),
    workaround="Add a background pressure that keeps the fluid's pressure above 0.",
    engines=WHEELS + NEWER,
    applies_to=("probes.walls-do-not-attract",),
    outcome="differs",
    ended="answered",
    differing="attraction by a solid",
)


GAS_WITHOUT_WORK = Finding(
    id="gas-without-work",
    number=45,
    title="Compression does no work on an ideal gas, so gamma is not its heat capacity ratio",
    severity="medium",
    effect="Sound in an ideal gas is too slow by a factor of sqrt(gamma); compression does not heat the gas",
    documented="fix rheo/pressure: P = (gamma - 1) rho e, where gamma is the heat capacity ratio and e the internal "
    "energy per unit mass.",
    observed="Energies change only by conduction. Sound travels at sqrt((gamma - 1) e), the isothermal speed.",
    argument="In a gas that conducts no heat, sound travels at sqrt(gamma P/rho): 3.35 for gamma = 1.4 and e = 20. "
    "LAMMPS' wave has 2.84, like that of a gas with a heat capacity ratio of 1; gamma is merely a factor in the "
    "pressure.",
    acts=lambda setting: setting.problem.model.eos.needs_energy,
    workaround="Treat the style as an isothermal gas of pressure (gamma - 1) rho e.",
    engines=WHEELS + NEWER,
    applies_to=("probes.sound-gas-adiabatic",),
    outcome="differs",
    ended="answered",
    differing="adiabatic speed of sound",
)


SUM_INCLUDES_SELF = Finding(
    id="sum-includes-self",
    number=46,
    title="The formula of rho/sum omits the particle itself",
    severity="low",
    effect="Densities computed from the formula are too low by the particle's own term",
    documented="fix rheo, rho/sum: the density is the sum over neighbors, sum_j W_ij M_j.",
    observed="The sum includes the particle's own term as well, W(0) times its mass.",
    argument="By the formula a particle without neighbours has no density; LAMMPS has 0.308 for the mass 1 and the "
    "cutoff 3 in 2D, which is W(0). LAMMPS is right: without this term densities would be too low by that much. The "
    "number of neighbours on the same page, zmin, does not count the particle itself.",
    workaround="Read the sum as including j = i.",
    engines=WHEELS + NEWER,
    applies_to=("probes.sum-of-neighbours",),
    outcome="differs",
    ended="answered",
    differing="density of a lone particle",
)


RMIN_UNIT = Finding(
    id="rmin-unit",
    number=47,
    title="The threshold rmin has a unit, although the syntax calls it unitless",
    severity="low",
    effect="In a rescaled scene the shift is turned off for other particles",
    documented="fix rheo, syntax: rmin = minimum local same-type weighted distance (unitless).",
    observed="Since 2026.7.4 the threshold is called rmin. In a fluid of twice the size, with everything else "
    "scaled, the same rmin turns off the shift of other particles.",
    argument="By the formula on the same page, rmin is compared with sum r W, which has the unit 1/length in 2D and "
    "1/length^2 in 3D: it is neither dimensionless nor a distance.",
    workaround="When all lengths grow by a factor s, divide rmin by s in 2D and by s^2 in 3D.",
    engines=NEWER,
    applies_to=("probes.rheo-unit-rmin",),
    outcome="differs",
    ended="answered",
    differing="q",
)


GAS_ON_OTHER_ATOMS = Finding(
    id="gas-on-other-atoms",
    number=48,
    title="ideal/gas works with atoms that are not of style rheo/thermal",
    severity="low",
    effect="None: more atom styles work than the manual says",
    documented="fix rheo/pressure: ideal/gas is only compatible with atom style rheo/thermal.",
    observed="On atoms of style 'hybrid rheo sph' ideal/gas is accepted, and gives (gamma - 1) rho e.",
    argument="The style needs the energy of a particle, which atoms of style sph also have: LAMMPS requires this "
    "energy ('requires atom property esph'), not the style.",
    workaround="None is needed; with rheo/thermal the manual is right.",
    engines=WHEELS,
    applies_to=("probes.pressure-gas-hybrid",),
    outcome="differs",
    ended="accepted",
)


RESPA_REFUSED = Finding(
    id="respa-refused",
    number=49,
    title="With run_style respa, fix rheo reports that another fix is missing",
    severity="low",
    effect="The error message names a fix that is present",
    documented="fix rheo, Restrictions: no mention of run_style; pair rheo: this style can be used via the pair "
    "keyword of run_style respa.",
    observed="'run_style respa 2 2 pair 1' is refused: 'Missing fix rheo/viscosity', although the fix is defined.",
    argument="The fix named by the message is defined in the script, and no page excludes the run style: the page "
    "lacks a restriction, and the message names another one.",
    workaround="Use run_style verlet, the default.",
    engines=WHEELS + NEWER,
    applies_to=("probes.rheo-respa",),
    outcome="refused",
    engine_error="Missing fix rheo/viscosity",
)


PAIR_CUTOFF_UNSAID = Finding(
    id="pair-cutoff-unsaid",
    number=50,
    title="No page says that pair rheo needs the cutoff of fix rheo",
    severity="low",
    effect="An undocumented rule causes the run to be refused",
    documented="fix rheo, Restrictions, and pair rheo: no mention of the other one's cutoff.",
    observed="'pair_style rheo 2.9' with the cutoff 3 of fix rheo is refused: 'Pair rheo cutoff 2.9 does not agree "
    "with fix rheo cutoff 3'.",
    argument="A kernel has one cutoff, so LAMMPS is right to refuse: the pages lack the restriction.",
    workaround="Give both the same cutoff.",
    engines=WHEELS + NEWER,
    applies_to=("probes.rheo-cut-of-pair",),
    outcome="refused",
    engine_error="does not agree with fix rheo cutoff",
)


PRESSURE_TAKES_ONE_RANGE = Finding(
    id="pressure-takes-one-range",
    number=51,
    title="fix rheo/pressure takes one range of types for a law, not a list",
    severity="low",
    effect="A command written according to the syntax is refused",
    documented="fix rheo/pressure, syntax: types = lists of types.",
    observed="'1,2 linear' is refused ('Invalid range string: 1,2'), as is '1 2 linear' ('Illegal fix command').",
    argument="No range contains just types 1 and 3 of three, and no list gives them a law together.",
    workaround="Give the law separately for each type: '1 linear 2 linear'.",
    engines=WHEELS + NEWER,
    applies_to=("probes.pressure-types-list",),
    outcome="refused",
    engine_error="Invalid range string: 1,2",
)


WALL_DENSITY_SHARED = Finding(
    id="wall-density-shared",
    number=52,
    title="A reconstructed solid has one density for all fluid particles around it",
    severity="low",
    effect="A thin wall between two fluids has one density for both",
    documented="fix rheo, interface/reconstruct: the density and velocity of solid particles are reconstructed for "
    "every fluid-solid interaction.",
    observed="Velocities are reconstructed for every pair; the density of a solid is a single mean over its fluid "
    "neighbours, as published (Adami et al. 2012).",
    argument="A fluid particle on one side of a solid feels the pressure of a particle on the other side, 4 away "
    "with a cutoff of 3: the force of the solid grows by 2/13 when the density there rises from 1.2 to 1.4 "
    "(rho0 = 1).",
    workaround="Make walls between two fluids at least as thick as two cutoffs.",
    engines=WHEELS + NEWER,
    applies_to=("probes.solid-density-of-every-pair",),
    outcome="differs",
    ended="answered",
    differing="force of a solid on a fluid particle",
)

ENTRIES = (
    KERNEL_CORRECTS_GRADIENTS_ONLY,
    NO_MASS_DIFFUSION,
    BONDS_ACROSS_BOUNDARY,
    SOLIDS_SUMMED,
    WALL_DENSITY_STORED,
    WALLS_ATTRACT,
    GAS_WITHOUT_WORK,
    SUM_INCLUDES_SELF,
    RMIN_UNIT,
    GAS_ON_OTHER_ATOMS,
    RESPA_REFUSED,
    PAIR_CUTOFF_UNSAID,
    PRESSURE_TAKES_ONE_RANGE,
    WALL_DENSITY_SHARED,
)
