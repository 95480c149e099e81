"""Plots in the report of a run: the points, their digits and the curves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.eos import bounds
from lammps_cases.records.case_parts import FieldRecord, LawRecord
from lammps_cases.records.run_record import CaseRecord, RunRecord
from lammps_cases.report import page, plots
from tests.support.made_report import NAME, WATER, column, numbers
from tests.support.pages import Page


def test_embedded_points(parsed: Page, run: RunRecord) -> None:
    shown = {case: data["n"] for case, data in parsed.data.items() if "id" in data}
    laws = ("eos.water.near", "eos.cubic.compressed", "eos.types", "flow.block3d", "eos.states", "eos.broken")
    assert shown == dict.fromkeys(laws, 400) | dict.fromkeys(("model.flat", "model.cube", f"hostile2.{NAME}"), 60)
    for case, count in shown.items():
        data = parsed.data[case]
        if "steps" in data:
            continue
        columns = [data["id"], data["type"], data["rho"], *data["x"], *data["fields"]["pressure"].values()]
        assert {len(numbers(column)) for column in columns if isinstance(column, str)} == {count}
    assert parsed.data["eos.states"]["natoms"] == 100_000
    assert [len(parsed.data[case]["x"]) for case in ("eos.states", "flow.block3d")] == [2, 3]
    assert set(parsed.data) == {*shown, "audit.in.dam"}


def test_equal_input_is_not_drawn(parsed: Page, html: str) -> None:
    drawn = [data for data in parsed.data.values() if "fields" in data and "steps" not in data]
    assert len(drawn) == 6 and all(set(data["fields"]) == {"pressure"} for data in drawn)
    assert "Worst atom of pressure" in html and "Worst atom of rho" not in html


def test_the_worst_atoms_and_both_ends_are_kept(parsed: Page, folder: Path) -> None:
    with np.load(folder / "fields" / "eos.states.npz") as arrays:
        rho_n, id_n = arrays["rho"], arrays["id"]
        _, ratio_n = plots.differences(arrays)["pressure"]
    data = parsed.data["eos.states"]
    drawn = set(column(data, "id"))
    assert drawn >= {float(i) for i in id_n[np.argsort(ratio_n)[-100:]]}
    assert numbers(data["rho"]).max() > np.quantile(rho_n, 0.99)
    assert numbers(data["rho"]).min() < np.quantile(rho_n, 0.01)


def test_points_are_exact_and_not_finite_values_survive(parsed: Page, folder: Path) -> None:
    with np.load(folder / "fields" / "eos.broken.npz") as arrays:
        lammps_n = arrays["pressure.lammps"]
        reference_n = arrays["pressure.reference"]
    data = parsed.data["eos.broken"]
    drawn_n = column(data, "lammps", "pressure")
    np.testing.assert_array_equal(drawn_n, lammps_n)
    assert np.isnan(drawn_n[5])
    difference_n = column(data, "difference", "pressure")
    assert np.isinf(difference_n[[5, 40]]).all()
    others = np.setdiff1d(np.arange(400), [5, 40])
    np.testing.assert_allclose(difference_n[others], (lammps_n - reference_n)[others], rtol=2.0**-plots.SIZE)


def test_near_rho0_keeps_its_offsets(parsed: Page) -> None:
    data = parsed.data["eos.water.near"]
    assert data["rho0"] == {"1": 1000.0}
    delta = (column(data, "rho") - 1000.0) / 1000.0  # as the browser computes it
    assert np.abs(delta[delta != 0]).min() < 1e-11


def test_curves_are_the_reference_on_a_fitting_axis(parsed: Page) -> None:
    laws = {case: data["laws"] for case, data in parsed.data.items() if data.get("laws")}
    axes = {case: [(law["quantity"], law["scale"]["kind"]) for law in found] for case, found in laws.items()}
    assert axes["eos.water.near"] == [("delta", "symlog")]
    assert axes["eos.cubic.compressed"] == [("rho", "linear")]
    assert axes["flow.block3d"] == [("delta", "linear")]
    assert axes["eos.states"] == [("ratio", "log")]
    assert [quantity for quantity, _ in axes["eos.types"]] == ["rho", "rho", "rho", "energy"]
    near = laws["eos.water.near"][0]
    x, p = numbers(near["x"]), numbers(near["p"])
    rho = 1000 * (1 + x)
    # Going from rho to x and back rounds four times, 4u rho in all, and x is drawn with few digits; the law's slope
    # carries both into the pressure, of which the curve has as few; the two evaluations of the law are each within the
    # reference's own bound.
    short = 2.0**-plots.CURVE
    slope = WATER.stiffness(rho)
    allowed = (4 * 2.0**-53 * rho + short * 1000 * np.abs(x)) * slope + short * np.abs(p)
    assert np.all(np.abs(p - WATER.pressure(rho)) <= allowed + 2 * bounds.reference(WATER, rho))
    assert x.min() < -0.05 < 0.05 < x.max() and np.abs(x[x != 0]).min() < 1e-11
    gas = laws["eos.types"][3]
    # Both are drawn with few digits; next to these the law's own roundings add at most one unit.
    np.testing.assert_allclose(numbers(gas["p"]), (1.4 - 1) * numbers(gas["x"]), rtol=3 * short)


def side(
    field: str, lammps: Any = 1.0, reference: Any = 1.0, bound: Any = 1.0, count: int = 3
) -> dict[str, np.ndarray]:
    """The three sides of a field."""
    sides = {"lammps": lammps, "reference": reference, "bound": bound}
    return {f"{field}.{name}": np.broadcast_to(np.asarray(of, float), count) for name, of in sides.items()}


def payload(case: CaseRecord, **more: Any) -> dict[str, Any]:
    """What is drawn of a case of some particles."""
    count = len(more.get("rho", np.ones(3)))
    arrays = {"id": np.arange(count), "type": np.ones(count), "x": np.zeros((count, 3)), "rho": np.ones(count)} | more
    data, _ = plots.payload(case, arrays, plots.differences(arrays))
    assert data is not None
    return data


def test_no_curve_for_a_law_outside_its_domain() -> None:
    laws = [LawRecord(type=1, style="tait/general", rho0=-1.0, cs=1.0, parameter=0.0)]
    assert payload(CaseRecord(case="x", verdict="pass", laws=laws), **side("pressure"))["laws"] == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("parameter", [0.4, -1.5, 120.0])
def test_extreme_states_are_packed(parameter: float) -> None:
    rho_n = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 5e-324, 1e-300, 1.0, 1e300])
    styles = ("linear", "cubic", "tait/water", "tait/general", "ideal/gas")
    laws = [LawRecord(type=t, style=s, rho0=1.0, cs=2.0, parameter=parameter) for t, s in enumerate(styles, 1)]
    laws[0].parameter = laws[2].parameter = None
    density_n = np.tile(rho_n, len(laws))
    of = {"rho": density_n, "type": np.repeat([1, 2, 3, 4, 5], rho_n.size), "e": np.ones(density_n.size)}
    of |= side("pressure", density_n, density_n, density_n, density_n.size)
    data = payload(CaseRecord(case="x", verdict="pass", laws=laws), **of)
    assert json.loads(page.embedded(data)) == data
    assert {law["type"] for law in data["laws"]} >= {1, 2, 3, 4}


def test_vectors_and_tensors_are_drawn_by_their_worst_component(parsed: Page, folder: Path) -> None:
    for case, dimension in (("model.flat", 2), ("model.cube", 3)):
        data = parsed.data[case]
        assert list(data["fields"]) == ["grad/v", "f", "pressure"]  # the phase is equal: nothing to draw
        assert data["first"] == "f" and data["steps"] == {"grad/v": 10, "f": 0, "pressure": 10}
        assert len(data["x"]) == dimension and data["laws"] == []
        with np.load(folder / "fields" / f"{case}.npz") as arrays:
            lammps_nc, difference_nc = arrays["f.lammps"], arrays["f.lammps"] - arrays["f.reference"]
            phase_n = arrays["phase.lammps"]
        rows, at = np.arange(60), np.abs(difference_nc).argmax(axis=1)
        np.testing.assert_allclose(column(data, "lammps", "f"), lammps_nc[rows, at], rtol=2.0**-plots.VALUE)
        np.testing.assert_allclose(column(data, "difference", "f"), difference_nc[rows, at], rtol=2.0**-plots.SIZE)
        assert column(data, "bound", "f") == pytest.approx(1e-14, rel=2.0**-plots.SIZE)
        np.testing.assert_array_equal(column(data, "phase"), phase_n)


def test_other_steps_and_pairs_of_a_case(parsed: Page, folder: Path) -> None:
    data = parsed.data["model.flat"]
    assert list(data["fields"]["f"]["at"]) == ["10"] and data["compared"] == 2
    assert "at" not in data["fields"]["pressure"]  # other fields are next to the data, where a long page omits them
    at = data["fields"]["f"]["at"]["10"]
    with np.load(folder / "fields" / "model.flat.npz") as arrays:
        lammps_nc, reference_nc = arrays["f.lammps"], arrays["f.reference"]
    largest = np.abs((lammps_nc + reference_nc) / 2 - reference_nc).max(axis=1)
    np.testing.assert_allclose(np.abs(numbers(at["difference"], 60)), largest, rtol=2.0**-plots.SIZE)
    pairs = data["pairs"]
    assert (pairs["atom"], pairs["step"], pairs["count"], pairs["shown"]) == ([4], [0], [2], [2])
    assert pairs["names"] == ["force x", "drho"]  # the whole force is due to pressure
    assert [numbers(column, 2).tolist() for column in pairs["pair"]] == [[1.0, 2.0], [0.5, -0.75]]
    assert [numbers(column, 1).tolist() for column in pairs["sum"]] == [[3.0], [-0.25]]


def test_only_the_nearest_pairs_are_listed() -> None:
    of = {"step": [0, 1], "atom": [1, 2], "count": [50, 1], "id": np.arange(51), "r": np.arange(51.0)}
    of |= {"names": ["drho"], "pair": np.arange(51.0)[:, None], "sum": [[1225.0], [50.0]]}
    found = plots._pairs({f"@pairs {name}": np.asarray(values) for name, values in of.items()})["pairs"]
    assert found["shown"] == [plots.NEIGHBOURS, 1] and found["count"] == [50, 1]
    assert numbers(found["id"]).tolist() == [*range(plots.NEIGHBOURS), 50]
    assert numbers(found["sum"][0]).tolist() == [1225.0, 50.0]


def test_significant_digits_are_kept() -> None:
    bound_n = np.array([1.0, 2.0, 3.0]) / 3
    data = payload(CaseRecord(case="x", verdict="differs"), **side("f", np.nextafter(bound_n, 2), 0.0, bound_n))
    assert np.all(numbers(data["fields"]["f"]["difference"]) > numbers(data["fields"]["f"]["bound"]))
    np.testing.assert_array_equal(numbers(plots._column([1e-300, 2e-300], plots.SIZE)), [1e-300, 2e-300])
    assert plots._column([2.5, 2.5]) == 2.5


@pytest.mark.parametrize("digits", [plots.CURVE, plots.VALUE, plots.SIZE])
def test_short_numbers_are_rounded_to_nearest(digits: int) -> None:
    values_n = np.random.default_rng(5).lognormal(0, 10, 1000) * np.resize([1, -1], 1000)
    values_n[:4] = np.nan, np.inf, -np.inf, 0
    drawn_n = numbers(plots._column(values_n, digits))
    np.testing.assert_array_equal(drawn_n[:4], values_n[:4])
    # Rounded to float32 first, then to these digits.
    np.testing.assert_allclose(drawn_n[4:], values_n[4:], rtol=2.0**-digits + 2.0**-24)
    assert np.abs(drawn_n[4:] / values_n[4:] - 1).max() > 2.0 ** -(digits + 1)
    mantissa_n, _ = np.frexp(drawn_n[4:])
    np.testing.assert_array_equal(mantissa_n * 2.0**digits, np.rint(mantissa_n * 2.0**digits))


def test_thinning() -> None:
    ratio_n = np.zeros(1000)
    ratio_n[[3, 500]] = np.inf, 2.0
    picked = plots.thinned(ratio_n, np.arange(1000.0), np.ones(1000), 40)
    assert picked.size == np.unique(picked).size == 40
    assert {3, 500, 999} <= set(picked.tolist())
    assert plots.thinned(ratio_n, np.arange(1000.0), np.ones(1000), 1000).size == 1000


@pytest.mark.parametrize(
    ("values", "scale"),
    [
        ([1.0, 2.0, 3.0], {"kind": "linear"}),
        ([0.0, np.nan, np.inf], {"kind": "linear"}),
        ([], {"kind": "linear"}),
        ([1.0, 1e-3, 1.0, 1.0, 1.0], {"kind": "linear"}),  # a thousandth exactly
        ([1e-4, -1e-5, 1.0, 1.0, 1.0], {"kind": "symlog", "decade": -5}),
        ([1e-320, 1e-320, 1.0], {"kind": "symlog", "decade": -307}),
    ],
)
def test_scales(values: list[float], scale: dict[str, Any]) -> None:
    """A fifth of the values three decades below the largest requires a logarithmic scale."""
    assert plots.scale_of(np.array(values)) == scale


def test_relative_offsets_from_rho0_of_every_type() -> None:
    laws = [LawRecord(type=k, style="linear", rho0=rho0, cs=1.0, background=0.0) for k, rho0 in ((1, 2.0), (2, 4.0))]
    case = CaseRecord(case="one", verdict="pass", laws=laws)
    delta_n = plots.offsets(case, np.array([1, 2, 3, 1]), np.array([3.0, 3.0, 3.0, 1.0]))
    assert np.array_equal(delta_n, [0.5, -0.25, np.nan, -0.5], equal_nan=True)


def test_audit_begins_with_its_worst_field_and_step() -> None:
    told = [("pressure", "exact", 0.0, 0.0, 0), ("drho", "pass", 0.5, 0.7, 40), ("f", "explained", 2.0, 2.0, 60)]
    fields, arrays = [], {"step": np.array(60)}
    for name, verdict, size, ratio, step in told:
        arrays |= side(name, size, 0.0)
        fields.append(FieldRecord(field=name, stage="", verdict=verdict, max_over_bound=ratio, worst_step=step))
    data = payload(CaseRecord(case="in.deck", verdict="explained", natoms=3, tags=["audit"], fields=fields), **arrays)
    assert data["first"] == "f" and data["step"] == 60
    assert {field: step for field, (step, _) in data["elsewhere"].items()} == {"drho": 40}
