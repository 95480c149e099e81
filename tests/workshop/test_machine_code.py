"""Faults planted in LAMMPS' machine code, by the campaign of `make binary`."""

from __future__ import annotations

import pytest

from tests.workshop import machine_code
from tests.workshop.machine_code import TRAP, Library, Site

pytestmark = [pytest.mark.lammps, pytest.mark.slow]
CASE = "ranges.background-ranges"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Library:
    return Library("env", tmp_path_factory.mktemp("machine"))


@pytest.fixture(scope="module")
def sites(library: Library) -> list[Site]:
    return machine_code.sites(library.place)


def test_sites_are_instructions_of_rheo_classes(sites: list[Site]) -> None:
    assert {site.kind for site in sites} == {
        *("operation exchanged", "condition turned", "store left out", "call left out")
    }
    assert all("RHEO" in site.function.partition("::")[0] for site in sites)
    assert {"PairRHEO::compute", "FixRHEOPressure::calc_pressure"} <= {site.function for site in sites}
    assert not machine_code.OTHERS & {site.function.partition("::")[0] for site in sites}
    assert all(site.old != site.new and len(site.old) == len(site.new) for site in sites)
    assert len({site.offset for site in sites}) == len(sites)


def test_fault_is_planted_alone_and_reverted(library: Library, sites: list[Site]) -> None:
    right = library.place.read_bytes()
    library.plant(sites[0])
    wrong = library.place.read_bytes()
    differing = [k for k in range(len(right)) if right[k] != wrong[k]]
    assert differing and set(differing) <= {*range(sites[0].offset, sites[0].offset + len(sites[0].old))}
    library.plant(None)
    assert library.place.read_bytes() == right


def test_replaced_operation_on_pressures_is_detected(library: Library, sites: list[Site]) -> None:
    """Only one case, of pressures, is run; an instruction that it reaches traps."""
    pressures = [site for site in sites if site.function == "FixRHEOPressure::calc_pressure"]
    library.plant(None)
    assert library.red(CASE) == ""
    seen = ""
    for site in (site for site in pressures if site.kind == "operation exchanged"):
        library.plant(site)
        if seen := library.red(CASE):
            library.plant(site, TRAP)
            assert library.red(CASE).startswith("crashed")
            break
    assert seen.startswith("differs")
    assert CASE in seen


def test_traps_record_what_a_case_reaches(library: Library) -> None:
    """Those of its law, not those of heat; the traps do not change its numbers."""
    library.plant(None)
    assert library.red(CASE) == ""
    reaching = library.reached(CASE)
    assert library.changed({CASE}) == set()
    assert {case for cases in reaching.values() for case in cases} == {CASE}
    of = {function for function, offset, _ in machine_code.instructions(library.place) if offset in reaching}
    assert "FixRHEOPressure::calc_pressure" in of and "PairRHEO::compute" not in of


@pytest.mark.parametrize("reaching", [(), (CASE,)])
def test_instruction_without_effect_on_numbers_is_classified(
    library: Library, sites: list[Site], reaching: tuple[str, ...]
) -> None:
    """An instruction of heat, of which the case has none, in place of one that it reaches without effect."""
    site = next(site for site in sites if site.function == "FixRHEOThermal::post_integrate")
    if reaching:
        library.plant(None)
        library.reached(CASE)
    expected = ("without effect", "") if reaching else ("not reached", "")
    assert machine_code.outcome(library, site, reaching, quick={CASE}) == expected


def test_name_of_another_package_is_ignored() -> None:
    assert machine_code._function("_ZN9LAMMPS_NS8PairRHEO7computeEii") == "PairRHEO::compute"
    assert machine_code._function("_ZN9LAMMPS_NS8PairRHEOC1EPNS_6LAMMPSE") == "PairRHEO::PairRHEO"
    assert machine_code._function("_ZTv0_n48_N9LAMMPS_NS11AtomVecRHEO11force_clearEim") == "AtomVecRHEO::force_clear"
    assert machine_code._function("_ZN9LAMMPS_NS8PairRHEOC2EPNS_6LAMMPSE") == ""
    assert machine_code._function("_ZN9LAMMPS_NS7PairLJC1Ev") == ""
    assert machine_code._function("_ZNK9LAMMPS_NS13BondRHEOShell6singleEv") == ""
