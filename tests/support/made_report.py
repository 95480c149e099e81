"""A run with a case of every kind, made without LAMMPS, and the numbers in its page."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np

from eos_ref import EOS, EOSTable
from eos_ref.eos import bounds
from lammps_cases.comparison import compare
from lammps_cases.findings import Finding
from lammps_cases.findings.variants import Variant
from lammps_cases.records import case_wording, files
from lammps_cases.records.case_parts import Blame, CheckRecord, FieldRecord, LawRecord, Seconds, StepRecord
from lammps_cases.records.run_record import CaseRecord, EngineRecord, RunRecord
from lammps_cases.verdict import case_arrays
from tests.support.made_findings import finding

HOSTILE = "<img src=x onerror=alert(1)> | `b` </script><script>alert(2)</script> \x1b[31m & ]]> *x*"
NAME = HOSTILE.replace("/", "")  # of a case, which is that of a file
WATER = EOS("tait/water", rho0=1000.0, cs=10.0)


def laws_of(table: EOSTable) -> list[LawRecord]:
    return [LawRecord.of(t, law, 1.5) for t, law in enumerate(table.laws, 1)]


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
    """A case whose "LAMMPS" is the reference perturbed by a fraction of the bound, and wrong on some atoms."""
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
    box = np.stack([x_nc.min(0) - 0.25, x_nc.max(0) + 0.25])
    arrays = {"id": id_n, "type": type_n, "x": x_nc, "rho": rho_n, "box": box}
    sides = {"pressure": (found.lammps_n, found.reference_n, found.bound_n), "rho": (rho_n, rho_n, np.zeros(count))}
    for field, values in sides.items():
        arrays |= {f"{field}.{side}": of for side, of in zip(("lammps", "reference", "bound"), values, strict=True)}
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
        laws=laws_of(table),
        reproduce=f"eos-ref run '{name}'",
        **more,
    )


def ended() -> list[CaseRecord]:
    """Cases without arrays, one of every verdict possible."""
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
    return {key: np.asarray(values) for key, values in found.items()}


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
    case_arrays.write(folder / "fields", name, beside(arrays))
    values = {"lammps": 1.5, "reference": 0.5, "bound": 1e-14}
    first = Blame(field="f", stage="pair", step=0, atom=4, outside=1, of=count, **values)
    laws = laws_of(EOSTable((WATER,)))
    more = {"natoms": count, "steps": 10, "dimension": dimension, "blame": first, "laws": laws}
    record = CaseRecord(case=name, verdict="explained", fields=fields, **more)
    record.message = case_wording.message(record)
    return record


def entry(name: str, **more: Any) -> Finding:
    known = {"title": f"title of {name}", "effect": f"effect of {name}", "documented": "this", "observed": "that"}
    known |= {"argument": "so", "workaround": "-", "number": 0, "engines": ("2025.7.22.4.0",)}
    return finding(name, **(known | more))


FINDINGS = (
    entry("elsewhere", severity="high", engines=("2024.1.1",), applies_to=("*",)),
    entry("F-3", severity="medium", model=Variant(lambda scene: True)),
    entry("pairs", severity="high", applies_to=("*",), model=Variant(lambda scene: True)),
    entry("gone", severity="high", model=Variant(lambda scene: True)),
    entry("open", applies_to=("eos.broken",)),
    entry("hostile", **dict.fromkeys(("title", "effect", "documented", "observed", "argument", "scene"), HOSTILE)),
)


def audit() -> CaseRecord:
    """An audited deck: samples over time, no arrays."""
    common = {"run": 1, "natoms": 400, "verdict": "pass", "max_abs": 1e-13}
    checks = [
        CheckRecord(step=10 * k, type=t, max_over_bound=0.07 * t * (k % 7), worst_id=k, **common)
        for k in range(400)
        for t in (1, 2)
    ]
    worst = {"max_over_bound": 0.84, "atom_type": 2, "worst_step": 60, "worst_id": 6}
    return CaseRecord(
        case="audit.in.dam",
        tags=["audit"],
        verdict="pass",
        warnings=["cs is below 10 times the largest velocity"],
        checks=checks,
        laws=laws_of(EOSTable((WATER,))),
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
        scene(folder, "eos.states", one, states, lint=["m/rho is 1: V cannot be distinguished from 1"]),
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


def numbers(text: str | float, count: int = 1) -> np.ndarray:
    if not isinstance(text, str):
        return np.full(count, text)
    width = {"d": 8, "f": 4, "b": 2}[text[0]]
    planes = np.frombuffer(base64.b64decode(text[2:]), np.uint8).reshape(width, -1)
    upper = np.pad(planes, ((width % 4, 0), (0, 0)))  # of a float32
    return np.frombuffer(upper.T.tobytes(), "<f8" if width == 8 else "<f4").astype(float)


def column(data: dict[str, Any], name: str, field: str = "") -> np.ndarray:
    return numbers(data["fields"][field][name] if field else data[name], data["n"])
