"""The reports of a run: what is written, that it is well formed, and that no text in it acts as markup."""

from __future__ import annotations

import base64
import json
import re
import subprocess
import xml.etree.ElementTree as ET
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from eos_ref.errors import InputError
from lammps_cases.comparison import compare
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import Variant
from lammps_cases.records import files, wording
from lammps_cases.records.audit_record import OutlookRecord
from lammps_cases.records.files import read_arrays
from lammps_cases.records.run_record import (
    Blame,
    CaseRecord,
    CheckRecord,
    EngineRecord,
    FieldRecord,
    LawRecord,
    RunRecord,
    Seconds,
    StepRecord,
)
from lammps_cases.report import agreement, drawn, findings, markdown, page, plots, write_report
from lammps_cases.scene.fields import in_step_order
from tests.support.browser import browser
from tests.support.pages import unpacked

HOSTILE = "<img src=x onerror=alert(1)> | `b` </script><script>alert(2)</script> \x1b[31m & ]]> *x*"
NAME = HOSTILE.replace("/", "")  # of a case, which is that of a file
WATER = EOS("tait/water", rho0=1000.0, cs=10.0)


def _laws(table: EOSTable) -> list[LawRecord]:
    return [
        LawRecord(
            type=t,
            style=w.style,
            rho0=w.rho0,
            cs=w.cs,
            parameter=w.parameter,
            background=w.background,
            mass=1.5,
        )
        for t, w in enumerate(table.laws, 1)
    ]


def _positions(count: int, dimension: int) -> np.ndarray:
    side = int(np.ceil(count ** (1 / dimension)))
    axes = [np.arange(side) * 0.5] * dimension
    x = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)[:count]
    return np.pad(x, ((0, 0), (0, 3 - dimension)))


def scene(
    folder: Path,
    name: str,
    table: EOSTable,
    rho_n: np.ndarray,
    *,
    types: np.ndarray | None = None,
    e_n: np.ndarray | None = None,
    dimension: int = 2,
    noise: float = 0.3,
    spoil: dict[int, float] | None = None,
    **more: Any,
) -> CaseRecord:
    """A case whose "LAMMPS" is the reference moved by a part of the bound, and spoiled on some atoms."""
    count = rho_n.size
    type_n = np.ones(count, int) if types is None else types
    id_n, mass_n = np.arange(1, count + 1), np.full(count, 1.5)
    energy_n = None if e_n is None else e_n * mass_n
    state = compare.EosState(id_n, type_n, rho_n, mass_n, energy_n)
    bound_n = bounds.comparison(table, rho_n, type_n, state.e_n)
    wiggle = np.random.default_rng(7).uniform(-noise, noise, count)
    lammps_n = table.pressure(rho_n, type_n, state.e_n) + wiggle * bound_n
    for at, value in (spoil or {}).items():
        lammps_n[at] = value
    found = compare.compare_pressure(table, state, lammps_n)
    x_nc = _positions(count, dimension)
    arrays = {
        "id": id_n,
        "type": type_n,
        "x": x_nc,
        "rho": rho_n,
        "box": np.stack([x_nc.min(0) - 0.25, x_nc.max(0) + 0.25]),
    }
    arrays |= {
        "pressure.lammps": found.lammps_n,
        "pressure.reference": found.reference_n,
        "pressure.bound": found.bound_n,
    }
    arrays |= {"rho.lammps": rho_n, "rho.reference": rho_n, "rho.bound": np.zeros(count)}
    if state.e_n is not None:
        arrays["e"] = state.e_n
    files.write_arrays(folder / "fields" / f"{name}.npz", arrays)
    return CaseRecord(
        case=name,
        verdict=found.record.verdict,
        natoms=count,
        steps=1,
        dimension=dimension,
        units="lj",
        seconds=Seconds(lammps=0.01, reference=0.002, total=0.02),
        fields=[found.record],
        laws=_laws(table),
        reproduce=f"eos-ref run '{name}'",
        **more,
    )


def ended() -> list[CaseRecord]:
    """Cases without arrays, of every verdict that such a case can have."""
    illegal = "Illegal fix rheo/pressure"
    unknown = "ERROR: Unknown fix style rheo | (src/modify.cpp:1)"
    name = f"hostile.{NAME}"
    shift = FieldRecord(field="shift", stage="kernel", verdict="explained", max_over_bound=1e6, explained_by=["F-3"])
    return [
        CaseRecord(case="refuse.gamma", verdict="refused", expects=illegal, message=f"ERROR: {illegal} command"),
        CaseRecord(case="refuse.surprise", verdict="refused", message=unknown),
        CaseRecord(case="crash.segfault", verdict="crashed", message=HOSTILE, reproduce="eos-ref run crash.segfault"),
        CaseRecord(case="slow.timeout", verdict="timeout", message="no answer in 60 s"),
        CaseRecord(case="skip.plugin", verdict="skipped", message="no RHEO in this engine"),
        CaseRecord(case=name, verdict="pass", about=HOSTILE, tags=[HOSTILE], lint=[HOSTILE]),
        CaseRecord(case="ledger.artificial", verdict="explained", explained_by=["F-3"], fields=[shift]),
    ]


def beside(arrays: dict[str, Any]) -> dict[str, Any]:
    """The other step of each field, with half the difference in all components; two pairs of atom 4 after step 0."""
    found = dict(arrays)
    for field, step in {"grad/v": 0, "f": 10, "pressure": 0}.items():
        lammps, reference, bound = (arrays[f"{field}.{side}"] for side in ("lammps", "reference", "bound"))
        sides = {"lammps": (lammps + reference) / 2, "reference": reference, "bound": bound}
        found |= {f"@{step} {side} {field}": values for side, values in sides.items()}
    found |= {"@pairs step": [0], "@pairs atom": [4], "@pairs count": [2], "@pairs id": [7, 9], "@pairs r": [0.5, 0.75]}
    found |= {"@pairs names": ["force x", "pressure_force x", "drho"], "@pairs sum": [[3.0, 3.0, -0.25]]}
    found["@pairs pair"] = [[1.0, 1.0, 0.5], [2.0, 2.0, -0.75]]
    return drawn.split({key: np.asarray(values) for key, values in found.items()})[1]


def model(folder: Path, name: str, dimension: int) -> CaseRecord:
    """A case of the particle model: a force outside its bound from step 0 on, a gradient from step 1 on."""
    count = 60
    id_n, x_nc = np.arange(1, count + 1), _positions(count, dimension)
    rng = np.random.default_rng(3)
    arrays = {"id": id_n, "type": 1 + id_n % 2, "x": x_nc, "rho": rng.uniform(1, 2, count)}
    arrays["box"] = np.stack([x_nc.min(0) - 0.25, x_nc.max(0) + 0.25])
    arrays["phase.lammps"] = arrays["phase.reference"] = np.asarray(id_n % 2, float)
    arrays["phase.bound"] = np.zeros(count)
    shapes = {"grad/v": (count, dimension, dimension), "f": (count, dimension), "pressure": (count,)}
    worst = {"grad/v": (0.5, 7e3), "f": (3e9, 2e8), "pressure": (0.1, 20.0)}
    fields = [FieldRecord(field="type (given)", stage="input", verdict="exact", max_over_bound=0.0)]
    for field, shape in shapes.items():
        reference, bound = rng.uniform(-1, 1, shape), np.full(shape, 1e-14)
        largest = max(worst[field])
        lammps = reference + bound * rng.uniform(-1, 1, shape)
        lammps.flat[3] = reference.flat[3] + largest * 1e-14
        arrays |= {f"{field}.lammps": lammps, f"{field}.reference": reference, f"{field}.bound": bound}
        steps = [
            StepRecord(
                step=step,
                verdict="pass" if ratio <= 1 else "explained",
                max_abs=ratio * 1e-14,
                max_over_bound=ratio,
                worst_id=4,
            )
            for step, ratio in zip((0, 10), worst[field], strict=True)
        ]
        explained = ["pairs", "F-3"] if largest > 1 else []
        fields.append(
            FieldRecord(
                field=field,
                stage={"f": "pair", "grad/v": "gradients", "pressure": "eos"}[field],
                verdict="explained" if explained else "pass",
                max_over_bound=largest,
                worst_id=4,
                worst_step=0 if field == "f" else 10,
                explained_by=explained,
                steps=steps,
            )
        )
    files.write_arrays(folder / "fields" / f"{name}.npz", arrays)
    files.write_arrays(drawn.beside_file(folder / "fields", name), beside(arrays))
    values = {"lammps": 1.5, "reference": 0.5, "bound": 1e-14}
    first = Blame(field="f", stage="pair", step=0, atom=4, outside=1, of=count, **values)
    laws = _laws(EOSTable((WATER,)))
    more = {"natoms": count, "steps": 10, "dimension": dimension, "blame": first, "laws": laws}
    record = CaseRecord(case=name, verdict="explained", fields=fields, **more)
    record.message = wording.message(record)
    return record


def _entry(name: str, **more: Any) -> Finding:
    texts = {
        "title": f"title of {name}",
        "effect": f"effect of {name}",
        "documented": "this",
        "observed": "that",
        "argument": "so",
        "workaround": "-",
    }
    known: dict[str, Any] = {"number": 0, "severity": "low", "engines": ("2025.7.22.4.0",)}
    return Finding(id=name, **(texts | known | more))


FINDINGS = (
    _entry("elsewhere", severity="high", engines=("2024.1.1",), applies_to=("*",)),
    _entry("F-3", severity="medium", model_variant=Variant(lambda scene: True)),
    _entry("pairs", severity="high", applies_to=("*",), model_variant=Variant(lambda scene: True)),
    _entry("gone", severity="high", model_variant=Variant(lambda scene: True)),
    _entry("open", applies_to=("eos.broken",)),
    _entry(
        "hostile", title=HOSTILE, effect=HOSTILE, documented=HOSTILE, observed=HOSTILE, argument=HOSTILE, scene=HOSTILE
    ),
)


def audit() -> CaseRecord:
    """An audited deck: looks over time, no arrays."""
    common = {"run": 1, "natoms": 400, "verdict": "pass", "max_abs": 1e-13}
    checks = [
        CheckRecord(step=10 * k, type=t, max_over_bound=0.07 * t * (k % 7), worst_id=k, **common)
        for k in range(400)
        for t in (1, 2)
    ]
    worst = {"max_over_bound": 0.84, "atom_type": 2, "worst_step": 60, "worst_id": 6}
    return CaseRecord(
        case="audit.in.dam",
        verdict="pass",
        warnings=["cs is below 10 times the largest velocity"],
        checks=checks,
        laws=_laws(EOSTable((WATER,))),
        fields=[FieldRecord(field="pressure", stage="eos", verdict="pass", **worst)],
    )


def example(folder: Path) -> RunRecord:
    """A run with a case of every kind."""
    rng = np.random.default_rng(1)
    near = 10.0 ** rng.uniform(-12, -1, 200)
    general = EOS("tait/general", rho0=1.3, cs=4.0, parameter=3.5, background=0.7)
    cubic = EOS("cubic", rho0=2.0, cs=3.0, parameter=0.4)
    gas = EOS("ideal/gas", parameter=1.4)
    four = EOSTable((EOS("linear", rho0=1.2, cs=2.0), cubic, general, gas))
    spoiled = {5: np.nan, 40: np.inf, 77: 3.0}
    both_sides = 1000 * (1 + np.concatenate([near, -near, [0.0]]))
    one = EOSTable((WATER,))
    random = {"types": rng.integers(1, 5, 900), "e_n": rng.uniform(1, 3, 900)}
    small = 1.3 * (1 + rng.uniform(-5e-4, 5e-4, 1000))
    states = 10.0 ** rng.uniform(-6, 5, 100_000)
    cases = [
        scene(folder, "eos.water.near", one, both_sides, tags=["quick"]),
        scene(folder, "eos.cubic.compressed", EOSTable((cubic,)), np.linspace(2.0, 6.0, 900), noise=0.0),
        scene(folder, "eos.types", four, rng.uniform(0.9, 1.6, 900), **random),
        scene(folder, "flow.block3d", EOSTable((general,)), small, dimension=3),
        scene(folder, "eos.states", one, states, lint=["m/rho is 1: V cannot be told from 1"]),
        scene(folder, "eos.broken", EOSTable((general,)), rng.uniform(1.0, 1.6, 400), spoil=spoiled),
        audit(),
        *ended(),
    ]
    cases[5].message = "pressure of atom 6 at stage eos is NaN"
    values = {"lammps": np.nan, "reference": 0.5, "bound": 1e-14}
    cases[5].blame = Blame(field="pressure", stage="eos", atom=6, outside=1, of=400, **values)
    cases += [model(folder, "model.flat", 2), model(folder, "model.cube", 3), model(folder, f"hostile2.{NAME}", 2)]
    cases[-1].twin, cases[-1].unseen, cases[-1].fields[1].field = HOSTILE, [HOSTILE], HOSTILE
    cases[-2].unseen = ["gone"]
    engine = EngineRecord(
        version_string="22 Jul 2025",
        distribution="2025.7.22.4.0",
        library="liblammps.so",
        library_sha256="ab" * 32,
    )
    run = RunRecord(
        engine=engine,
        reference={"eos-ref": "0.1.0", "numpy": np.__version__},
        machine={"cpu": "some cpu"},
        date="2026-01-02T03:04:05+00:00",
        command="eos-ref run --tag quick",
        notes=[f"this engine no longer shows gone {HOSTILE}"],
        cases=cases,
        seconds=2.5,
    )
    return run.counted()


class Page(HTMLParser):
    """What a browser would take from the page: elements with attributes, and the scripts' text."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.data: dict[str, Any] = {}
        self.scripts = 0
        self._case = ""
        self._inside = ""
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        attributes = dict(attrs)
        self.elements.append((tag, attributes))
        if tag == "article":
            self._case = attributes["data-case"] or ""
        if tag == "script":
            self.scripts += 1
            self._inside = attributes.get("class") or ""

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "data":
            self.data[self._case] = json.loads(data)


def numbers(text: str | float, count: int = 1) -> np.ndarray:
    if not isinstance(text, str):
        return np.full(count, text)
    width = {"d": 8, "f": 4, "b": 2}[text[0]]
    planes = np.frombuffer(base64.b64decode(text[2:]), np.uint8).reshape(width, -1)
    upper = np.pad(planes, ((width % 4, 0), (0, 0)))  # of a float32
    return np.frombuffer(upper.T.tobytes(), "<f8" if width == 8 else "<f4").astype(float)


def column(data: dict[str, Any], name: str, field: str = "") -> np.ndarray:
    return numbers(data["fields"][field][name] if field else data[name], data["n"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def run(folder: Path) -> RunRecord:
    run = example(folder)
    assert write_report(run, folder, FINDINGS) == folder / "report.html"
    return run


@pytest.fixture(scope="module")
def html(run: RunRecord, folder: Path) -> str:
    return unpacked((folder / "report.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def parsed(html: str) -> Page:
    return Page(html)


def test_the_page_loads_nothing_from_elsewhere(parsed: Page, html: str) -> None:
    for tag, attributes in parsed.elements:
        assert tag not in ("link", "iframe", "img", "object", "embed", "base"), tag
        assert "src" not in attributes and "srcset" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
    assert "default-src 'none'" in html
    style = html[html.index("<style>") : html.index("</style>")]
    assert "url(" not in style and "@import" not in style


def test_every_case_has_a_row_and_a_page(parsed: Page, run: RunRecord) -> None:
    shown = {a["data-case"] for tag, a in parsed.elements if tag == "article"}
    rows = [a for tag, a in parsed.elements if tag == "tr" and "data-kind" in a]
    assert shown == {case.case for case in run.cases}
    assert [row["data-kind"] for row in rows] == [wording.kind(case) for case in run.cases]


def test_embedded_points(parsed: Page, run: RunRecord) -> None:
    shown = {case: data["n"] for case, data in parsed.data.items() if "id" in data}
    assert shown == {
        "eos.water.near": 400,
        "eos.cubic.compressed": 400,
        "eos.types": 400,
        "flow.block3d": 400,
        "eos.states": 400,
        "eos.broken": 400,
        "model.flat": 60,
        "model.cube": 60,
        f"hostile2.{NAME}": 60,
    }
    for case, count in shown.items():
        data = parsed.data[case]
        if "steps" in data:
            continue
        columns = [data["id"], data["type"], data["rho"], *data["x"], *data["fields"]["pressure"].values()]
        assert {len(numbers(column)) for column in columns if isinstance(column, str)} == {count}
    assert parsed.data["eos.states"]["natoms"] == 100_000
    assert [len(parsed.data[case]["x"]) for case in ("eos.states", "flow.block3d")] == [2, 3]
    assert set(parsed.data) == {*shown, "audit.in.dam"}


def test_an_input_that_is_equal_is_not_drawn(parsed: Page, html: str) -> None:
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
    # Both are drawn with few digits, beside which the law's own roundings are nothing: at most one unit of them more.
    np.testing.assert_allclose(numbers(gas["p"]), (1.4 - 1) * numbers(gas["x"]), rtol=3 * short)


def test_no_curve_for_a_law_outside_its_domain() -> None:
    case = CaseRecord(
        case="x",
        verdict="pass",
        laws=[LawRecord(type=1, style="tait/general", rho0=-1.0, cs=1.0, parameter=0.0)],
    )
    side = {f"pressure.{name}": np.ones(3) for name in ("lammps", "reference", "bound")}
    arrays = {"id": np.arange(3), "type": np.ones(3), "x": np.zeros((3, 3)), "rho": np.ones(3), **side}
    data, _ = plots.payload(case, arrays, plots.differences(arrays))
    assert data is not None and data["laws"] == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("parameter", [0.4, -1.5, 120.0])
def test_extreme_states_are_packed(parameter: float) -> None:
    rho_n = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 5e-324, 1e-300, 1.0, 1e300])
    styles = ("linear", "cubic", "tait/water", "tait/general", "ideal/gas")
    laws = [LawRecord(type=t, style=s, rho0=1.0, cs=2.0, parameter=parameter) for t, s in enumerate(styles, 1)]
    laws[0].parameter = laws[2].parameter = None
    count = len(laws) * rho_n.size
    arrays = {"id": np.arange(count), "type": np.repeat([1, 2, 3, 4, 5], rho_n.size), "x": np.zeros((count, 3))}
    arrays |= {"rho": np.tile(rho_n, len(laws)), "e": np.ones(count)}
    arrays |= {f"pressure.{side}": arrays["rho"] for side in ("lammps", "reference", "bound")}
    case = CaseRecord(case="x", verdict="pass", laws=laws)
    data, _ = plots.payload(case, arrays, plots.differences(arrays))
    assert data is not None and json.loads(drawn.embedded(data)) == data
    assert {law["type"] for law in data["laws"]} >= {1, 2, 3, 4}


def test_checks_of_an_audit(parsed: Page, html: str) -> None:
    checks = parsed.data["audit.in.dam"]["checks"]
    assert len(numbers(checks["ratio"])) == plots.CHECKS and checks["total"] == 800
    assert "cs is below 10 times the largest velocity" in html
    assert f"{page.ROWS} of 800 shown" in html


def test_hostile_text_stays_text(parsed: Page, html: str, run: RunRecord) -> None:
    assert "<img" not in html.lower()
    assert "<script>alert" not in html
    assert not any(name.startswith("on") for _, attributes in parsed.elements for name in attributes)
    others = html.count('<script type="application/json" class="more">')  # other steps
    assert parsed.scripts == 4 + len(parsed.data) + others
    text = (Path("x") / markdown.summary(findings.outcome(run, FINDINGS))).as_posix()
    assert "<img" not in text and "<script" not in text
    assert drawn.embedded({"a": "</script><!--"}).count("<") == 0
    assert json.loads(drawn.embedded({"a": "</script>&"})) == {"a": "</script>&"}


def test_fields_against_steps(parsed: Page, html: str) -> None:
    start = html.index('data-case="model.flat"')
    article = html[start : html.index("</article>", start)]
    table = article[article.index('<table class="steps">') : article.index("</table>")]
    rows = {re.search(r"data-field=\"([^\"]*)\"", row)[1]: row for row in table.split("<tr") if "data-field" in row}
    assert list(rows) == ["grad/v", "f", "pressure"]  # the order of the record, which is that of a step
    cells = {
        name: re.findall(r'<td class="at v-(\w+) s(\d)" title="[^"]*atom 4: [^"]*">([^<]*)<', rows[name])
        for name in rows
    }
    assert cells["grad/v"] == [("pass", "3", "0.5"), ("explained", "5", "7e3")]
    assert cells["f"] == [("explained", "7", "3e9"), ("explained", "6", "2e8")]
    assert '<td class="at v-exact" colspan="2">=</td>' in table  # what is compared once
    blames = re.findall(r'<p class="blame[^>]*>(.*?)</p>', article)
    assert blames[0] == (
        "f (stage pair) leaves its bound at step 0 at 1 of 60 atoms, first atom 4: "
        "LAMMPS 1.5, reference 0.5, bound 1e-14"
    )
    assert blames[1] == 'Explained by <a href="#finding=pairs">pairs</a>, <a href="#finding=F-3">F-3</a>'


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
    assert "at" not in data["fields"]["pressure"]  # of other fields beside the data, which a long page leaves out
    at = data["fields"]["f"]["at"]["10"]
    with np.load(folder / "fields" / "model.flat.npz") as arrays:
        lammps_nc, reference_nc = arrays["f.lammps"], arrays["f.reference"]
    largest = np.abs((lammps_nc + reference_nc) / 2 - reference_nc).max(axis=1)
    np.testing.assert_allclose(np.abs(numbers(at["difference"], 60)), largest, rtol=2.0**-plots.SIZE)
    pairs = data["pairs"]
    assert (pairs["atom"], pairs["step"], pairs["count"], pairs["shown"]) == ([4], [0], [2], [2])
    assert pairs["names"] == ["force x", "drho"]  # all of the force is of pressure
    assert [numbers(column, 2).tolist() for column in pairs["pair"]] == [[1.0, 2.0], [0.5, -0.75]]
    assert [numbers(column, 1).tolist() for column in pairs["sum"]] == [[3.0], [-0.25]]


def test_a_long_page_has_the_other_steps_of_one_field(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    case = model(tmp_path, "m", 2)
    record = RunRecord(engine=EngineRecord(), reference={}, cases=[case])

    def more() -> list[Any]:
        write_report(record, tmp_path, FINDINGS)
        html = unpacked((tmp_path / "report.html").read_text())
        return [json.loads(text) for text in re.findall(r'class="more">(.*?)</script>', html)]

    (kept,) = more()
    assert {name: list(of["at"]) for name, of in kept.items()} == {"grad/v": ["0"], "pressure": ["0"]}
    monkeypatch.setattr(page, "WHOLE", 0)
    assert more() == []
    case.verdict = "differs"  # of one that is not accepted all are kept
    assert more() == [kept]


def test_only_the_nearest_pairs_are_listed() -> None:
    of = {"step": [0, 1], "atom": [1, 2], "count": [50, 1], "id": np.arange(51), "r": np.arange(51.0)}
    of |= {"names": ["drho"], "pair": np.arange(51.0)[:, None], "sum": [[1225.0], [50.0]]}
    found = plots._pairs({f"@pairs {name}": np.asarray(values) for name, values in of.items()})["pairs"]
    assert found["shown"] == [plots.NEIGHBOURS, 1] and found["count"] == [50, 1]
    assert numbers(found["id"]).tolist() == [*range(plots.NEIGHBOURS), 50]
    assert numbers(found["sum"][0]).tolist() == [1225.0, 50.0]


def test_digits_that_decide_are_kept() -> None:
    case = CaseRecord(case="x", verdict="differs")
    bound_n = np.array([1.0, 2.0, 3.0]) / 3
    arrays = {"id": np.arange(3), "type": np.ones(3), "x": np.zeros((3, 3)), "rho": np.ones(3)}
    arrays |= {"f.lammps": np.nextafter(bound_n, 2), "f.reference": np.zeros(3), "f.bound": bound_n}
    data, _ = plots.payload(case, arrays, plots.differences(arrays))
    assert data is not None
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


def test_colours_deepen_by_decades() -> None:
    depths = [page.shade(ratio, "pass") for ratio in (0.0, 1e-9, 2e-3, 0.02, 0.2, 1.0)]
    assert depths == sorted(depths) == [0, 0, 1, 2, 3, 4]
    depths = [page.shade(ratio, "differs") for ratio in (1.1, 1e4, 1e10, 1e15, 1e300, np.inf, np.nan)]
    assert depths == sorted(depths) and depths[0] == 4 and depths[-3:] == [9, 9, 9]
    assert page.shade(None, "differs") == 0


def test_findings_of_a_run(run: RunRecord, parsed: Page, html: str) -> None:
    found = {finding.entry.id: finding for finding in findings.of_run(run, FINDINGS)}
    assert list(found) == ["pairs", "gone", "elsewhere", "F-3", "open", "hostile"]  # severity, then status
    assert found["pairs"].cases == ["model.flat", "model.cube", f"hostile2.{NAME}"]
    assert found["pairs"].unseen == []  # of the particle model: a case's record says where it applies
    assert "ledger.artificial" in found["F-3"].cases
    assert (found["gone"].status, found["gone"].unseen) == ("unseen", ["model.cube"])
    assert found["open"].cases == ["eos.broken"]  # without a variant a difference is shown, not explained
    assert found["elsewhere"].status == "absent" and not found["elsewhere"].listed
    places = [a for tag, a in parsed.elements if tag == "details" and (a.get("class") or "").startswith("finding")]
    last = sorted(found, key=lambda name: found[name].status == "absent")
    assert [place["id"] for place in places] == [f"finding={name}" for name in last]
    absent = sum(finding.status == "absent" for finding in found.values())
    folded = html[html.index(f"{wording.counted(absent, 'finding')} of the ledger not applicable in this run") :]
    assert 'id="finding=elsewhere"' in folded and 'id="finding=pairs"' not in folded
    links = {a["href"] for tag, a in parsed.elements if tag == "a" and "href" in a}
    assert {"#finding=pairs", "#finding=F-3", "#case=model.flat", "#case=eos.broken"} <= links
    assert "applies to 1 case, not seen" in html and "not known of this version of LAMMPS" in html
    assert "About this run" in html and "this engine no longer shows gone" in html


def test_an_outcome_that_is_not_as_predicted_is_not_seen() -> None:
    entry = _entry("crash", applies_to=("[a-d]",), outcome="crashed")
    cases = [
        CaseRecord(case="a", verdict="explained", explained_by=["crash"]),
        CaseRecord(case="b", verdict="refused", expects="x"),
        CaseRecord(case="c", verdict="skipped"),
        CaseRecord(case="d", verdict="differs"),
    ]
    run = RunRecord(engine=EngineRecord(distribution="2025.7.22.4.0"), reference={}, cases=cases)
    (found,) = findings.of_run(run, (entry,))
    assert (found.cases, found.unseen) == (["a"], ["b", "d"])


def test_agreement(run: RunRecord, html: str, folder: Path) -> None:
    model, twins = agreement.matrices(run)
    assert (model.cases, model.steps, twins.cases) == (2, [0, 10], 1)
    assert [row.field for row in model.rows] == ["grad/v", "pressure", "f"]
    force = model.rows[2].cells[0]
    assert force is not None and (force.agree, force.explained.cases, force.explained.ratio) == (0, 2, 3e9)
    gradient = model.rows[0].cells[0]
    assert gradient is not None and (gradient.agree, gradient.inside.ratio, gradient.verdict) == (2, 0.5, "pass")
    assert 'title="model.flat">≤ 0.5</a>' in html
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert "### Agreement: LAMMPS against the reference (2 cases)" in text
    assert "| grad/v | 2 (0.5) | 2 explained (7e3) |" in text
    effect = "**title of pairs** effect of pairs."
    assert f"| high | {effect} | 2025.7.22.4.0 | 3 | `eos-ref report-bug pairs` |" in text
    assert "| high | `gone` | title of gone | 1 |" in text
    assert "> **Note:** this engine no longer shows gone" in text
    assert in_step_order(["zz", "f", "x", "aa"]) == ["x", "f", "aa", "zz"]  # unknown fields do no harm


def test_a_run_without_the_model(tmp_path: Path) -> None:
    cases = [scene(tmp_path, "a", EOSTable((WATER,)), np.linspace(990, 1010, 10))]
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=cases), tmp_path)
    html = unpacked((tmp_path / "report.html").read_text())
    assert 'id="agreement"' not in html and "#agreement" not in html and 'class="steps"' not in html
    assert "Agreement" not in (tmp_path / "summary.md").read_text()
    assert 'id="findings"' in html


def test_a_model_case_without_arrays_keeps_its_table(tmp_path: Path) -> None:
    case = model(tmp_path, "m", 2)
    (tmp_path / "fields" / "m.npz").unlink()
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=[case]), tmp_path)
    html = unpacked((tmp_path / "report.html").read_text())
    assert Page(html).data == {} and '<table class="steps">' in html and "data-field" not in html[: html.index("Plots")]


def _shown(folder: Path, address: str, tmp_path: Path) -> tuple[Page, str]:
    """Return the report as a browser has it at an address of its own, and its text; nothing failed in there."""
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--virtual-time-budget=8000"]
    options += ["--disable-background-networking", "--enable-logging=stderr", f"--user-data-dir={tmp_path}"]
    url = f"{(folder / 'report.html').as_uri()}#{address}"
    done = subprocess.run(["chromium", *options, "--dump-dom", url], capture_output=True, text=True, timeout=120)
    assert not re.findall(r"CONSOLE.*(?:Uncaught|Error|Refused)", done.stderr)
    return Page(done.stdout[: done.stdout.rindex("</html>")]), done.stdout


def test_a_page_of_many_cases_lists_some_of_them(run: RunRecord, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "LISTED", 8)
    html = unpacked(page.render(findings.outcome(run, FINDINGS), folder / "fields"))
    rows = [a for tag, a in Page(html).elements if tag == "tr" and "data-kind" in a]
    listed = [a["data-case"] for tag, a in Page(html).elements if tag == "article"]
    assert len(rows) == len(listed) == 8 < len(run.cases)
    bad = [case.case for case in findings.outcome(run, FINDINGS).unaccepted]
    assert set(bad) <= set(listed)
    assert f"8 of {len(run.cases)} cases are listed" in html and f"Cases ({len(run.cases)})" in html
    monkeypatch.setattr(page, "LISTED", 2)
    html = unpacked(page.render(findings.outcome(run, FINDINGS), folder / "fields"))
    assert [a["data-case"] for tag, a in Page(html).elements if tag == "article"] == sorted(bad[:2])


def test_of_a_deck_that_broke_off_lammps_words_are_its_own(run: RunRecord, folder: Path) -> None:
    why = OutlookRecord(cause="findings", findings=["F-3"], run=1, step=0, taken=20, after=3, steps=50)
    lost = "ERROR: Lost atoms: original 100 current 2"
    deck = CaseRecord(case="in.deck", verdict="refused", engine_error=lost, outlook=why, tags=["audit"])
    deck.unchecked = {"cv": "no thermal", "chi": "no walls", "heatflow": "no thermal"}
    alone = run.model_copy(update={"cases": [deck.model_copy(update={"message": wording.message(deck)})]})
    html = unpacked(page.render(findings.outcome(alone, FINDINGS), folder / "fields"))
    says, lists = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", html), re.findall(r"<li>([^<]*)</li>", html)
    assert ("LAMMPS said", f"<code>{lost}</code>") in says
    assert ("Why", wording.outlook(deck)) in says
    assert {"cv, heatflow: no thermal", "chi: no walls"} < {*lists}


@pytest.mark.slow
@pytest.mark.browser
@pytest.mark.parametrize(("case", "figures"), [("eos.types", 4 + 3), ("model.flat", 4)])
def test_a_browser_draws_a_case(run: RunRecord, folder: Path, tmp_path: Path, case: str, figures: int) -> None:
    shown, _ = _shown(folder, f"case={case}", tmp_path)
    # Of the cases, those of its family alone are unpacked.
    family = {record.case for record in run.cases if record.case.startswith(case.split(".")[0] + ".")}
    articles = {a["data-case"]: a for t, a in shown.elements if t == "article"}
    assert articles.keys() == family and [name for name, a in articles.items() if "hidden" not in a] == [case]
    plotted = [a for t, a in shown.elements if t == "div" and "js-plotly-plot" in (a.get("class") or "")]
    # A law per type; difference and bound, pressure, ratio. Of the model: ratio, both sides, bound, value.
    assert len(plotted) == figures


@pytest.mark.slow
@pytest.mark.browser
def test_an_address_opens_a_field_and_an_atom(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    with np.load(folder / "fields" / "model.flat.npz") as arrays:
        lammps_nc, reference_nc = arrays["f.lammps"], arrays["f.reference"]
    _, dom = _shown(folder, "case=model.flat&field=pressure&atom=4", tmp_path)
    assert re.search(r'data-field="pressure" aria-pressed="true"', dom) and "Atom 4, type" in dom
    row = re.search(r"<td[^>]*>f</td>((?:<td[^>]*>[^<]*</td>)*)", dom[dom.index("Atom 4, type") :])
    assert row is not None
    lammps, reference = (float(text) for text in re.findall(r"<td[^>]*>([^<]*)", row[1])[1:3])
    at = np.abs(lammps_nc - reference_nc)[3].argmax()
    digits = 2.0**-plots.VALUE + 2.0**-plots.SIZE + 1e-5  # binary ones of value and difference, decimal ones shown
    assert lammps == pytest.approx(lammps_nc[3, at], rel=digits)
    assert reference == pytest.approx(reference_nc[3, at], rel=digits, abs=digits * abs(lammps_nc[3, at]))


@pytest.mark.slow
@pytest.mark.browser
def test_step_and_neighbours_by_keys_and_clicks(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    step = "document.querySelector('article:not([hidden]) .step input')"
    box = "document.querySelector('.atom')?.innerText"
    titles = "[...document.querySelectorAll('figcaption')].map((each) => each.firstChild.textContent).join()"
    spot = "document.querySelectorAll('.js-plotly-plot')[2].data.findLast((one) => one.customdata)"
    with browser(tmp_path) as page:
        page.open(f"{(folder / 'report.html').as_uri()}#case=model.flat&field=f&step=10&atom=4")
        page.wait(f"{box}?.includes('Atom 4')")
        assert page.value("document.querySelector('.plots').getBoundingClientRect().top < innerHeight")
        assert page.value(titles).count("step 10") == 4 and page.value(f"{step}.value") == "1"
        after = page.value(f"{spot}.y.join()")
        assert "explain model.flat --atom 4 --step 10" in page.value(box)  # its pairs are kept of step 0 alone
        page.value(f"{step}.focus()")
        page.press("ArrowLeft")
        page.wait("location.hash === '#case=model.flat&field=f&step=0&atom=4'")
        assert page.value(titles).count("step 0") == 4 and page.value(f"{spot}.y.join()") != after
        assert page.value(f"{step}.getAttribute('aria-valuetext')").startswith("0 (the worst) of 0, 10")
        said = page.value(box)
        assert "2 neighbours at step 0, and what each pair adds (the reference)" in said and "explain" not in said
        rows = page.value("[...document.querySelectorAll('.neighbours tr')].map((row) => row.innerText.trim())")
        assert [row.split() for row in rows[1:]] == [
            ["7", "0.5", "1", "0.5"],
            ["9", "0.75", "2", "-0.75"],
            ["sum", "3", "-0.25"],
        ]
        page.value("document.querySelector('.neighbour').click()")
        page.wait("location.hash === '#case=model.flat&field=f&step=0&atom=7'")
        assert "Atom 7" in page.value(box)
        page.press("ArrowLeft")  # at its end: no other case is opened
        assert page.value("location.hash").startswith("#case=model.flat")
        assert page.complaints == []


@pytest.mark.slow
@pytest.mark.browser
def test_an_address_keeps_what_the_table_shows(run: RunRecord, folder: Path, tmp_path: Path) -> None:
    shown, dom = _shown(folder, "find=eos.water&sort=atoms&down", tmp_path)
    rows = [a for tag, a in shown.elements if tag == "tr" and "data-kind" in a]
    listed = re.search(r"(\d+) of (\d+) cases", dom)
    assert listed is not None and int(listed[2]) == len(run.cases)
    assert int(listed[1]) == sum("hidden" not in row for row in rows) == 1
    sorted_by = [a.get("aria-sort") for tag, a in shown.elements if tag == "th" and "aria-sort" in a]
    assert sorted_by == ["descending"]


def test_a_case_without_fields_does_not_show_an_older_run(tmp_path: Path) -> None:
    case = scene(tmp_path, "a", EOSTable((WATER,)), np.linspace(990, 1010, 10))
    case.fields, case.verdict = [], "crashed"
    write_report(RunRecord(engine=EngineRecord(), reference={}, cases=[case]), tmp_path)
    assert Page(unpacked((tmp_path / "report.html").read_text())).data == {}


def test_junit(run: RunRecord, folder: Path) -> None:
    suite = ET.parse(folder / "junit.xml").getroot()[0]
    outcomes = {c.get("name"): {child.tag for child in c} for c in suite.iter("testcase")}
    assert len(outcomes) == len(run.cases) == int(suite.get("tests", 0))
    assert outcomes["eos.broken"] == {"failure"}
    assert all(outcomes[name] == {"error"} for name in ("refuse.surprise", "crash.segfault", "slow.timeout"))
    assert outcomes["skip.plugin"] == {"skipped"}
    assert outcomes["refuse.gamma"] == outcomes["ledger.artificial"] == {"system-out"}
    assert outcomes["eos.types"] == set()
    assert [suite.get(name) for name in ("failures", "errors", "skipped")] == ["1", "3", "1"]
    classes = {c.get("name"): c.get("classname") for c in suite.iter("testcase")}
    assert classes["eos.water.near"] == "eos-ref.eos"
    crash = suite.find("testcase[@name='crash.segfault']/error")
    assert crash is not None and crash.get("message") == HOSTILE.replace("\x1b", "")
    assert suite.find("properties/property[@name='engine.distribution']") is not None


def test_summary(run: RunRecord, folder: Path) -> None:
    text = (folder / "summary.md").read_text(encoding="utf-8")
    assert text.startswith(
        "## eos-ref: 🔴 FAIL\n\n4 cases not as expected: 1 refused, 1 differs, 1 timeout, 1 crashed; "
    )
    table = text[text.index("### Not accepted") : text.index("> **Note")]
    rows = [line for line in table.splitlines() if line.startswith("|")]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {8}
    assert [row.split("`")[1] for row in rows[2:]] == [
        "crash.segfault",
        "slow.timeout",
        "eos.broken",
        "refuse.surprise",
    ]
    assert "| differs | pressure | eos | 6 | ∞ |" in table
    assert "<summary>Most digits lost</summary>" in text and "2025.7.22.4.0" in text


def test_arrays_are_read_as_numpy_reads_them(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    written = {
        "f.lammps": np.array([np.nan, -0.0, 1e-310]),
        "x": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    }
    written |= {"id": np.arange(3), "type": np.arange(3, dtype=np.int32), "none": np.empty((0, 3))}
    files.write_arrays(path, written)
    found = read_arrays(path)
    with np.load(path) as loaded:
        assert found.keys() == set(loaded.files)
        for name in loaded.files:
            np.testing.assert_array_equal(found[name], loaded[name])
            assert found[name].dtype == loaded[name].dtype


def test_thinning() -> None:
    ratio_n = np.zeros(1000)
    ratio_n[[3, 500]] = np.inf, 2.0
    picked = plots.thinned(ratio_n, np.arange(1000.0), np.ones(1000), 40)
    assert picked.size == np.unique(picked).size == 40
    assert {3, 500, 999} <= set(picked.tolist())
    assert plots.thinned(ratio_n, np.arange(1000.0), np.ones(1000), 1000).size == 1000


def test_same_bytes_again(run: RunRecord, folder: Path) -> None:
    names = ("report.html", "summary.md", "junit.xml")
    before = [(folder / name).read_bytes() for name in names]
    write_report(run, folder, FINDINGS)
    assert [(folder / name).read_bytes() for name in names] == before
    assert sorted(path.name for path in folder.iterdir()) == sorted([*names, "fields"])


def test_plotly_must_be_there(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match="plotly"):
        write_report(RunRecord(engine=EngineRecord(), reference={}), tmp_path)
