"""MPI: the one that a library of LAMMPS links, and the program that starts several ranks of it."""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import re
import shlex
import shutil
from pathlib import Path

VARIABLE = "EOS_REF_LAUNCHER"  # a command with {n} for the number of ranks, in place of the one found
OPEN_MPI, MPICH = "Open MPI", "MPICH"
SHARED = Path("/dev/shm")  # where MPICH makes a file of 2 MB for the ranks of a machine, removed by an orderly end only
_PROGRAMS = {OPEN_MPI: ("mpirun.openmpi", "orterun", "mpirun"), MPICH: ("mpiexec.hydra", "mpiexec.mpich", "mpiexec")}
# Open MPI refuses to start as root, and more ranks than cores; tests in a container need both.
SETTINGS = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
}
# More ranks than cores: ranks of MPICH that wait must give way, as those of Open MPI do. On 2 cores 4 ranks of a
# small case take 0.3 s in place of 2.0 s, 8 ranks 0.6 s in place of 3.8 s.
YIELDING = {
    "MPIR_CVAR_POLLS_BEFORE_YIELD": "1",
    "MPIR_CVAR_ENABLE_HEAVY_YIELD": "1",
    "MPIR_CVAR_CH4_PROGRESS_THROTTLE": "1",
    "MPIR_CVAR_CH4_PROGRESS_THROTTLE_NO_PROGRESS_COUNT": "10",
}


class LauncherMissing(RuntimeError):
    """No program starts several ranks of this MPI."""


def loaded() -> Path | None:
    """Return the file of the MPI library that this process has loaded, None without one."""
    lines = Path("/proc/self/maps").read_text().splitlines()
    files = (Path(line.split(maxsplit=5)[5]) for line in lines if line.count("/"))
    return next((file for file in files if re.match(r"libmpi[-.]", file.name)), None)


def flavour() -> str:
    """Return the name of the MPI that this process has loaded, empty if unknown."""
    library = loaded()
    if library is None:
        return "MPI"  # linked statically
    return OPEN_MPI if ".so.40" in library.name or ".so.80" in library.name else MPICH


def forget_shared_memory() -> None:
    """Remove the name of the memory that the ranks of this process share, once all of them have it.

    The memory lives as long as the ranks, however they end: MPICH itself removes it only in MPI_Finalize, which a
    process that is killed, crashes, or is ended by Python's multiprocessing never reaches.
    """
    lines = Path("/proc/self/maps").read_text().splitlines() if SHARED.is_dir() else ()
    for file in {line.split(maxsplit=5)[5] for line in lines if f"{SHARED}/mpich_shm_" in line}:
        Path(file).unlink(missing_ok=True)  # "(deleted)" is part of a removed file's name


def remove_shared_memory(pid: int) -> None:
    """Remove the shared memory of a process that ended during MPI_Init: while alone, it names the file by its id."""
    for file in SHARED.glob(f"mpich_shm_{pid:x}_*"):
        with contextlib.suppress(OSError):  # another user's, of the same id in another container
            file.unlink()


def file_of_mpich(name: str, site: Path) -> Path:
    """Return a file of the mpich distribution next to LAMMPS, or else of this environment.

    Raises
    ------
    OSError, PackageNotFoundError
        No such file, no such distribution.
    """
    beside = next(iter(importlib.metadata.distributions(name="mpich", path=[str(site)])), None)
    distribution = beside or importlib.metadata.distribution("mpich")
    for file in distribution.files or ():
        if file.name == name:
            return Path(os.path.normpath(str(file.locate())))
    raise OSError(f"{name} is not in the mpich distribution")


def installation(soname: str) -> str:
    """Return the command that installs the MPI of a library's soname: 12 is common to MPICH and its derivatives."""
    return (
        "pip install mpich" if soname.endswith(".so.12") else "apt install openmpi-bin, or load the module of that MPI"
    )


def checked(template: str) -> str:
    """Return a valid launcher unchanged.

    Raises
    ------
    InputError
        It has no place for the number of ranks, or is not a command.
    """
    from eos_ref.errors import InputError  # imported late: workers load a mutated reference after this module

    try:
        words = shlex.split(template.format(n=2))
    except (ValueError, IndexError, KeyError) as error:
        raise InputError(
            "launcher", f"must be a command with {{n}} for the number of ranks ({error})", template
        ) from None
    if "{n}" not in template or shutil.which(words[0]) is None:
        raise InputError("launcher", "must be a program that exists, with {n} for the number of ranks", template)
    return template


def launcher(site: Path, count: int) -> tuple[list[str], dict[str, str]]:
    """Return the command that starts ranks of the MPI that this process has loaded, and the environment for it.

    Raises
    ------
    LauncherMissing
    """
    # MPI's variables of the process that loaded it must not reach another start.
    environment = {key: text for key, text in os.environ.items() if not key.startswith(("PMI", "OMPI_COMM", "PRTE_"))}
    if count > len(os.sched_getaffinity(0)):
        environment = YIELDING | environment
    template = os.environ.get(VARIABLE)
    if template:
        return shlex.split(template.format(n=count)), {**SETTINGS, **environment}
    if flavour() != OPEN_MPI:
        return [str(_mpich(site)), "-launcher", "fork", "-n", str(count)], environment
    return [str(_program(OPEN_MPI)), "-n", str(count)], {**SETTINGS, **environment}


def _mpich(site: Path) -> Path:
    try:
        return file_of_mpich("mpiexec", site)
    except (OSError, importlib.metadata.PackageNotFoundError):
        return _program(MPICH)


def _program(kind: str) -> Path:
    """Return the launcher next to the library, or else the first one of the search path."""
    library = loaded()
    folders = [parent / "bin" for parent in library.resolve().parents] if library else []
    for name in _PROGRAMS[kind]:
        for folder in folders:
            if (folder / name).exists():
                return folder / name
        if path := shutil.which(name):
            return Path(path)
    raise LauncherMissing(f"several ranks need a launcher of {kind}: --launcher 'PROGRAM -n {{n}}'")
