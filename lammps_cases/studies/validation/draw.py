"""Pictures of a validation: what is known, the reference and LAMMPS over each other."""

from __future__ import annotations

import textwrap
from typing import Any

import matplotlib
from matplotlib.figure import Figure

from lammps_cases.pages.figures import BLUE, GREY, RED, STYLE
from lammps_cases.studies.validation.model import FlowPanel, ReferenceCurve, Validation
from lammps_cases.studies.validation.record import LAMMPS, REFERENCE, UNIT, Validated, called

_COLOURS = {REFERENCE: BLUE, LAMMPS: RED, UNIT: RED}
_FINDING = "#d98200"
_MARKS = ("o", "^", "s", "D")


def figure(validated: Validated, of: Validation) -> Figure:
    """Draw every panel of a flow; the finest resolution of a side is thick, coarser ones are faint."""
    with matplotlib.rc_context(STYLE):
        count = len(of.panels)
        drawn = Figure(figsize=(3.6 * count + 2.3, 3.2), layout="constrained")
        axes = drawn.subplots(1, count, squeeze=False).ravel()
        for axis, panel in zip(axes, of.panels, strict=True):
            for side in validated.sides(of.name):
                _draw_side(axis, validated, of.name, side, panel)
            for known, mark in zip(panel.known, _MARKS, strict=False):
                _draw_known(axis, known, mark)
            axis.set(xlabel=panel.x, ylabel=panel.y)
        labels: dict[str, Any] = {}
        for axis in axes:
            labels |= {label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)}
        drawn.legend(list(labels.values()), list(labels), loc="outside right center", frameon=False, fontsize=8)
        return drawn


def _draw_side(axis: Any, validated: Validated, flow: str, side: str, panel: FlowPanel) -> None:
    runs = [run for run in validated.of(flow, side) if panel.name in run.curves]
    for run in runs:
        last = run is runs[-1]
        style: dict[str, Any] = {
            "color": _COLOURS.get(side, _FINDING),
            "lw": 1.6 if last else 0.8,
            "alpha": 0.95 if last else 0.45,
            "ls": "-" if side == REFERENCE else "--" if side == LAMMPS else ":",
            "zorder": 3 if side == REFERENCE else 4,
        }
        axis.plot(*run.curves[panel.name], label=_label(side, run.n) if last else None, **style)


def _label(side: str, n: int) -> str:
    """Return a side and its resolution, in lines of a legend."""
    return textwrap.fill(f"{called(side)}, N\u00a0=\u00a0{n}", 22, break_on_hyphens=False)


def _draw_known(axis: Any, known: ReferenceCurve, mark: str) -> None:
    if known.marks:
        style: dict[str, Any] = {"ls": "none", "marker": mark, "ms": 4.5, "mfc": "white", "mec": "black", "mew": 1}
    else:
        style = {"color": "black" if mark == _MARKS[0] else GREY, "lw": 1.0, "ls": "-" if mark == _MARKS[0] else "-."}
    axis.plot(known.x, known.y, label=known.label, zorder=5 if known.marks else 2, **style)
