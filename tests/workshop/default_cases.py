"""The cases of `eos-ref run` without names: the fewest that see what all of them see.

``python -m tests.workshop.default_cases`` writes the names of the others, which get the tag more, into
``lammps_cases/data/more.txt``, and prints the table of docs/trust.md. The choice is an integer program: so
many cases of each group, the fewest in all. With ``--missed`` it lists what `missed` finds (half an hour).
"""

from __future__ import annotations

import re
import sys
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from lammps_cases.claims.model import Claim, claims
from lammps_cases.claims.verdicts import Names
from lammps_cases.comparison.predictor import Predictor
from lammps_cases.comparison.store import open_store
from lammps_cases.records.files import write_atomically
from lammps_cases.records.outcome import CaseOutcome
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile
from lammps_cases.scene.casefile import Case
from lammps_cases.scene.changes import catalogue
from lammps_cases.verdict.exercise import can_see, exercised
from lammps_cases.versions import baseline
from lammps_cases.versions.evidence import BASELINES, ROOT
from tests.workshop.faults.schedule import cost
from tests.workshop.fuzz.schema import taken

WITNESSES = 2  # cases, where there are so many
TWICE = ("change", "finding")  # in each dimension, and on each engine
WHOLE = {"quick", "refusal", "manual", "crash", "open"}  # tags of cases that are unlike all others
DOCUMENTS = ("*.md", "docs/*.md", "eos_ref/*.md", "lammps_cases/data/findings/*.md")
# Cases that measurements need (27 November 2026): second witnesses of changes that no case names (`missed`), the only
# cases that reach instructions of RHEO's functions (traps of `make binary`) or see a fault of `make power`.
MEASURED = {
    "constants.metal",
    "constants.real",
    "cross-type-walls.newton.3d",
    "edges-growth.deformed.heat",
    "edges-growth.deformed.surface",
    "edges-shared.freezing.2d",
    "edges-shared.high.3d",
    "ghosts.walls",
    "masses.surface.3d",
    "runs-walls.heat.files",
    "runs.fluid.settings",
    "sheared-walls.tilted",
    "status-open.divergence",
    "status-open.newton",
    "tilted-close.summed",
    "tilted.small.walls",
    "units.real.linear",
}

What = tuple[str, ...]  # kind, name, and dimension or engine
Groups = dict[What, set[str]]


def _seen(cases: Sequence[Case]) -> Iterator[tuple[What, str]]:
    """Yield everything that a case stands for: kind, name, dimension or engine; and the case."""
    witnesses: dict[tuple[str, str], str] = {}  # two cases of one scene are one witness
    for case in cases:
        dimension = f"{case.scene.dimension}d"
        scene = case.scene.model_dump_json(exclude={"compare", "engine", "manual", "twin"})
        for change in case.exercises:
            yield ("change", change, dimension), witnesses.setdefault((change, scene), case.name)
        for choice in taken(case.scene.model_dump(mode="json", exclude_defaults=True)):
            yield ("choice of a scene", choice, dimension), case.name
        yield ("file of cases", case.source.stem, dimension), case.name
        if WHOLE & {*case.tags}:
            yield ("case by itself", case.name), case.name
    names = Names(case.name for case in cases)
    for claim in claims():
        for pattern in claim.cases:
            for name in names.matching(pattern):
                yield ("case of a claim", claim.id, pattern), name
    refutable = [(claim, {*names.of(claim)}) for claim in claims() if claim.refuted_by]
    for folder in sorted(BASELINES.glob("lammps-*")):
        for case_outcome in baseline.read(folder).cases.values():
            yield from _shown(case_outcome, folder.name, refutable)
    words = {
        word for place in DOCUMENTS for path in ROOT.glob(place) for word in re.findall(r"[\w.-]+\w", path.read_text())
    }
    for name in words.intersection(case.name for case in cases) | MEASURED:
        yield ("case by itself", name), name


def _shown(case: CaseOutcome, engine: str, refutable: Sequence[tuple[Claim, set[str]]]) -> Iterator[tuple[What, str]]:
    """Yield the findings that a case shows on an engine, and the claims that they refute there."""
    for field, findings in (("", case.explained_by), *((of.name, of.explained_by) for of in case.fields.values())):
        yield from ((("finding", finding, engine), case.case) for finding in findings)
        for claim, of in refutable:
            asked = not claim.fields or field in ("", *claim.fields)
            if asked and case.case in of and {*findings} & {*claim.refuted_by}:
                yield ("claim refuted", claim.id, engine), case.case


def groups() -> Groups:
    """Return by all that has to be seen the cases that see it, of those that are not tagged long."""
    cases = casefile.select(casefile.load(), tag=casefile.ALL)
    known, found = {case.name for case in cases}, defaultdict[What, set[str]](set)
    for what, name in _seen(cases):
        if name in known:
            found[what].add(name)
    return dict(found)


def wanted(what: What, group: Collection[str]) -> int:
    """Return how many cases of a group have to run."""
    return min(WITNESSES if what[0] in TWICE else 1, len(group))


def lacking(chosen: Collection[str], found: Groups) -> list[What]:
    """Return what too few of some cases see."""
    return [what for what, group in found.items() if len(group.intersection(chosen)) < wanted(what, group)]


def fewest(found: Groups) -> set[str]:
    """Return the fewest cases that see everything; of as few, the cheapest."""
    cases = casefile.select(casefile.load(), tag=casefile.ALL)
    cost_c = np.array([cost(case) for case in cases], float)
    of_gc = np.array([[case.name in group for case in cases] for group in found.values()], float)
    solved = milp(
        1 + cost_c / (2 * cost_c.sum()),
        constraints=LinearConstraint(of_gc, lb=[wanted(what, group) for what, group in found.items()]),
        integrality=np.ones(len(cases)),
        bounds=Bounds(0, 1),
        options={"mip_rel_gap": 0},
    )
    return {case.name for case, runs in zip(cases, solved.x, strict=True) if runs > 0.5}


def missed() -> Iterator[tuple[str, str]]:
    """Yield cases tagged more, and changes that they see, but fewer than two others before them of their dimension."""
    seen, predictor = Counter[tuple[str, int]](), Predictor(open_store())
    cases = filter(can_see, casefile.select(casefile.load(), tag=casefile.ALL))
    for case in sorted(cases, key=lambda case: casefile.MORE in case.tags):
        seen.update((change, case.scene.dimension) for change in case.exercises)  # every run verifies these
        unnamed = (change for change in catalogue() if change not in case.exercises)
        left = [change for change in unnamed if seen[change, case.scene.dimension] < WITNESSES]
        ready = prepare(case)
        for change, moved in exercised(case, ready.eos, ready.atoms, predictor, left).items():
            seen[change, case.scene.dimension] += bool(moved)
            if moved and casefile.MORE in case.tags:
                yield case.name, change


def main() -> None:
    """Write the names of all other cases, and print what the chosen ones see."""
    if "--missed" in sys.argv:
        for witness in missed():
            print(*witness, flush=True)
        return
    found = groups()
    every, chosen = set().union(*found.values()), fewest(found)
    write_atomically(casefile.BEYOND, "".join(f"{name}\n" for name in sorted(every - chosen)))
    print(f"{len(chosen)} of {len(every)} cases\n| what | how many | default cases of each |\n|---|---|---|")
    for kind, count in Counter(what[0] for what in found).items():
        print(f"| {kind} | {count} | {WITNESSES if kind in TWICE else 1} or more |")


if __name__ == "__main__":
    main()
