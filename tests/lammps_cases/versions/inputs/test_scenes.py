"""Inputs that are refused here, and LAMMPS' reaction to them: every refusal has a row, every class is computed."""

from __future__ import annotations

import ast
import contextlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

import eos_ref
from eos_ref import InputError
from lammps_cases import scene
from lammps_cases.claims.probes import probe
from lammps_cases.claims.probes.probe import base, error_words, names_it, offending, reaction
from lammps_cases.claims.probes.run import Reply, put
from lammps_cases.engine.workers import Workers
from lammps_cases.versions.inputs.generate import generated
from lammps_cases.versions.inputs.refusals import BadInput, bad_inputs, parse, refusal
from lammps_cases.versions.inputs.table import InputRow, row, table
from tests.support.bad_scenes import BAD
from tests.support.progress import Steps

BY_ID = {bad.id: bad for bad in bad_inputs()}

# Refusals of a scene that cannot be tried on LAMMPS, and why.
NOT_FOR_LAMMPS = {
    "how the reference evaluates": "method-of-a-scene tolerance-of-a-scene",
    "a scene needs positions; without particles it is empty-scene": "missing-key",
    "densities are given to LAMMPS one by one": "two-ways-to-give-a-field values-of-wrong-length log-through-zero",
    "ten billion particles fit into no memory here": "too-many-particles",
    "files of the scene": "file-outside file-missing table-missing",
    "keys of the scene file": "raw-commands viscosity-of-the-engine velocity-in-evolve",
    "LAMMPS' words have no types": "quoted-number",
    "what is compared": (
        "nothing-to-compare field-twice expectation-that-fits-any-error steps-out-of-order "
        "forces-in-real-units-of-a-plane steps-beyond-the-end nothing-to-compare-at"
    ),
    "limits of the harness": "time-limit 65-ranks cells-beyond-any-number",
    "LAMMPS' velocities always have three components": "velocity-of-a-type",
    "LAMMPS has more forces than the reference": "unknown-force",
    "particles are given to LAMMPS one by one": (
        "lattice-of-another-dimension region-of-three-axes region-without-type list-of-particles,-a-lattice's-key "
        "list-of-particles,-box-inside-out list-of-particles,-type-beyond list-of-particles,-types-of-two "
        "list-of-particles-in-space list-of-particles-of-three-components"
    ),
    "the same as empty-scene": "everything-removed",
    "velocities are given to LAMMPS one by one": (
        "velocities-together-with-random velocities-together-with-that-of-a-type velocities-of-three-components "
        "velocities-of-too-few"
    ),
}


@pytest.fixture(scope="module")
def rows() -> dict[str, InputRow]:
    """Return the whole table, measured on LAMMPS."""
    progress = Steps()
    with Workers(None, 2) as workers:
        found = table(workers, progress, bad_inputs())
    assert progress.done == [(k, len(found), "bad inputs") for k in range(1, len(found) + 1)]
    return {one.id: one for one in found}


def slug(what: str) -> str:
    return re.sub("[ _]+", "-", what.lower())


# --- the list


def test_every_refusal_of_a_scene_has_a_row_or_a_reason() -> None:
    """The reasons name refusals without a row."""
    reasons = " ".join(NOT_FOR_LAMMPS.values()).split()
    assert {slug(what) for what in BAD} - set(BY_ID) == set(reasons)
    assert not set(reasons) & set(BY_ID) and len(set(reasons)) == len(reasons)


def test_inputs_are_refused_here_with_a_clear_error() -> None:
    """This is judged by the rule for LAMMPS: a refusal for another reason would not name the quantity."""
    assert len(BY_ID) == len(bad_inputs()) >= 60
    for id, bad in BY_ID.items():
        assert bad.input  # every text to be replaced exists
        assert bad.names or offending(bad), id
        assert bad.refusal, f"{id} is not refused here"
        place, _, rest = bad.refusal.partition(":")
        words = (*bad.names, *offending(bad), *(bad.scene or {}))
        assert names_it(f"{place.replace('.', ' ')}:{rest}", words), (id, bad.refusal)


def test_row_of_a_scene_has_the_scenes_refusal() -> None:
    """If a scene raises the refusal, the row named after it has its first words."""
    rows = {what: bad for what in BAD if (bad := BY_ID.get(slug(what))) and bad.scene is not None}
    assert rows
    for what, bad in rows.items():
        _, parts = BAD[what]
        assert all(part in bad.refusal for part in parts[:1]), (what, bad.refusal)


# --- every rule of the reference and of scenes


MODEL = ("model/box", "model/parameters", "model/state", "model/commands")
MODULES = ("syntax/ranges", "syntax/words", "eos/table", "syntax/fixes", *MODEL)
# Refusals that LAMMPS cannot meet: calls from Python, and rules that apply earlier elsewhere.
PYTHON_ONLY = (
    "must be one of {', '.join(STYLES)}",
    "takes no argument",
    "needs the argument",
    "must be a scalar or of the density's shape",
    "must be given for every atom type",
    "must lie within 1 to {len(self",
    "must have one value per particle",
    "must be a whole number', str(types.dtype)",
    "needs the internal energy per unit mass of every particle",
    "must be a single one",
    "of react'",  # scenes have no bonds
    "with bonds or contacts",
    "must begin with fix",
    "needs low, high and periodic for 2 or 3 axes",
    "must be one of gravity, addforce, setforce",
    "must be 2 or 3",
    "must have the shape",
    "must be at least one",
    "needs {d} axes",
    "InputError('deform'",  # a scene has a finite rate for every axis
    "'must be {rule}'",
    "InputError(what, f'must be {rule}'",
)


# Rules that the parser or the scene applies first, and the row that breaks the same one.
MET_EARLIER = {
    "InputError(what, 'must be a finite number', value)": "gamma-nan",
    "InputError(what, 'must be positive', value)": "rho0-zero",
    "InputError(what, f'needs one value per atom type ({ntypes})'": "rho0-too-many",
    "'needs a number for every axis": "gravity-left-open",
    "'needs finite components'": "force-infinite",
    "InputError('kernel'": "unknown-kernel",
    "InputError('tilt of the box'": "tilt-at-an-open-face",
    "InputError('cutoff of pair_style rheo'": "cutoff-of-the-pair-style",
    "InputError('self/mass', 'is an argument of rho/sum')": "self-mass-alone",
    "InputError(law.style, 'needs particles with energy": "gas-on-atoms-without-energy",
    "InputError(what, 'must be positive', number)": "cs-zero",
    "f'needs {self.dimension} components'": "force-of-three-components",
    "InputError(f'types of {force.style}'": "force-on-no-type",
    "InputError('type', f'must lie within": "region-of-a-type-beyond",
    "InputError('energy', 'must be given for every particle of a thermal": "gas-without-energy",
    "of rheo/viscosity', 'must be a finite number'": "viscosity-nan",
    "of rheo/viscosity', 'must not be negative'": "viscosity-negative",
    "InputError('gd0 of rheo/viscosity'": "power-law-of-rate-zero",
    "InputError('Tfreeze'": "freezing-nan",
    "InputError('limit of surface/detection', rule, self.limit)": "fraction-of-a-neighbour",
    "InputError('units', f\"must be one of": "wrong-type",
    "InputError('units', 'must not be real or metal in 2D": "forces-in-real-units",
    "InputError('latent/heat', 'needs a freezing": "latent-heat-without-freezing",
}


def raised(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines that refuse: raise InputError, or a call of the parser's fail."""
    tree = ast.parse(path.read_text())
    for node in ast.walk(tree):
        if isinstance(node, ast.Raise) and node.exc is not None and "InputError(" in ast.unparse(node.exc):
            yield node.lineno, ast.unparse(node.exc)
        if isinstance(node, ast.Expr) and ".fail(" in (text := ast.unparse(node)):
            yield node.lineno, text


class Traced:
    """Records the executed lines of some files."""

    def __init__(self, files: set[str]) -> None:
        self.files, self.lines = files, set[tuple[str, int]]()

    def __call__(self, frame: FrameType, event: str, argument: Any) -> Any:
        if frame.f_code.co_filename not in self.files:
            return None
        if event == "line":
            self.lines.add((frame.f_code.co_filename, frame.f_lineno))
        return self

    def __enter__(self) -> Traced:
        self.before = sys.gettrace()
        sys.settrace(self)
        return self

    def __exit__(self, *exception: object) -> None:
        sys.settrace(self.before)


@pytest.mark.lammps
def test_rules_of_the_reference_are_covered() -> None:
    """A row runs every refusing line of the parser, the laws and the model, except those listed above."""
    files = [Path(eos_ref.__file__).parent / f"{name}.py" for name in MODULES]
    rules = {(str(path), line): text for path in files for line, text in raised(path)}
    assert len(rules) > 40
    traced = Traced({str(path) for path in files})
    for bad in bad_inputs():
        base(bad.base)  # cached from here on: reading the base itself is not a refusal
        with traced:
            assert bad.refusal
            with contextlib.suppress(InputError):
                parse(bad)
    with traced:
        for one in generated():
            refusal(one.commands)
    uncovered = {
        f"{Path(path).name}:{line} {text}"
        for (path, line), text in rules.items()
        if (path, line) not in traced.lines and not any(part in text for part in (*PYTHON_ONLY, *MET_EARLIER))
    }
    assert sorted(uncovered) == []
    assert set(MET_EARLIER.values()) <= set(BY_ID)
    for part in (*PYTHON_ONLY, *MET_EARLIER):
        assert any(part in text for text in rules.values()), f"no rule reads {part}"


def test_rules_of_scenes_are_covered() -> None:
    """A row runs every error of a scene's own validators, except refusals that LAMMPS cannot meet."""
    validators = ("case", "manual", "particles", "runs", "settings", "values")
    files = [Path(scene.__file__).with_name(f"{name}.py") for name in validators]
    rules = {
        (str(path), node.lineno): ast.unparse(node)
        for path in files
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Raise)
    }
    traced = Traced({str(path) for path in files})
    for bad in bad_inputs():
        with traced:
            assert bad.refusal
    uncovered = [text for key, text in rules.items() if key not in traced.lines]
    # Rules about files, twins, comparisons and the harness' limits.
    other = re.compile(
        "own folder|twin|rescale|refused must|violate|compare|tolerance|method of|exactly one|at most|flags|per_type"
        "|InputError\\('name'|low must not exceed|log spacing|region|self_mass|cells needs|manual\\'s line"
        "|tilt must be other than 0"  # for a twin
        "|stops|every:|displace.z|stretch|deform|{key} needs|dt/reset needs"  # for runs in pieces and boxes that change
        "|engine.boundary without s"  # for compared fields
        "|processors must|balance .style rcb"  # for LAMMPS' processes
        "|positions need|velocity.values|low and high|low < high|one value per particle|values goes with"  # by particle
    )
    assert "\n".join(text for text in uncovered if not other.search(text)) == ""


# --- classification


@pytest.mark.parametrize(
    ("text", "name", "held"),
    [
        ("Must give latent heat", "latent/heat", True),
        ("Illegal speed/sound command", "speed/sound", True),
        ("Illegal value -1.2", "-1.2", True),
        ("Illegal value 1.25", "1.2", False),
        ("Illegal value 1.2", "1", False),
        ("rheo/pressure is wrong", "pressure", False),
        ("PRESSURE is wrong", "pressure", True),
        ("zminimal", "zmin", False),
        (error_words("ERROR: Illegal fix\nLast input line: fix a RK3"), "RK3", False),  # LAMMPS repeats its input
    ],
)
def test_only_whole_words_of_an_error_are_recognised(text: str, name: str, held: bool) -> None:
    assert names_it(text, (name,)) == held


def test_words_of_an_error() -> None:
    text = (
        "ERROR on proc 0: Unknown kernel style RK3 (src/x.cpp:113)\nLast input line: fix rheo all rheo 3 RK3 0\n   ^^"
    )
    assert error_words(text) == "Unknown kernel style RK3"


def arrays(**values: Any) -> dict[str, Any]:
    return {"id": np.array([1, 2]), "x": np.zeros((2, 3)), "q.pressure": np.array([1.0, 2.0])} | values


@pytest.mark.parametrize(
    ("reply", "wanted"),
    [
        (Reply("refused", "ERROR: Illegal fix rheo command: missing zmin"), "clear error"),
        (Reply("refused", "ERROR: Invalid -1"), "clear error"),
        (Reply("refused", "ERROR: Something went wrong\nLast input line: zmin -1"), "vague error"),
        (Reply("lost", "LAMMPS kept 1 of 2 atoms: some lie outside the box"), "silent acceptance"),
        (Reply("answered", arrays=arrays()), "silent acceptance"),
        (Reply("answered", arrays=arrays(x=np.array([[0, 0, 0], [0, np.nan, 0]]))), "silent NaN"),
        (Reply("answered", arrays=arrays(**{"q.pressure": np.array([1.0, np.inf])})), "silent NaN"),
        (Reply("crashed", "SIGSEGV"), "crash"),
        (Reply("timeout", "time limit"), "hang"),
    ],
)
def test_reactions_are_classified(reply: Reply, wanted: str) -> None:
    bad = BY_ID["zmin-negative"]
    assert reaction(reply, (*bad.names, *offending(bad)))[0] == wanted


def test_candidate_needs_a_promise() -> None:
    silent = Reply("answered", arrays=arrays())
    assert not row(BY_ID["zmin-negative"], silent).candidate
    assert row(BY_ID["range-with-hyphen"], silent).candidate
    assert not row(BY_ID["range-with-hyphen"], Reply("refused", "ERROR: Invalid range string")).candidate


def test_fault_of_the_harness_is_not_blamed_on_lammps() -> None:
    with pytest.raises(RuntimeError, match="KeyError"):
        reaction(Reply("error", "KeyError: 'x'"), ())


@pytest.mark.parametrize(("base", "text"), [("one", "no such text"), ("deck", "fix")])
def test_edit_of_a_missing_or_repeated_text_is_refused(base: str, text: str) -> None:
    with pytest.raises(InputError, match=f"edit '{text}': must stand once in the commands of {base}, found"):
        probe.edited(base, ((text, "y"),))


def test_edits_remove_and_add_lines() -> None:
    lines = probe.replaced(("fix 1 a", "fix 2 b"), (("fix 1 a", ""), ("fix 2", "fix 3 c\nfix 2")))
    assert lines == ("fix 3 c", "fix 2 b")


# --- LAMMPS itself


@pytest.mark.lammps
def test_harmless_scenes_are_accepted() -> None:
    """Otherwise an error would concern the base, not the input."""
    with Workers(None, 1) as workers:
        for reply in put(workers, [base(name) for name in ("one", "two", "warm", "open")], 10.0):
            assert reply.ended == "answered", reply
            assert reaction(reply, ())[0] == "silent acceptance"


@pytest.mark.lammps
def test_table_round_trips_and_has_the_known_reactions(rows: dict[str, InputRow]) -> None:
    assert list(rows) == list(BY_ID)
    assert all(row.refusal and row.words and row.text for row in rows.values())
    adapter = TypeAdapter(list[InputRow])
    assert adapter.validate_json(adapter.dump_json(list(rows.values()))) == list(rows.values())
    known = {
        **dict.fromkeys(("unknown-kernel", "mass-negative"), "clear error"),
        **dict.fromkeys(("gamma-0", "rho0-zero", "negative-density"), "silent NaN"),
        **{"gamma-of-a-gas": "silent acceptance", "cs-negative": "no effect", "range-of-two-stars": "crash"},
    }
    assert {id: rows[id].reaction for id in known} == known


@pytest.mark.lammps
def test_hanging_input_does_not_affect_others() -> None:
    edits = (("run 2 pre", "run 100000000 pre"),)
    long = BadInput(id="long", area="run", names=("run",), edits=edits, scene={"evolve": {"steps": -2}})
    with Workers(None, 1) as workers:
        found = table(workers, inputs=(long, BY_ID["gamma-0"]), time_limit=1.0)
    assert [one.reaction for one in found] == ["hang", "silent NaN"]
