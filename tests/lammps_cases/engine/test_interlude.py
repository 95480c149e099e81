"""Actions between runs: commands for each atom, refusals, and the state before and after."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lammps_cases.engine.interlude import Interlude, InterludeAction, NotRefused, perform, rows, scratch
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.run.prepared_case import prepare
from lammps_cases.scene import casefile

BEFORE = {
    "id": np.array([1, 2, 5]),
    "type": np.array([1, 1, 2]),
    "x": np.array([[0.1, 0.2, 0.0], [1 / 3, 1e-300, -0.0], [7.0, 8.0, 0.0]]),
    "v": np.arange(9.0).reshape(3, 3),
    "rho": np.array([1.1, 1.2, np.nextafter(1.3, 2)]),
    "rheo_status": np.array([4, 17, 16]),
}


class LibraryStub:
    """A LAMMPS that records its commands and refuses some of them."""

    def __init__(self) -> None:
        self.given: list[str] = []

    def command(self, text: str) -> None:
        if text.startswith("bad"):
            raise Exception("ERROR: Unknown command")
        if text.startswith("worse"):
            raise RuntimeError("an error on one rank")
        self.given.append(text)

    def commands_string(self, text: str) -> None:
        self.given += text.split("\n")


def done(*actions: InterludeAction) -> list[str]:
    """Return the commands that LAMMPS is given."""
    library = LibraryStub()
    perform(library, Interlude(actions), lambda: BEFORE, "folder", Exception)
    return library.given


def test_values_of_atoms_read_back_as_the_same_numbers() -> None:
    first, second, _ = rows(BEFORE, 3)
    assert (first["id"], first["x"], first["vz"], first["phase"]) == ("1", "0.1", "2.0", "0")
    assert float(second["x"]) == 1 / 3 and float(second["y"]) == 1e-300 and second["phase"] == "1"
    assert [row["id"] for row in rows(BEFORE, 2)] == ["2", "5"]
    assert float(rows(BEFORE, 1)[0]["rho"]) == BEFORE["rho"][2]


def test_actions_in_their_order() -> None:
    restart, bad = InterludeAction("write_restart {folder}/r"), InterludeAction("bad", "refused")
    given = done(restart, bad, InterludeAction("set atom {id} rheo/rho {rho}", "for each atom", 2))
    assert given == ["write_restart folder/r", "set atom 2 rheo/rho 1.2", "set atom 5 rheo/rho 1.3000000000000003"]


@pytest.mark.parametrize(
    ("command", "how", "error"),
    [("good", "refused", NotRefused), ("worse", "given", RuntimeError), ("worse", "refused", RuntimeError)],
)
def test_missing_refusals_and_errors_that_end_the_instance_are_raised(command: str, how: Any, error: Any) -> None:
    words = "accepted what it must refuse: good" if error is NotRefused else "one rank"
    with pytest.raises(error, match=words):
        done(InterludeAction(command, how))


def test_state_is_read_before_and_after_and_a_callback_sees_every_evaluation() -> None:
    states = iter([BEFORE, BEFORE | {"rho": np.zeros(3)}])
    seen, library = list[int](), LibraryStub()
    actions = InterludeAction("one"), InterludeAction("two", evaluates=True), InterludeAction("three")
    carried = perform(
        library, Interlude(actions), lambda: next(states), "", Exception, lambda: seen.append(len(library.given))
    )
    assert carried.before["rho"][0] == 1.1 and carried.after["rho"][0] == 0.0
    assert seen == [2]


def test_folders_for_files_differ() -> None:
    with scratch() as one, scratch() as other:
        assert one != other


@pytest.mark.lammps
def test_refusal_does_not_depend_on_the_name_of_the_folder(workers: Workers) -> None:
    (case,) = [case for case in casefile.load() if case.name == "runs-walls.fluid.data"]
    (job,) = prepare(case).jobs
    one, other = (workers.outcome(workers.submit(job, 120.0)) for _ in range(2))
    assert isinstance(one, Failure)
    assert "read_data {folder}/data.1" in one.message
    assert one == other
