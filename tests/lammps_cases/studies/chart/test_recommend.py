"""The sentence of a panel is computed from its points: the method to use, exceptions, what LAMMPS loses."""

from __future__ import annotations

import math

import pytest

from lammps_cases.records.measure import ConfidenceInterval
from lammps_cases.studies.chart.recommend import recommendation
from lammps_cases.studies.chart.record import MethodPanel, MethodPoint

Given = dict[str, dict[str, tuple[float, float]]]  # error and time of a method in a regime


def sentence(given: Given) -> str:
    points = [
        MethodPoint("q", regime, method, error, ConfidenceInterval(ns, 0.98 * ns, 1.02 * ns))
        for regime, methods in given.items()
        for method, (error, ns) in methods.items()
    ]
    return recommendation(MethodPanel("p", "t", "a", "e", "state", tuple(points)))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (
            {"all": {"fast": (1e-3, 1.0), "exact": (1e-15, 4.0), "slow": (1e-15, 5.0)}},
            "Use “exact”: error of at most 1e-15, 4 times the time of the fastest, “fast”.",
        ),
        (  # within rounding all errors are the same
            {"all": {"one": (8e-16, 1.0), "two": (1e-16, 2.0)}},
            "Use “one”: error of at most 8e-16, none is faster.",
        ),
        (  # good far from rho0 only
            {
                "near": {"printed": (1e-4, 1.0), "difference": (4e-16, 3.0)},
                "far": {"printed": (8e-16, 1.0), "difference": (4e-16, 3.0)},
            },
            "Use “difference”: error of at most 4e-16 everywhere, 3 times the time of the fastest, “printed”; "
            "“printed”, 3 times as fast, only for far.",
        ),
        (  # two regimes of the same variable
            {
                "d from 0 to 1": {"a": (1e-15, 1.0), "b": (1e-15, 3.0)},
                "d from 1 to 2": {"a": (1e-15, 1.0), "b": (1e-15, 3.0)},
                "d from 2 to 3": {"a": (1.0, 1.0), "b": (1e-15, 3.0)},
            },
            "Use “b”: error of at most 1e-15 everywhere, 3 times the time of the fastest, “a”; "
            "“a”, 3 times as fast, only for d from 0 to 1 or 1 to 2.",
        ),
        (  # hardly faster: no exception
            {"near": {"a": (1e-4, 1.0), "b": (4e-16, 1.05)}, "far": {"a": (4e-16, 1.0), "b": (4e-16, 1.05)}},
            "Use “b”: error of at most 4e-16 everywhere, 1.05 times the time of the fastest, “a”.",
        ),
        (  # none will do everywhere: the one that misses by the least
            {"near": {"a": (1.0, 1.0), "b": (1e-3, 1.0)}, "far": {"a": (1e-3, 1.0), "b": (1e-2, 3.0)}},
            "Use “b”: error of at most 0.01 everywhere, 1.73 times the time of the fastest, “a”; "
            "“a”, 3 times as fast, only for far.",
        ),
        (
            {"near": {"a": (1e-15, 1.0), "LAMMPS": (1e-4, 8.0)}, "far": {"a": (1e-15, 2.0), "LAMMPS": (1e-15, 8.0)}},
            "Use “a”: error of at most 1e-15 everywhere, none is faster. LAMMPS loses up to 11.0 digits against it, "
            "at near, and takes 4 to 8 times as long.",
        ),
        (  # LAMMPS' own way of the same method
            {"all": {"RK1": (0.01, 1.0), "LAMMPS RK1": (0.01, 9.0), "LAMMPS RK2": (1.0, 9.0)}},
            "Use “RK1”: error of at most 0.01, none is faster. LAMMPS is as accurate and takes 9 times as long.",
        ),
        (  # the time of LAMMPS is a difference, negative on a busy machine
            {"all": {"a": (1e-15, 1.0), "LAMMPS": (1e-15, -0.5)}},
            "Use “a”: error of at most 1e-15, none is faster. LAMMPS is as accurate.",
        ),
        ({"all": {"LAMMPS": (1e-3, 1.0)}}, ""),
        ({"all": {"a": (math.inf, 1.0), "b": (math.nan, 2.0)}}, "No method is right everywhere."),
    ],
)
def test_sentence(given: Given, expected: str) -> None:
    assert sentence(given) == expected
