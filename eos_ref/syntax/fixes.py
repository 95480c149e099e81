"""Parser for the manual's command text: ``fix ID all rheo ...`` and ``fix ID all rheo/pressure ...``.

The grammar is that of the two manual pages. What they refuse, or what has no meaning (a speed of sound of 0),
is refused here with one line that says why.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NoReturn, cast, get_args

from eos_ref.eos.registry import PARAMETER, STYLES, Style
from eos_ref.eos.table import EOS, EOSTable
from eos_ref.errors import InputError, nearest
from eos_ref.kernels.styles import KernelStyle
from eos_ref.syntax.manual import FIRST, Manual, weighs_distance
from eos_ref.syntax.ranges import type_range

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
    """Arguments of the surface/detection keyword."""

    style: SurfaceStyle
    limit: float
    splash: int


@dataclass(frozen=True)
class Shift:
    """Arguments of the shift keyword; ``scale_cross_type`` holds shiftscale, cmin, and wmin or rmin.

    The support of a particle by its own type is sum_j W_ij in the manual of 22 Jul 2025, compared with wmin (1/volume),
    and sum_j r_ij W_ij in that of 4 Jul 2026, compared with rmin (length/volume): ``weighs_distance``.
    """

    exclude_types: tuple[str, ...] = ()
    scale_cross_type: tuple[float, float, float] | None = None
    weighs_distance: bool = False


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


@dataclass
class _Words:
    """The words of a command, read one after another; every complaint names the command."""

    words: list[str]
    command: str
    position: int = field(default=0)

    def fail(self, what: str, rule: str, found: object = None) -> NoReturn:
        raise InputError(what, rule, found, self.command)

    @property
    def left(self) -> bool:
        return self.position < len(self.words)

    def peek(self) -> str:
        return self.words[self.position] if self.left else ""

    def word(self, what: str) -> str:
        if not self.left:
            self.fail(what, "is missing at the end of the command")
        self.position += 1
        return self.words[self.position - 1]

    def number(self, what: str) -> float:
        text = self.word(what)
        value = _float(text)
        if value is None or not math.isfinite(value):
            self.fail(what, "must be a finite number", text)
        return value

    def integer(self, what: str) -> int:
        text = self.word(what)
        if not re.fullmatch("[+-]?[0-9]{1,18}", text):
            self.fail(what, "must be a whole number of at most 18 digits", text)
        return int(text)

    def numbers(self, what: str, ntypes: int | None) -> tuple[float, ...]:
        values: list[float] = []
        while self.left and _float(self.peek()) is not None:
            values.append(self.number(what))
        if not values or (ntypes is not None and len(values) != ntypes):
            found = " ".join(map(str, values)) or self.peek()
            self.fail(what, f"needs one value per atom type ({'N' if ntypes is None else ntypes})", found)
        for value in values:
            if value <= 0:
                self.fail(what, "must be positive", value)
        return tuple(values)


def _float(text: str) -> float | None:
    if "_" in text or not text.isascii():  # Python's float takes 1_000 and the digits of every script
        return None
    try:
        return float(text)
    except ValueError:
        return None


def _words(text: str, style: str) -> _Words:
    """Split a fix command and check ``fix ID all STYLE``."""
    # As in LAMMPS, & is the last printable character of its line, and a comment ends at its (joined) line.
    lines = [line.split("#", 1)[0] for line in re.sub(r"&[ \t\r]*\n", "", text).splitlines()]
    lines = [" ".join(line.split()) for line in lines if line.strip()]
    if len(lines) > 1:
        raise InputError("command", "must be a single one (& at the end of a line continues it)", lines[1], lines[0])
    command = lines[0] if lines else ""
    words = _Words(command.split(), command)
    if words.word("command") != "fix":
        words.fail("command", "must begin with fix", words.words[0])
    words.word("fix ID")
    group = words.word("group-ID")
    if group != "all":
        words.fail(f"group of fix {style}", "must be all", group)
    found = words.word("fix style")
    if found != style:
        words.fail("fix style", f"must be {style}", found)
    return words


def _one_of(word: str, choices: Sequence[str]) -> str:
    return f"must be one of {', '.join(choices)}{nearest(word, choices)}"


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
    words = _words(text, "rheo/pressure")
    entries: list[PressureEntry] = []
    styles = (*STYLES, "background")
    while words.left or not entries:
        types = words.word("types and pressure style")
        type_range(types, 10**18, words.command)  # its form; `resolve` knows the number of types
        style = words.word("pressure style")
        if style not in styles:
            words.fail("pressure style", _one_of(style, styles), style)
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
    """Return one law per atom type; later entries override earlier ones, a background stays beside the law.

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
            besides = " besides the background" if t in background else ""
            raise InputError(f"atom type {t}", f"needs an equation of state{besides}", where=where)
        style, value = styles[t]
        try:
            laws.append(
                EOS(
                    cast(Style, style),
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


def _surface(words: _Words, ntypes: int | None) -> Settings:
    style = words.word("style of surface/detection")
    if style not in get_args(SurfaceStyle):
        words.fail("style of surface/detection", _one_of(style, get_args(SurfaceStyle)), style)
    limit = words.number("limit of surface/detection")
    splash = words.integer("limit/splash of surface/detection")
    return {"surface_detection": SurfaceDetection(cast(SurfaceStyle, style), limit, splash)}


def _shift(words: _Words, ntypes: int | None) -> Settings:
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
            scale = (words.number("shiftscale"), words.number("cmin"), words.number("wmin"))
    return {"shift": Shift(tuple(exclude), scale)}


def _rho_sum(words: _Words, ntypes: int | None) -> Settings:
    if words.peek() != "self/mass":
        return {"rho_sum": True}
    words.word("self/mass")
    return {"rho_sum": True, "self_mass": True}


def _thermal(words: _Words, ntypes: int | None) -> Settings:
    return {"thermal": True}


def _interface(words: _Words, ntypes: int | None) -> Settings:
    return {"interface_reconstruct": True}


def _self_mass(words: _Words, ntypes: int | None) -> Settings:
    words.fail("self/mass", "is an argument of rho/sum and must follow it")


def _density(words: _Words, ntypes: int | None) -> Settings:
    return {"rho0": words.numbers("density", ntypes)}


def _speed(words: _Words, ntypes: int | None) -> Settings:
    return {"cs": words.numbers("speed/sound", ntypes)}


_KEYWORDS: dict[str, Callable[[_Words, int | None], Settings]] = {
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
    words = _words(text, "rheo")
    cut = words.number("cut")
    if cut <= 0:
        words.fail("cut", "must be positive", cut)
    kernel = words.word("kstyle")
    if kernel not in get_args(KernelStyle):
        words.fail("kstyle", _one_of(kernel, get_args(KernelStyle)), kernel)
    zmin = words.integer("zmin")
    if zmin < 0:
        words.fail("zmin", "must not be negative", zmin)
    settings: Settings = {}
    while words.left:
        keyword = words.word("keyword")
        if keyword not in _KEYWORDS:
            words.fail("keyword of fix rheo", _one_of(keyword, tuple(_KEYWORDS)), keyword)
        settings |= _KEYWORDS[keyword](words, ntypes)
    if "shift" in settings:
        settings["shift"] = replace(settings["shift"], weighs_distance=weighs_distance(manual))
    return FixRheo(cut, cast(KernelStyle, kernel), zmin, **settings)
