"""The base of variants that follow LAMMPS' own neighbour lists: the order of particles in a pair, the content of slots.

Slots number the atoms of a process and, after them, their periodic images. The lists are read at every step, only for
cases that differ and may be explained by such a variant.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from eos_ref.eos.table import FloatArray
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.evaluation.pairs import keys
from eos_ref.evaluation.time_step import Simulation
from eos_ref.model.box import BoolArray, Box
from eos_ref.model.parameters import IntArray
from eos_ref.numbers.number import Array
from eos_ref.numbers.rounded import Rounded, value
from lammps_cases.comparison.problem import Problem
from lammps_cases.findings.variants import Snapshot

UNDEFINED = np.inf  # bound of a value that no reference can predict


@dataclass(frozen=True)
class NeighbourList:
    """A neighbour list, as used by LAMMPS' forces at one step.

    Attributes
    ----------
    row_s : the row of the particle in each slot
    x_sc : its position in the slot
    own_s : whether it is the particle itself, not an image or a copy of another process' particle
    pair_ps : the two slots of every pair, that under which the pair is listed first
    rank_s : the process whose slot it is
    low_rc : the lower corner of the part of the box that each process has
    newton : the flags of pairs and of bonds
    """

    row_s: IntArray
    x_sc: FloatArray
    own_s: BoolArray
    pair_ps: IntArray
    rank_s: IntArray
    low_rc: FloatArray
    newton: BoolArray

    @classmethod
    def read(cls, id_n: IntArray, id_s: IntArray, **arrays: Any) -> Self:
        """Return the list of arrays that were read, whose atoms are named by their ids, for particles sorted by id."""
        return cls(np.searchsorted(id_n, id_s), **arrays)

    def sources(self, box: Box) -> IntArray:
        """Return the slot that each image was copied from; -1 for particles.

        Images are made axis after axis, one process further each time, from all slots that exist by then; across a
        boundary of the box they are also shifted by one period. Processes form a grid.
        """
        d, own = len(box.edge_c), np.flatnonzero(self.own_s)
        home_s = own[np.argsort(self.row_s[own])][self.row_s]  # the slot of the particle itself
        image_sc = box.periods(self.x_sc[:, :d] - self.x_sc[home_s, :d]).astype(np.int64)
        grid_c, place_rc = self._grid(d)
        place_sc = place_rc[self.rank_s]
        apart_sc = image_sc * grid_c + place_sc[home_s] - place_sc  # processes between the slot and its particle
        slot_s, last_s = np.arange(len(home_s)), d - 1 - np.argmax(apart_sc[:, ::-1] != 0, axis=1)
        towards_s = np.sign(apart_sc[slot_s, last_s])
        place_sc[slot_s, last_s] += towards_s
        nearer_sc = image_sc - place_sc // grid_c
        here = np.column_stack([self.row_s, self.rank_s, image_sc])
        ranks_s = np.argsort(np.ravel_multi_index(place_rc.T, grid_c))[
            np.ravel_multi_index((place_sc % grid_c).T, grid_c)
        ]
        source_s = _places(np.column_stack([self.row_s, ranks_s, nearer_sc]), here)
        return np.where(apart_sc.any(axis=1), source_s, -1)

    def _grid(self, d: int) -> tuple[IntArray, IntArray]:
        """Return the number of processes along each axis, and the grid position of each process."""
        corners = [np.unique(low_r, return_inverse=True) for low_r in self.low_rc[:, :d].T]
        return np.array([len(low) for low, _ in corners]), np.column_stack([at_r for _, at_r in corners])

    def left_to(
        self, new: NeighbourList, held_sc: FloatArray, own_nc: FloatArray, new_n: BoolArray | bool = False
    ) -> FloatArray:
        """Return the content of the next list's slots, from that of this list's slots and ``own_nc`` of the particles.

        Particles take their values along, also to another process. Slots that a process did not have hold 0. Sorting
        puts what it moves first aside, in the slot after the last particle's. Particles ``new_n`` are created again.
        """
        left_sc = np.zeros((len(new.row_s), held_sc.shape[1]))
        memory = [held_sc[self.rank_s == rank] for rank in range(len(self.low_rc))]
        self._exchange(new, memory, own_nc)
        for rank, memory_sc in enumerate(memory):
            after = np.flatnonzero(new.rank_s == rank)
            own, stays = (of.row_s[of.own_s & (of.rank_s == rank)] for of in (self, new))
            kept = min(len(memory_sc), len(after))
            left_sc[after[:kept]] = memory_sc[:kept]
            first = first_of_last_cycle(recreated(own, new_n), stays)
            if first is not None and len(stays) < kept:
                left_sc[after[len(stays)]] = own_nc[first]
        left_sc[new.own_s] = own_nc[new.row_s[new.own_s]]
        return left_sc

    def _exchange(self, new: NeighbourList, memory: list[FloatArray], own_nc: FloatArray) -> None:
        """Move particles in the memory of processes to those that have them in the next list, along one axis at a time.

        A slot that becomes free takes the last particle, whose slot keeps its content; what arrives, also on its way to
        a third process, takes the next slot.
        """
        own = [self.row_s[self.own_s & (self.rank_s == rank)] for rank in range(len(memory))]
        home_n = np.empty(len(own_nc), int)
        home_n[new.row_s[new.own_s]] = new.rank_s[new.own_s]
        grid_c, place_rc = new._grid(self.x_sc.shape[1])
        if np.prod(grid_c) != len(place_rc):  # of a tiling: at once
            grid_c, place_rc = np.array([len(place_rc)]), np.arange(len(place_rc))[:, None]
        rank_at = np.argsort(np.ravel_multi_index(place_rc.T, grid_c))
        for axis in range(len(grid_c)):
            arrived: list[list[int]] = [[] for _ in memory]
            for rank, row_s in enumerate(own):
                place_sc = np.where(np.arange(len(grid_c)) == axis, place_rc[home_n[row_s]], place_rc[rank])
                to_s = rank_at[np.ravel_multi_index(place_sc.T, grid_c)]
                content_s, gone = _deletion(np.arange(len(row_s)), to_s != rank)
                memory[rank][: len(row_s)] = memory[rank][content_s]
                own[rank] = row_s[content_s][: len(row_s) - len(gone)]
                for slot in gone:
                    arrived[to_s[slot]].append(row_s[slot])
            for rank, rows in enumerate(arrived):
                first, own[rank] = len(own[rank]), np.append(own[rank], np.array(rows, int))
                missing = max(len(own[rank]) - len(memory[rank]), 0)
                memory[rank] = np.pad(memory[rank], ((0, missing), (0, 0)))
                memory[rank][first : len(own[rank])] = own_nc[rows]


def recreated(row_s: IntArray, new_n: BoolArray | bool) -> IntArray:
    """Return the order of particles after some are deleted and created again, one by one."""
    if not np.any(new_n) or np.all(new_n):
        return row_s
    new_s = np.sort(row_s[np.asarray(new_n)[row_s]])
    return np.append(after_deletion(row_s, np.asarray(new_n))[: len(row_s) - len(new_s)], new_s)


def first_of_last_cycle(old_s: IntArray, new_s: IntArray) -> int | None:
    """Return the particle that the last cycle of a sort moves first; None if all stay, or are not the same."""
    places = {row: slot for slot, row in enumerate(old_s.tolist())}
    if sorted(places) != sorted(new_s.tolist()):
        return None
    first, seen = None, set[int]()
    for slot, row in enumerate(new_s.tolist()):
        if slot not in seen and places[row] != slot:
            first = int(old_s[slot])
        while slot not in seen:
            seen.add(slot)
            slot = places[int(new_s[slot])]
    return first


def after_deletion(row_s: IntArray, gone_n: BoolArray) -> IntArray:
    """Return the content of slots after a deletion: each free one is filled from the last slot in use."""
    return _deletion(row_s, gone_n)[0]


def _deletion(row_s: IntArray, gone_n: BoolArray) -> tuple[IntArray, list[int]]:
    """Return the same, and what is deleted, in that order."""
    held_s, used, slot, gone = row_s.copy(), len(row_s), 0, list[int]()
    while slot < used:
        if gone_n[held_s[slot]]:
            used -= 1
            gone.append(int(held_s[slot]))
            held_s[slot] = held_s[used]
        else:
            slot += 1
    return held_s, gone


class FollowingLists(ArrayEvaluator):
    """Stages that find their pairs in LAMMPS' list, if it was read.

    Attributes
    ----------
    lists : LAMMPS' list at every step
    at : the step whose list is in use
    kept_sc : accelerations in the slots of the previous list
    forward_p, backward_p : entry of the list under i, and under j, for every directed pair; -1 if missing
    reverse_p : the same pair as collected by the other particle; -1 if rounding puts it beyond the cutoff
    exchanged : whether a variant has exchanged the gradients for one evaluation
    each_listing : whether pairs stand there once for every particle that lists them and receives their terms
    """

    by_rows = False
    lists: tuple[NeighbourList, ...] = ()
    at: int = 0
    kept_sc: FloatArray = np.zeros((0, 0))
    exchanged: bool = False
    each_listing: bool = False

    def move(self, x_nc: Array) -> None:
        """Find the pairs, and their entries in LAMMPS' list."""
        super().move(x_nc)
        if not self.lists:
            return
        x, i, j = value(x_nc).astype(float), self.i, self.j
        apart_pc = np.stack([value(x_p).astype(float) for x_p in self.x], axis=1)
        own, other = self.directed(i, j, x[i] - x[j] - apart_pc)
        self.forward_p, self.backward_p = self.entries(x, own, other)
        self.reverse_p = _places(other, own)

    def directed(self, i: IntArray, j: IntArray, shift_pc: FloatArray) -> tuple[IntArray, IntArray]:
        """Return the keys of pairs, both particles and the periods between, and their keys for the other particle."""
        image_pc = self.box.periods(shift_pc).astype(np.int64)
        return np.column_stack([i, j, image_pc]), np.column_stack([j, i, -image_pc])

    def entries(self, x_nc: FloatArray, own: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
        """Return the entries of the list under either particle of pairs; see `directed`."""
        listed = self.lists[self.at]
        one_s, other_s = listed.pair_ps.T
        image_sc = self.box.periods(listed.x_sc[:, : x_nc.shape[1]] - x_nc[listed.row_s]).astype(np.int64)
        rows = listed.row_s[one_s], listed.row_s[other_s]
        entries = np.column_stack([*rows, image_sc[other_s] - image_sc[one_s]])
        return _places(own, entries), _places(other, entries)

    def tells_particles(self) -> bool:
        """Return whether particles receive what their images collect from pairs that both particles list: False."""
        return False

    @contextmanager
    def images_added(self) -> Iterator[None]:
        """Sum as where particles receive what their images collect. No-op: sums as everywhere else."""
        yield

    def twice_p(self) -> BoolArray:
        """Return which pairs count twice now, (p,): no pair does."""
        return np.zeros(len(self.i), bool)


def unbounded(x: Array, undefined: BoolArray) -> Array:
    """Return an array without a bound on some of its values."""
    return Rounded(x.value, np.where(undefined, UNDEFINED, x.error)) if isinstance(x, Rounded) else x


def _places(wanted: IntArray, rows: IntArray) -> IntArray:
    """Return the row of ``rows`` that equals each row of ``wanted``, the last of several; -1 if no row does."""
    if not len(rows):
        return np.full(len(wanted), -1)
    key = keys([*np.concatenate([rows, wanted]).T])
    order = np.argsort(key[: len(rows)], kind="stable")
    sorted_key, wanted_key = key[order], key[len(rows) :]
    last = np.searchsorted(sorted_key, wanted_key, side="right") - 1
    return np.where((last >= 0) & (sorted_key[last] == wanted_key), order[last], -1)


class CountingSteps(Simulation):
    """Steps that pass to the stages whose list is in use, and the accelerations that the slots keep."""

    evaluator: FollowingLists
    at: int = 0
    kept_sc: FloatArray = np.zeros((0, 0))

    def evaluate(self) -> dict[str, Any]:
        """Evaluate with the list of the present step."""
        self.evaluator.at, self.evaluator.kept_sc = self.at, self.kept_sc
        return super().evaluate()

    def step(self, dt: float) -> None:
        """Take the next list for the evaluation at the end of the step."""
        self.at += 1
        super().step(dt)

    def minimize(self) -> None:
        """Find the pairs in the list of the minimisation."""
        super().minimize()
        self.at += 1
        self.evaluator.at = self.at
        ArrayEvaluator.follow(self.evaluator, self.state.x_nc)  # images are made again: none is left behind

    def begin_again(self, new_n: BoolArray, read_back: bool = False) -> None:
        """Take the list of the next set-up."""
        self.at += 1
        self.kept_sc = self.slots_at_stop(new_n, read_back)
        super().begin_again(new_n, read_back)

    def slots_at_stop(self, new_n: BoolArray, read_back: bool) -> FloatArray:
        """Return the content of the new list's slots when a run begins: nothing."""
        return np.zeros((0, 0))

    def keep_forces(self) -> None:
        """Keep accelerations in the slots of the list in use, and their content in the slots of the next."""
        super().keep_forces()
        if not self.evaluator.lists:
            return
        old, new = self.evaluator.lists[self.at - 1 : self.at + 1]
        self.evaluator.kept_sc = self.other_nc[old.row_s]
        self.kept_sc = old.left_to(new, self.evaluator.kept_sc, self.other_nc)


def lists_of_neighbours(problem: Problem, stages: type[ArrayEvaluator], snapshot: Snapshot) -> dict[str, Any] | None:
    """Return LAMMPS' list at every step, if they were read."""
    lists: tuple[NeighbourList, ...] = snapshot.get("lists", ())
    return {"lists": lists} if len(lists) > problem.steps[-1] else None
