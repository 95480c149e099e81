"""Measurements as a document of pytest-benchmark, for the services that draw such documents over time."""

from __future__ import annotations

from typing import Any

from eos_ref.errors import InputError
from lammps_cases.studies.benchmarks.bench import Ratio
from lammps_cases.studies.benchmarks.speed_history import SpeedEntry


def document(entry: SpeedEntry) -> dict[str, Any]:
    """Return what ``pytest --benchmark-json`` would write; times in seconds per particle, or per run of a program.

    A slower machine is told from slower code by the peers: ``extra_info`` of each benchmark has the time of its peer in
    the same run, and the ratio to it with the ends of its interval.

    Raises
    ------
    InputError
        pytest-benchmark is not installed.
    """
    try:
        import pytest_benchmark
    except ImportError:
        raise InputError("pytest-benchmark", "must be installed: pip install 'eos-ref[bench]'") from None
    return {
        "machine_info": entry.machine,
        "commit_info": {},
        "benchmarks": [_benchmark(ratio) for ratio in entry.ratios if ratio.ours_ns_r],
        "datetime": entry.time,
        "version": pytest_benchmark.__version__,
    }


def _benchmark(ratio: Ratio) -> dict[str, Any]:
    from pytest_benchmark.stats import Stats

    stats: Any = Stats()  # type: ignore[no-untyped-call]
    for ns in ratio.ours_ns_r:
        stats.update(ns * 1e-9)
    name = f"{ratio.scene} against {ratio.peer}"
    extra = {"peer": ratio.peer, "peer_seconds": ratio.peer_ns.median * 1e-9, "ratio": ratio.ratio.median}
    return {
        "group": ratio.peer,
        "name": name,
        "fullname": f"eos-ref bench::{name}",
        "params": None,
        "param": None,
        "extra_info": extra | {"ratio_low": ratio.ratio.low, "ratio_high": ratio.ratio.high},
        "options": {},
        "stats": stats.as_dict() | {"data": stats.data, "iterations": 1},
    }
