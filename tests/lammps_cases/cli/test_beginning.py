"""Start-up of `eos-ref run`."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
from click.testing import CliRunner

from eos_ref import InputError
from lammps_cases.cli import run, shared
from lammps_cases.engine import forkserver
from lammps_cases.run import campaign
from lammps_cases.scene import casefile


@pytest.mark.parametrize("tag", ["quick", *run.WITHOUT_PAIRS])
@pytest.mark.parametrize("fresh", [True, False])
def test_workers_preload_the_neighbour_search_if_many_cases_need_it(
    tag: str, fresh: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = list[str]()
    monkeypatch.setattr(forkserver, "context", lambda *modules: begun.extend(modules))
    monkeypatch.setattr(campaign, "run_cases", None)
    CliRunner().invoke(run.run_command, ["--tag", tag, "--out", str(tmp_path), *(["--fresh"] if fresh else [])])
    asking = [case.scene.whole_model for case in casefile.select(casefile.load(), tag=tag)]
    many = any(asking) if fresh else sum(asking) > 0.1 * len(asking)
    assert begun and (forkserver.OF_PAIRS in begun) == many


def test_garbage_collection_is_enabled_again_after_bad_input() -> None:
    with pytest.raises(InputError), shared.uncollected():
        assert not gc.isenabled()
        raise InputError("cases", "must be there")
    assert gc.isenabled()
