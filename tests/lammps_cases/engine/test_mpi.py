"""Launchers of ranks: given by a user or found, and the shared memory that is left behind."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.engine import mpi


@pytest.mark.parametrize(
    ("template", "rule"),
    [
        ("true -n", "must be a program that exists, with {n} for the number of ranks, found 'true -n'"),
        ("no-such-program -n {n}", "must be a program that exists"),
        ("true '{n}", r"must be a command with {n} for the number of ranks \(No closing quotation\)"),
        ("true {m}", r"must be a command with {n} .*'m'"),
        ("true {}", "must be a command with {n}"),
    ],
)
def test_bad_launcher_is_refused(template: str, rule: str) -> None:
    with pytest.raises(InputError, match=rule):
        mpi.checked(template)


def test_given_launcher(monkeypatch: pytest.MonkeyPatch) -> None:
    template = f"{sys.executable} --ranks={{n}} 'a b'"
    assert mpi.checked(template) == template
    monkeypatch.setenv(mpi.VARIABLE, template)
    monkeypatch.setenv("PMI_RANK", "1")
    monkeypatch.setenv("OMPI_COMM_WORLD_SIZE", "2")
    monkeypatch.setenv("OMPI_ALLOW_RUN_AS_ROOT", "0")
    command, environment = mpi.launcher(Path("nowhere"), 3)
    assert command == [sys.executable, "--ranks=3", "a b"]
    assert not {"PMI_RANK", "OMPI_COMM_WORLD_SIZE"} & environment.keys(), "of the process that MPI was loaded into"
    assert environment["OMPI_ALLOW_RUN_AS_ROOT"] == "0", "what the user set stays"


def test_launcher_next_to_the_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(mpi.VARIABLE, raising=False)
    monkeypatch.setattr(mpi, "loaded", lambda: tmp_path / "lib" / "libmpi.so.40.1")
    program = tmp_path / "bin" / "mpirun.openmpi"
    program.parent.mkdir()
    program.write_text("")
    command, environment = mpi.launcher(tmp_path, 2)
    assert command == [str(program), "-n", "2"] and environment["OMPI_ALLOW_RUN_AS_ROOT"] == "1"


@pytest.mark.parametrize(
    ("library", "kind"),
    [("libmpi.so.40", mpi.OPEN_MPI), ("libmpi.so.80.0.1", mpi.OPEN_MPI), ("libmpi.so.12.3", mpi.MPICH), ("", "MPI")],
)
def test_the_mpi_of_a_library(library: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpi, "loaded", lambda: Path("/usr/lib") / library if library else None)
    assert mpi.flavour() == kind


def test_installation_of_the_mpi_of_a_library() -> None:
    assert mpi.installation("libmpi.so.12") == "pip install mpich"
    assert mpi.installation("libmpi.so.40").startswith("apt install openmpi-bin")


def test_shared_memory_is_identified_by_process_id(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mpi, "SHARED", tmp_path)
    for name in ("mpich_shm_ff_1", "mpich_shm_ff_2", "mpich_shm_f_1", "mpich_shm_fff_1", "other"):
        (tmp_path / name).write_text("")
    mpi.remove_shared_memory(0xFF)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mpich_shm_f_1", "mpich_shm_fff_1", "other"]
    mpi.forget_shared_memory()
    assert len(list(tmp_path.iterdir())) == 3, "this process has none of them open"
