"""Kinds of user decks: what an audit finds in a block of fluid (tests/decks/in.block) with words changed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lammps_cases.audit.options import AuditOptions
from lammps_cases.audit.supervise import audit_deck
from lammps_cases.records.run_record import CaseRecord

BLOCK = (Path(__file__).parents[2] / "decks" / "in.block").read_text()
Edits = list[tuple[str, str]]

RHEO = "quintic 0 density"
PERIODIC, OPEN = "boundary     p p p", "boundary     f f p"
ROOM: Edits = [
    (PERIODIC, OPEN),
    ("box block 0 10 0 10", "box block -5 15 -5 15"),
    ("create_atoms 1 box", "region fluid block 0 10 0 10 -0.5 0.5\ncreate_atoms 1 region fluid"),
]
LATTICE: Edits = [
    ("displace_atoms all random 0.1 0.1 0 4711 units box\n", ""),
    ("velocity     all create 0.0005 8123 loop geom\n", ""),
]
HOT: Edits = [("atom_style   rheo", "atom_style   rheo/thermal"), (RHEO, "quintic 0 thermal density")]
STILL = "set type 2 rheo/status 1\nfix 0 all setforce 0 0 0\n"
HEAT = "fix 5 all rheo/thermal conductivity * constant {} specific/heat * constant 1.0\nrun          "
WARM = "variable e atom 1+0.5*sin(PI*x/5)\nset group all sph/e v_e\nvelocity "


def case_of(folder: Path, edits: Edits, trust: bool = False) -> CaseRecord:
    """Audit the block with some words changed."""
    text = BLOCK
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (folder / "in.deck").write_text(text)
    return audit_deck(folder / "in.deck", AuditOptions(trust=trust)).record.cases[0]


def acting(case: CaseRecord) -> dict[str, str]:
    return {of.finding: of.does for of in case.acting}


pytestmark = pytest.mark.lammps

# Findings whose effect follows from LAMMPS' list of the sample, and the fields that they explain.
EXPLAINED: dict[str, tuple[Edits, dict[str, set[str]]]] = {
    "pairs across boundaries": (
        [("units        lj", "newton off on\nunits lj")],
        {"grad/v": {"boundary-pairs-twice"}, "f": {"boundary-pairs-twice", "force-per-volume"}},
    ),
    "interface of two fluids": (
        [(RHEO, "RK1 8 shift scale/cross/type 0.05 0.02 0.5 density")],
        {"shift/v": {"cross-type-support", "cross-type-normal"}, "f": {"force-per-volume"}},
    ),
    "particles of two masses": (
        [
            (
                "mass         * 1.0",
                "mass * 1.0\nfix m all property/atom rmass ghost yes\nset group all mass 1.0\nset type 2 mass 1.3",
            )
        ],
        {"f": {"mass-of-first", "force-per-volume"}},
    ),
}


@pytest.mark.parametrize("kind", EXPLAINED)
def test_effects_of_neighbour_lists_are_explained(kind: str, tmp_path: Path) -> None:
    edits, by_field = EXPLAINED[kind]
    case = case_of(tmp_path, edits)
    assert case.verdict == "explained"
    found = {field.field: set(field.explained_by) for field in case.fields if field.explained_by}
    assert {name: found[name] for name in by_field} == by_field
    assert {name for names in by_field.values() for name in names} <= {*acting(case), "force-per-volume"}


def stale_memory_of(byte: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fill allocated memory with a byte; only a trusted deck gets these variables."""
    monkeypatch.setenv("MALLOC_PERTURB_", str(255 - byte))
    monkeypatch.setenv("GLIBC_TUNABLES", "glibc.malloc.tcache_count=0")  # what the cache returns is not filled


def test_fields_from_stale_memory_are_not_predictable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All other fields are compared, and nothing differs."""
    stale_memory_of(0, monkeypatch)
    case = case_of(tmp_path, [(RHEO, "RK1 60 density")], trust=True)
    assert case.verdict == "explained" and acting(case).keys() == {"stale-gradient-below-zmin"}
    compared = {field.field for field in case.fields}
    assert compared == {"coordination", "viscosity", "pressure", "drho"}
    assert all(field.verdict in ("exact", "pass") for field in case.fields)
    for name in ("f", "grad/v", "stress/v", "stress/t"):
        assert case.unchecked[name].startswith("not predictable in steps 0 to 20, because of the known bug stale-")


def test_stop_caused_by_stale_memory_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Eight bytes of 127 are the double 1.4e306."""
    stale_memory_of(127, monkeypatch)
    case = case_of(tmp_path, [*ROOM, (RHEO, "RK1 20 density")], trust=True)
    assert case.verdict == "refused" and case.outlook is not None
    assert (case.outlook.cause, case.outlook.findings) == ("findings", ["stale-gradient-below-zmin"])
    assert {field.verdict for field in case.fields} <= {"exact", "pass", "explained"}


def test_fields_reading_velocities_of_images_are_exempt_together(tmp_path: Path) -> None:
    leaning = ("box block 0 10 0 10 -0.5 0.5", "box prism 0 10 0 10 -0.5 0.5 0 0 0")
    sheared = ("run          20", "fix 5 all deform 1 xy erate 0.01 remap v\nrun 20")
    case = case_of(tmp_path, [leaning, sheared, (RHEO, "quintic 0 shift density")])
    assert case.verdict == "explained"  # by definition: the volumes are not 1
    of_images = {
        name for name, why in case.unchecked.items() if why.endswith("gives images other velocities (remap v)")
    }
    assert of_images == {"grad/v", "shift/v", "f", "stress/v", "stress/t"}


# Findings that act by the definitions of a deck though no field compared shows them.
ACTING: dict[str, tuple[Edits, str, str]] = {
    "volumes at rest": (
        [*LATTICE, ("mass         * 1.0", "mass * 0.2")],
        "force-per-volume",
        "forces of pairs are 5 times what they should be",
    ),
    "volumes of one type": (
        [*LATTICE, ("mass         * 1.0", "mass 1 1.0\nmass 2 0.5")],
        "force-per-volume",
        "forces of pairs are 2 times what they should be for type 2",
    ),
    "a gas": (
        [*HOT, ("velocity ", WARM), ("* linear", "* ideal/gas 1.4"), ("run          ", HEAT.format(0.0))],
        "gas-without-work",
        "Sound in an ideal gas is too slow by a factor of sqrt(gamma)",
    ),
    "summed solids": (
        [*LATTICE, (RHEO, "quintic 0 rho/sum density"), ("timestep ", f"{STILL}timestep ")],
        "solids-summed",
        "Solids do not keep the density they were given",
    ),
    "order zero": (
        [*LATTICE, (RHEO, "RK0 0 density")],
        "kernel-corrects-gradients-only",
        "RK0 corrects nothing",
    ),
}


@pytest.mark.parametrize("kind", ACTING)
def test_findings_acting_without_a_difference_are_named(kind: str, tmp_path: Path) -> None:
    edits, finding, does = ACTING[kind]
    case = case_of(tmp_path, edits)
    assert acting(case)[finding].startswith(does)
    assert finding in case.explained_by and case.verdict == "explained"


def test_deck_unaffected_by_bugs_is_exact(tmp_path: Path) -> None:
    case = case_of(tmp_path, LATTICE)
    assert case.verdict == "exact" and not case.acting and not case.warnings


@pytest.mark.parametrize("steps", [40, 700])
def test_diverging_heat_has_a_cause(steps: int, tmp_path: Path) -> None:
    """The bug multiplies heat flows by 1/(m cv) = 16: from some step on energies overflow."""
    edits = [
        *HOT,
        ("velocity ", WARM),
        ("lattice      sq 1.0", "lattice sq 16.0"),
        ("mass         * 1.0", "mass * 0.0625"),
        ("box block 0 10 0 10", "box block 0 2.5 0 2.5"),
        ("region       right block 5 10", "region right block 1 2.5"),
        ("displace_atoms all random 0.1 0.1", "displace_atoms all random 0.02 0.02"),
        ("sin(PI*x/5)", "sin(PI*x/1.25)"),
        ("pair_style   rheo 3.0 artificial/visc 1.0", "pair_style rheo 0.75"),
        ("rheo 3.0 quintic", "rheo 0.75 quintic"),
        ("run          20", HEAT.format(0.1) + str(steps)),
        ("4 all enforce2d", "4 all setforce 0 0 0"),
    ]
    case = case_of(tmp_path, edits)
    assert case.broke is not None and (case.broke.kind, case.broke.column) == ("runaway", "energy")
    assert case.outlook is not None and case.outlook.findings == ["heat-is-temperature-rate"]
    assert case.verdict == "error" and not any(field.verdict == "differs" for field in case.fields)


def test_coinciding_particles_break_a_deck(tmp_path: Path) -> None:
    """Neither code defines forces there, so there is no difference between them."""
    case = case_of(
        tmp_path, [*LATTICE, ("set          group", "create_atoms 1 single 3.0 4.0 0.0\nset          group")]
    )
    assert case.verdict == "error" and case.broke is not None
    assert (case.broke.kind, case.broke.step, case.broke.both) == ("not a number", 0, True)
    assert case.outlook is not None and case.outlook.because == "atoms 44 and 101 lie at the same place"
    assert not any(field.verdict == "differs" for field in case.fields)


# Questionable set-ups, by the sample in which they are worst.
WARNED: dict[str, tuple[Edits, str]] = {
    "a column across the boundary": (
        [*LATTICE, ("box block 0 10 ", "box block 0 10.3 ")],
        "atoms 1 and 11 are 0.3 apart across a boundary, 0.3 of the spacing 0.999 (10 pairs closer than 0.5 of it)",
    ),
    "a fluid that falls": (
        [*LATTICE, ("run          20", "fix 5 all addforce 0.1 0 0\nrun 120")],
        "type 1: speed of sound 1 is 1.67 times the largest speed of its fluid, 0.597",
    ),
    "masses of a summed fluid": (
        [*LATTICE, (RHEO, "quintic 0 rho/sum density"), ("mass         * 1.0", "mass * 0.75")],
        "type 1: m = 0.75 is 0.75 times rho0 V",
    ),
    "weight by addforce": (
        [*ROOM, *LATTICE, ("run          20", "fix 5 all addforce 0.0 -0.02 0.0\nrun 10")],
        "speed of sound 1 is 2.24 times sqrt(g h) = 0.447 (g = 0.02, fluid of height 10)",
    ),
    "particles that are added": (
        [
            *LATTICE,
            ("density 1.0 1.0", "density 5.0 5.0"),
            ("mass         * 1.0", "mass * 5.0"),
            ("rheo/rho 1.0", "rheo/rho 5.0"),
            ("run          20", "run 10\ncreate_atoms 1 single 2.5 2.5 0.0\nrun 10"),
        ],
        "type 1: rho is 0.2 times rho0 = 5 (1, atom 101; 1 of 51 fluid particles are off)",
    ),
}


@pytest.mark.parametrize("kind", WARNED)
def test_questionable_set_ups_are_those_of_the_worst_sample(kind: str, tmp_path: Path) -> None:
    edits, line = WARNED[kind]
    warnings = case_of(tmp_path, edits).warnings
    assert any(line in warning for warning in warnings), warnings


@pytest.mark.parametrize("lost, count", [("ignore", 10), ("warn", 10)])
def test_lost_particles_are_counted(lost: str, count: int, tmp_path: Path) -> None:
    drift = [
        (PERIODIC, OPEN),
        *LATTICE,
        ("timestep ", f"velocity all set 0.5 0 0\nthermo_modify lost {lost}\ntimestep "),
        ("run          20", "run 60"),
    ]
    case = case_of(tmp_path, drift)
    assert case.lost is not None and case.lost.ignored
    assert (case.lost.lost, case.lost.of) == (count, 100) and not math.isnan(case.lost.step)
