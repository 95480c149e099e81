"""Where things are kept that can be made again: in the user's cache, or wherever a file can be written."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from eos_ref.cache import cache_folder


def test_a_folder_in_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder("numba/one") == tmp_path / "eos-ref" / "numba" / "one"
    assert cache_folder("numba/one").is_dir(), "one that is there is taken again"


def test_a_cache_that_cannot_be_made_costs_nothing_but_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert cache_folder("x") == tmp_path / f"eos-ref-{os.getuid()}" / "x"
    (tmp_path / f"eos-ref-{os.getuid()}" / "y").write_text("in the way")
    last = cache_folder("y")
    assert last.is_dir() and last.parent == tmp_path and last.name.startswith("eos-ref-")
