"""The store of predictions: its folder, the order of removal, and files removed by other processes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eos_ref.cache import cache_folder
from lammps_cases.comparison import store
from lammps_cases.comparison.store import Store, context, open_store, packed, store_folder


def test_folder_is_the_given_one_or_in_the_users_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path))
    assert store_folder() == tmp_path
    monkeypatch.setenv(store.VARIABLE, "")
    assert store_folder() == cache_folder("predictions")


def test_default_store_belongs_to_the_unchanged_reference(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(store.VARIABLE, str(tmp_path))
    assert open_store() == Store(tmp_path, context(), fresh=False)
    assert open_store(fresh=True) == Store(tmp_path, context(), fresh=True)


def test_only_the_excess_over_the_limit_is_removed(tmp_path: Path) -> None:
    kept = Store(tmp_path)
    for key in "abc":
        kept.write(key, {"x": np.zeros(100)})
    _, size = kept.size()
    kept.trim(size)
    assert kept.size() == (3, size)
    kept.trim(size - 1)
    assert kept.size() == (2, size * 2 // 3)


def test_files_removed_by_another_run_are_skipped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Store(tmp_path)
    kept.write("a", {"x": np.zeros(100)})
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")  # listed, but without a size
    assert kept.size()[0] == 1
    files = store._files(tmp_path)
    monkeypatch.setattr(store, "_files", lambda folder: [(0, 1, str(tmp_path / "removed")), *files])
    kept.trim(0)
    assert kept.read("a") is None


def test_entry_is_read_although_its_use_cannot_be_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = Store(tmp_path)
    kept.write("a", {"x": np.ones(3)})

    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr("os.utime", refuse)
    read = kept.read("a")
    assert read is not None and read["x"].tolist() == [1.0, 1.0, 1.0]


def test_objects_are_never_packed() -> None:
    objects: Any = np.array([None])
    with pytest.raises(TypeError, match="y holds Python objects"):
        packed("name", {"x": np.zeros(1), "y": objects})
