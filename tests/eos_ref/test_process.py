"""What a process shares: the one exception, the cache folder, compiled code."""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import pytest
from numba.core import codegen

from eos_ref import InputError
from eos_ref.cache import cache_folder
from eos_ref.errors import nearest

# --- the exception


def test_message() -> None:
    assert str(InputError("rho0", "must be positive")) == "rho0: must be positive"
    assert str(InputError("rho0", "must be positive", -1.0)) == "rho0: must be positive, found -1.0"
    assert str(InputError("rho0", "must be positive", 0, "a.yaml")) == "rho0: must be positive, found 0 (a.yaml)"
    assert str(InputError("word", "must not be empty", "")) == "word: must not be empty, found ''"
    assert issubclass(InputError, ValueError)


def test_message_stays_on_one_line() -> None:
    class Wordy:
        def __repr__(self) -> str:
            return "many\nlines\n\tof it"

    assert str(InputError("a\nb", "c\r\nd", Wordy(), "e\n f")) == "a b: c d, found many lines of it (e f)"


def test_at_prefixes_the_place() -> None:
    error = InputError("cs", "must be positive", 0)
    assert str(error.at("type 2")) == "cs: must be positive, found 0 (type 2)"
    assert str(error.at("type 2").at("case.yaml")) == "cs: must be positive, found 0 (case.yaml: type 2)"
    assert str(error) == "cs: must be positive, found 0", "the first complaint is left as it was"


@pytest.mark.parametrize("where", ["", "case.yaml"])
@pytest.mark.parametrize("found", [None, 0, "text", (1, 2)])
def test_can_be_pickled(found: object, where: str) -> None:
    error = InputError("cs", "must be positive", found, where)
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is InputError
    assert (back.what, back.rule, back.found, back.where) == ("cs", "must be positive", found, where)
    assert str(back) == str(error)


def test_nearest_name_is_suggested_if_close_enough() -> None:
    assert nearest("near-rho", ["far", "near-rho0"]) == " (did you mean 'near-rho0'?)"
    assert nearest("zzz", ["far", "near-rho0"]) == ""
    assert nearest("near-rho0", ["example-rhosum"]) == "", "not near enough"
    assert nearest("rk", ["risk", "RK1.long", "RK1"]) == " (did you mean 'RK1'?)", "what begins so comes first"


# --- the cache folder


def test_folder_in_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder("numba/one") == tmp_path / "eos-ref" / "numba" / "one"
    assert cache_folder("numba/one").is_dir(), "one that is there is taken again"


def test_uncreatable_cache_costs_only_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache_folder("x") == tmp_path / f"eos-ref-{os.getuid()}" / "x"
    (tmp_path / f"eos-ref-{os.getuid()}" / "y").write_text("in the way")
    last = cache_folder("y")
    assert last.is_dir() and last.parent == tmp_path and last.name.startswith("eos-ref-")


@pytest.mark.parametrize("planted", ["open", "link"])
def test_folder_writable_by_others_is_not_used(planted: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Anyone can create a folder of that name among the temporary files: its content would be trusted."""
    monkeypatch.setenv("XDG_CACHE_HOME", os.devnull)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    usual = tmp_path / f"eos-ref-{os.getuid()}"
    if planted == "link":
        (tmp_path / "elsewhere").mkdir(mode=0o700)
        usual.symlink_to(tmp_path / "elsewhere")
    else:
        usual.mkdir()
        usual.chmod(0o777)
    found = cache_folder("numba")
    assert found.parent == tmp_path and found != usual and found.stat().st_mode & 0o77 == 0
    assert [*usual.iterdir()] == []


# --- registers

ROOT = Path(__file__).parents[2]
PRINTS = """
import hashlib
import numpy as np
from eos_ref import EOS
from eos_ref.eos import compiled
rho, out = np.random.default_rng(1).uniform(0.1, 9.0, 1001), np.empty(1001)
compiled.pressure_of_one_type(rho, np.empty(0), *EOS("tait/general", 1.2, 3.4, 1.4).settings, out)
print(hashlib.sha256(out.tobytes()).hexdigest())
"""


def test_registers_are_chosen_before_anything_is_compiled() -> None:
    """The first function that numba decorates fixes them for the process."""
    sources = [path for package in ("eos_ref", "lammps_cases") for path in (ROOT / package).rglob("*.py")]
    by_numba = [path for path in sources if re.search("^(import|from) numba", path.read_text(), re.MULTILINE)]
    late = [path for path in by_numba if "eos_ref.jit import" not in path.read_text() and not chooses(path)]
    assert len(by_numba) > 5
    assert {path.name for path in late} == {"jit.py", "vectors.py"}  # the latter declares types alone


def chooses(path: Path) -> bool:
    return "\nimport eos_ref.jit " in path.read_text()


@pytest.mark.slow
def test_bits_do_not_depend_on_the_registers() -> None:
    """The chosen ones, LLVM's default, and those that every processor has, without fused operations."""
    given = {}, {"NUMBA_CPU_FEATURES": codegen.get_host_cpu_features()}, {"NUMBA_CPU_NAME": "generic"}
    said = [
        subprocess.run([sys.executable, "-c", PRINTS], env=os.environ | own, check=True, capture_output=True, text=True)
        for own in given
    ]
    assert len({done.stdout for done in said}) == 1
