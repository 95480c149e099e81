"""Parser for the manual's command text: ``fix ID all rheo ...`` and ``fix ID all rheo/pressure ...``.

The grammar is that of the two manual pages. What they refuse, or what has no meaning (a speed of sound of 0),
is refused here with one line that says why.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, cast, get_args

from eos_ref.eos.registry import PARAMETER, STYLES
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.errors import InputError
from eos_ref.kernels.styles import KERNELS, KernelStyle
from eos_ref.syntax.manual import FIRST, Manual, weighs_distance
from eos_ref.syntax.ranges import type_range
from eos_ref.syntax.words import Words, fix

SurfaceStyle = Literal["coordination", "divergence"]


@dataclass(frozen=True)
class PressureEntry:
    """One ``types pstyle args`` group of fix rheo/pressure.

    Attributes
    ----------
    types : str
        Types as written (``*``, ``n``, ``*n``, ``m*``, ``m*n``).
    style : str
        A style of `eos_ref.STYLES`, or ``background``.
    value : float or None
        Its argument: A3, gamma or P_b.
    """

    types: str
    style: str
    value: float | None = None


@dataclass(frozen=True)
class SurfaceDetection:
    """Arguments of the surface/detection keyword.

    Both limits are compared with what cannot be negative: a number of neighbours, or the divergence of positions
    -sum_j V_j x_ij . grad W_ij, each term of which is positive as W falls with distance. A negative limit has no
    meaning; 0 is the limit that nothing falls below. A number of neighbours is whole.
    """

    style: SurfaceStyle
    limit: float
    splash: int

    def __post_init__(self) -> None:
        for what, limit in (("limit", self.limit), ("limit/splash", self.splash)):
            if not (math.isfinite(limit) and limit >= 0):
                raise InputError(f"{what} of surface/detection", "must not be negative", limit)
        if self.style == "coordination" and self.limit != int(self.limit):
            rule = "must be a whole number of neighbours for coordination"
            raise InputError("limit of surface/detection", rule, self.limit)


@dataclass(frozen=True)
class Shift:
    """Arguments of the shift keyword; ``scale_cross_type`` holds shiftscale, cmin, and wmin or rmin.

    The support of a particle by its own type is sum_j W_ij in the manual of 22 Jul 2025, compared with wmin (1/volume),
    and sum_j r_ij W_ij in that of 4 Jul 2026, compared with rmin (length/volume): ``weighs_distance``.

    shiftscale is the fraction of the shift that is left, by the manual 0 (none) to 1 (all). Color function and support
    are sums of what is not negative, so that a threshold below 0 has no meaning.
    """

    exclude_types: tuple[str, ...] = ()
    scale_cross_type: tuple[float, float, float] | None = None
    weighs_distance: bool = False

    def __post_init__(self) -> None:
        if self.scale_cross_type is None:
            return
        scale, cmin, support = self.scale_cross_type
        if not 0 <= scale <= 1:
            raise InputError("shiftscale", "must be a fraction, 0 to 1", scale)
        for what, threshold in (("cmin", cmin), ("rmin" if self.weighs_distance else "wmin", support)):
            if not (math.isfinite(threshold) and threshold >= 0):
                raise InputError(what, "must not be negative", threshold)


@dataclass(frozen=True)
class FixRheo:
    """Settings of fix rheo.

    Attributes
    ----------
    cut : float
        Cutoff of the kernel (distance).
    kernel : {"quintic", "RK0", "RK1", "RK2"}
    zmin : int
        Least number of neighbours for a reproducing kernel.
    rho0, cs : tuple of float or None
        Equilibrium density and speed of sound per type; None stands for the default, 1 for every type.
    """

    cut: float
    kernel: KernelStyle
    zmin: int
    thermal: bool = False
    interface_reconstruct: bool = False
    surface_detection: SurfaceDetection | None = None
    shift: Shift | None = None
    rho_sum: bool = False
    self_mass: bool = False
    rho0: tuple[float, ...] | None = None
    cs: tuple[float, ...] | None = None


def parse_fix_rheo_pressure(text: str) -> tuple[PressureEntry, ...]:
    """Read ``fix ID all rheo/pressure type1 pstyle1 args1 ...``.

    Returns
    -------
    tuple of PressureEntry
        In the order written; `resolve` turns them into one law per type.

    Raises
    ------
    InputError
        Not this command, group other than all, an unknown style, a missing or non-finite argument, no entry.

    Source: manual, fix rheo/pressure, syntax.
    """
    words = fix(text, "rheo/pressure")
    entries: list[PressureEntry] = []
    styles = (*STYLES, "background")
    while words.left or not entries:
        types = words.word("types and pressure style")
        type_range(types, 10**18, words.command)  # its form; `resolve` knows the number of types
        style = words.choice("pressure style", styles)
        name = PARAMETER.get(style)
        entries.append(PressureEntry(types, style, words.number(f"{name} of {style}") if name else None))
    return tuple(entries)


def resolve(
    entries: Sequence[PressureEntry],
    ntypes: int,
    rho0: Sequence[float] | None = None,
    cs: Sequence[float] | None = None,
    where: str = "",
) -> EOSTable:
    """Return one law per atom type; later entries override earlier ones, a background is kept with the law.

    Parameters
    ----------
    entries : sequence of PressureEntry
        In the order written.
    ntypes : int
        Number of atom types.
    rho0, cs : sequence of float, optional
        Per type, from fix rheo; 1 for every type by default.
    where : str, optional
        Place of the entries, for messages.

    Raises
    ------
    InputError
        A type without a law (a background alone is not one), a bad range, a bad parameter, or rho0 or cs not
        of one value per type.
    """
    for what, values in (("density", rho0), ("speed/sound", cs)):
        if values is not None and len(values) != ntypes:
            raise InputError(what, f"needs one value per atom type ({ntypes})", len(values), where)
    styles: dict[int, tuple[str, float | None]] = {}
    background: dict[int, float] = {}
    for entry in entries:
        for t in type_range(entry.types, ntypes, where):
            if entry.style == "background":
                if entry.value is None:
                    raise InputError("background", "needs the argument P_b", where=where)
                background[t] = entry.value
            else:
                styles[t] = entry.style, entry.value
    laws = []
    for t in range(1, ntypes + 1):
        if t not in styles:
            addition = " in addition to the background" if t in background else ""
            raise InputError(f"atom type {t}", f"needs an equation of state{addition}", where=where)
        style, value = styles[t]
        try:
            laws.append(
                EOS(
                    style,
                    1.0 if rho0 is None else rho0[t - 1],
                    1.0 if cs is None else cs[t - 1],
                    value,
                    background.get(t, 0.0),
                )
            )
        except InputError as error:
            raise error.at(f"{where}, atom type {t}" if where else f"atom type {t}") from None
    return EOSTable(tuple(laws))


Settings = dict[str, Any]  # attributes of FixRheo that a keyword sets


def _surface(words: Words, ntypes: int | None) -> Settings:
    style = cast(SurfaceStyle, words.choice("style of surface/detection", get_args(SurfaceStyle)))
    read = words.integer if style == "coordination" else words.number
    limit = read("limit of surface/detection")
    return {"surface_detection": SurfaceDetection(style, limit, words.integer("limit/splash of surface/detection"))}


def _shift(words: Words, ntypes: int | None) -> Settings:
    exclude: list[str] = []
    scale = None
    while words.peek() in ("exclude/type", "scale/cross/type"):
        if words.word("") == "exclude/type":
            exclude.append(words.word("types of exclude/type"))
            while words.peek()[:1].isdigit() or words.peek()[:1] == "*":
                exclude.append(words.word("types of exclude/type"))
            for types in exclude:
                type_range(types, 10**18 if ntypes is None else ntypes, words.command)
        else:
            scale = (
                words.number("shiftscale"),
                words.number("cmin"),
                words.number("wmin"),
            )
    return {"shift": Shift(tuple(exclude), scale)}


def _rho_sum(words: Words, ntypes: int | None) -> Settings:
    if words.peek() != "self/mass":
        return {"rho_sum": True}
    words.word("self/mass")
    return {"rho_sum": True, "self_mass": True}


def _thermal(words: Words, ntypes: int | None) -> Settings:
    return {"thermal": True}


def _interface(words: Words, ntypes: int | None) -> Settings:
    return {"interface_reconstruct": True}


def _self_mass(words: Words, ntypes: int | None) -> Settings:
    words.fail("self/mass", "is an argument of rho/sum and must follow it")


def _density(words: Words, ntypes: int | None) -> Settings:
    return {"rho0": words.numbers("density", ntypes)}


def _speed(words: Words, ntypes: int | None) -> Settings:
    return {"cs": words.numbers("speed/sound", ntypes)}


_KEYWORDS: dict[str, Callable[[Words, int | None], Settings]] = {
    "thermal": _thermal,
    "interface/reconstruct": _interface,
    "surface/detection": _surface,
    "shift": _shift,
    "rho/sum": _rho_sum,
    "self/mass": _self_mass,
    "density": _density,
    "speed/sound": _speed,
}


def parse_fix_rheo(text: str, ntypes: int | None = None, manual: Manual = FIRST) -> FixRheo:
    """Read ``fix ID all rheo cut kstyle zmin keyword values...``.

    Parameters
    ----------
    text : str
        The command; ``&`` continues a line, ``#`` begins a comment.
    ntypes : int, optional
        Number of atom types; if given, density and speed/sound must have as many values.
    manual : {"2025.7.22", "2026.7.4"}
        Version of the manual by which the command is understood.

    Raises
    ------
    InputError
        Not this command, an unknown kernel or keyword, a missing or bad value.

    Source: manual, fix rheo, syntax.
    """
    words = fix(text, "rheo")
    cut = words.number("cut")
    if cut <= 0:
        words.fail("cut", "must be positive", cut)
    kernel = words.choice("kstyle", tuple(KERNELS))
    zmin = words.integer("zmin")
    if zmin < 0:
        words.fail("zmin", "must not be negative", zmin)
    settings: Settings = {}
    while words.left:
        keyword = words.choice("keyword of fix rheo", tuple(_KEYWORDS))
        with words.complaints():
            settings |= _KEYWORDS[keyword](words, ntypes)
    if "shift" in settings:
        settings["shift"] = replace(settings["shift"], weighs_distance=weighs_distance(manual))
    return FixRheo(cut, kernel, zmin, **settings)
