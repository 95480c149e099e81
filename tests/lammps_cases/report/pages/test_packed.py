"""Parts of pages that are packed."""

from __future__ import annotations

from pathlib import Path

import pytest

from lammps_cases.report.pages import frame

TEXT = "const a = 'ü';\n" * 100


@pytest.mark.parametrize(
    "damage",
    [b"", b"\xff", b"!", frame.packed(TEXT.upper()).encode(), None],
    ids=["empty", "no text", "no hash", "of an earlier version", "another"],
)
def test_stale_cache_is_rebuilt(damage: bytes | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "cache_folder", lambda _: tmp_path)
    assert frame.packed_once(TEXT) == frame.packed(TEXT)
    (kept,) = tmp_path.iterdir()
    right = kept.read_bytes()
    if damage is None:
        frame.packed_once(TEXT.upper())
        (other,) = {*tmp_path.iterdir()} - {kept}
        damage = other.read_bytes()
    kept.write_bytes(damage)
    assert frame.packed_once(TEXT) == frame.packed(TEXT)
    assert kept.read_bytes() == right


def test_cached_text_is_not_packed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame, "cache_folder", lambda _: tmp_path)
    made = frame.packed_once(TEXT)
    monkeypatch.delattr(frame, "packed")
    assert frame.packed_once(TEXT) == made
