"""LAMMPS' own program on a deck, as anyone runs it: ``lmp -in in.lammps``, without this project."""

from __future__ import annotations

import importlib.metadata
import os
import re
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

from lammps_cases.bugs.deck import DECK, BugDeck
from lammps_cases.engine import mpi
from lammps_cases.engine.installations import Engine
from lammps_cases.engine.session import EngineMissing, package_directory

TIME_LIMIT = 120.0  # seconds; the decks take a fraction of one


@dataclass(frozen=True)
class Ending:
    """How LAMMPS ended: its exit code, negative for a signal, and all that it printed."""

    code: int
    output: str

    @property
    def version(self) -> str:
        """Return the version that LAMMPS printed, with the number of its update."""
        match = re.search(r"^LAMMPS \((.+)\)", self.output, re.M)
        return match[1] if match else ""

    @property
    def error(self) -> str:
        """Return LAMMPS' own error, the exception that it did not catch, or the signal that killed it."""
        if self.code < 0:
            return signal.Signals(-self.code).name
        match = re.search(r"^(ERROR|Exception).*", self.output, re.M)
        return match[0] if match else ""

    def verdict(self, deck: BugDeck) -> str:
        """Return PASS or FAIL: what the deck printed, or whether LAMMPS refused what it must refuse."""
        lines = self.output.splitlines()
        if deck.refused:
            return "PASS" if self.code > 0 and deck.refused in self.error and "FAIL" not in lines else "FAIL"
        return "PASS" if self.code == 0 and "PASS" in lines else "FAIL"

    def printed(self, name: str) -> str:
        """Return a number that the deck printed, empty if it did not come to that."""
        match = re.search(rf"^{name} (\S+)", self.output, re.M)
        return match[1] if match else ""


def program(engine: Engine) -> Path:
    """Return LAMMPS' program beside the library of an engine.

    Raises
    ------
    EngineMissing
    """
    folder = library_folder(engine)
    places = (folder / "lmp", folder.parent / "bin" / "lmp", folder.parent / "lmp")
    path = next((place for place in places if place.is_file()), None)
    if path is None:
        raise EngineMissing(f"there is no program lmp beside the library in {folder}")
    return path


def library_folder(engine: Engine) -> Path:
    """Return the folder of the library itself, not of a link to it."""
    package = Path(engine.site) / "lammps" if engine.site else package_directory()
    return (package / "liblammps.so").resolve().parent


def run(deck: BugDeck, engine: Engine) -> Ending:
    """Run a deck in a folder of its own, which goes with it."""
    with tempfile.TemporaryDirectory() as folder:
        deck.write(Path(folder))
        # A wheel finds the MPI beside it by its start script; it is one word of the environment.
        process = subprocess.Popen(
            [program(engine), "-in", DECK, "-log", "none"],
            cwd=folder,
            env=environment(engine),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        try:
            printed, _ = process.communicate(timeout=TIME_LIMIT)
        finally:
            process.kill()
            process.wait()
            mpi.remove_shared_memory(process.pid)
    return Ending(process.returncode, printed)


def environment(engine: Engine) -> dict[str, str]:
    """Return the environment in which the program of an engine finds its MPI."""
    environment = dict(os.environ)
    try:
        library = mpi.file_of_mpich("libmpi.so.12", library_folder(engine).parent)
    except (OSError, importlib.metadata.PackageNotFoundError):
        return environment
    environment["LD_LIBRARY_PATH"] = os.pathsep.join(
        filter(None, [environment.get("LD_LIBRARY_PATH", ""), str(library.parent)])
    )
    return environment
