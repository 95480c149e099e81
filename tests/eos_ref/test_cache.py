"""The cache folder: in the user's cache, or wherever a file can be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eos_ref.cache import cache_folder


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
