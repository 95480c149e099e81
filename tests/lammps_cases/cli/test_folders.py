"""The output folder of a command: removed if the command is interrupted before it writes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.outcome import Outcome


def interrupted(*arguments: object, **named: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("words", "worker"),
    [
        (("validate", "--quick"), "lammps_cases.studies.flows.run.validate"),
        (("chart", "--quick"), "lammps_cases.studies.chart.collect.collect"),
        (("stability", "--quick"), "lammps_cases.studies.stability.atlas.measure"),
        (("examples", "--from", "{decks}"), "lammps_cases.audit.examples.collect"),
    ],
)
def test_empty_folder_is_removed(
    words: tuple[str, ...],
    worker: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    eos_ref_command: Callable[..., Outcome],
) -> None:
    monkeypatch.setattr(worker, interrupted)
    decks = Path(__file__).parents[2] / "decks"
    words = tuple(word.replace("{decks}", str(decks)) for word in words)
    kept = tmp_path / "kept"
    kept.mkdir()
    for out in (tmp_path / "reports" / "new", kept):
        done = eos_ref_command(*words, "--out", out)
        assert done.code == 130, done.err
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]  # it existed before


def test_written_files_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, eos_ref_command: Callable[..., Outcome]
) -> None:
    out = tmp_path / "new"

    def half(*arguments: object, **named: object) -> None:
        (out / "cavity").write_text("half a flow")
        raise KeyboardInterrupt

    monkeypatch.setattr("lammps_cases.studies.flows.run.validate", half)
    assert eos_ref_command("validate", "--quick", "--out", out).code == 130
    assert (out / "cavity").exists()
