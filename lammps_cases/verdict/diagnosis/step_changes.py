"""Changes of a time step: its halves, kicks, shifts and the forces of other fixes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from lammps_cases.verdict.diagnosis.changes import Change, kicked, step_part


def _without_half(which: int) -> Callable[..., Any]:
    """Return what leaves out every first (1) or second (0) call of a simulation's method."""

    def call(plain: Any, sim: Any, given: tuple[Any, ...]) -> Any:
        sim.halves = getattr(sim, "halves", 0) + 1
        return None if sim.halves % 2 == which else plain(*given)

    return call


def step_changes() -> Iterator[Change]:
    """Yield parts of a time step that are left out, doubled or turned round."""
    parts = (
        ("the change of density in half a step", "_continuity"),
        ("the shift of a step", "_shift"),
    )
    for target, method in parts:
        for words, factor in (("were twice as large", 2.0), ("were half as large", 0.5), ("had the other sign", -1.0)):
            yield Change(
                f"{target} {words}",
                target,
                stepping=step_part(
                    method,
                    lambda plain, sim, given, factor=factor: plain(factor * given[0], *given[1:]),  # type: ignore[misc]
                ),
            )
    for target, method in (
        *parts,
        ("the change of phases", "_change_phase"),
        ("the accelerations kept for walls", "keep_forces"),
    ):
        yield Change(f"{target} were left out", target, stepping=step_part(method, lambda plain, sim, given: None))
    for which, words in ((1, "first"), (0, "second")):
        yield Change(
            f"the {words} half of the change of density were left out",
            "the change of density in half a step",
            stepping=step_part("_continuity", _without_half(which)),
        )
    yield Change(
        "the gradients of the first half step were those of the evaluation before",
        "the half-step gradients",
        stepping=step_part("_half_step_gradients", lambda plain, sim, given: sim.gradient),
    )
    for words, first, second in (
        ("the first half of the kick were left out", -1.0, 0.0),
        ("the second half of the kick were left out", 0.0, -1.0),
        ("the first half of the kick were a whole one", 1.0, 0.0),
        ("the second half of the kick were a whole one", 0.0, 1.0),
    ):
        yield Change(words, "the kicks", stepping=kicked(first, second))
    yield Change("the forces of other fixes were left out", "other forces", stepping=step_part("_external", _left_out))
    yield Change(
        "the forces of other fixes did not contain the mass",
        "other forces",
        stepping=step_part("_external", _without_mass),
    )


def _left_out(plain: Any, sim: Any, given: tuple[Any, ...]) -> Any:
    return given[0]


def _without_mass(plain: Any, sim: Any, given: tuple[Any, ...]) -> Any:
    return given[0] + (plain(*given) - given[0]) / sim.mass_n[:, None]
