"""The pytest plugin: ``pytest --eos-ref`` runs case files as tests.

pytest loads the plugins of every installed package, so that only pytest is imported here: collection and
judgement are in `lammps_cases.ci.pytest_session` and `lammps_cases.ci.pytest_cases`, loaded with ``--eos-ref`` only.
"""

from __future__ import annotations

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options ``--eos-ref...``."""
    add = parser.getgroup("eos-ref", "eos-ref: LAMMPS' RHEO package against an independent reference").addoption
    add("--eos-ref", action="store_true", help="collect case files (*.yaml) and run their cases against LAMMPS")
    add("--eos-ref-shipped", action="store_true", help="also run the cases that come with eos-ref")
    add("--eos-ref-engine", metavar="E", help="env, pypi:VERSION or path:DIR (default: env)")
    add("--eos-ref-tag", metavar="T", help="only cases with this tag")
    levels = ("high", "medium", "low", "new")  # `FailOn` of the records, which would otherwise be imported
    help_ = "known findings of at least this severity are failures; new: none of them (default: new)"
    add("--eos-ref-fail-on", choices=levels, metavar="LEVEL", help=help_)
    add("--eos-ref-strict", action="store_const", const="low", dest="eos_ref_fail_on", help="the same as low")
    add("--eos-ref-fresh", action="store_true", help="recompute every prediction of the reference")
    add("--eos-ref-out", metavar="DIR", help="write the report of eos-ref run into this folder")


def pytest_configure(config: pytest.Config) -> None:
    """Register the session plugin if one of its options is given."""
    given = sorted(name for name, value in vars(config.option).items() if name.startswith("eos_ref") and value)
    if not given:
        return
    if not {"eos_ref", "eos_ref_shipped"} & set(given):
        raise pytest.UsageError(f"--{given[0].replace('_', '-')} needs --eos-ref or --eos-ref-shipped")
    from lammps_cases.ci.pytest_session import SessionPlugin

    config.pluginmanager.register(SessionPlugin(config), "eos-ref-session")
