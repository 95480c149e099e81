"""A named mistake made in this process is made everywhere, and taken back whatever happens."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eos_ref import EOS, InputError
from eos_ref.evaluation.array_evaluator import ArrayEvaluator
from eos_ref.kernels import quintic
from eos_ref.model import interactions
from eos_ref.model.parameters import Model
from lammps_cases.rules import RULES
from tests.workshop.faults import formula, in_place
from tests.support.roundings import rounded


def test_a_function_is_mistaken_wherever_it_is_known() -> None:
    held = quintic.QUINTIC.slope  # bound before the mistake
    right = float(held(np.array(0.5)))
    with in_place.made("formula.slope-without-five"):
        assert float(held(np.array(0.5))) == rounded(right / 5, 3)  # two factors, and the quotient
        with in_place.made("formula.viscous-sign"):
            assert interactions.viscous_term(1.0, 1.0, 1.0, 1.0) == -2.0
        assert interactions.viscous_term(1.0, 1.0, 1.0, 1.0) == 2.0
    assert float(held(np.array(0.5))) == right


def test_methods_and_properties_are_mistaken_too() -> None:
    law = EOS("linear", 1.2, 3.0, None, 0.5)
    with in_place.made("formula.background-dropped"):
        assert law.evaluate(1.2) == 0.0
    assert law.evaluate(1.2) == 0.5
    order: Any = Model.order
    before = order.fget.__code__
    with in_place.made("formula.rk0-corrected"):
        assert order.fget.__code__ is not before
    assert order.fget.__code__ is before


def test_a_mistake_is_taken_back_after_an_exception() -> None:
    before = ArrayEvaluator.correct.__code__
    with pytest.raises(ZeroDivisionError), in_place.made("formula.zmin-ignored"):
        raise ZeroDivisionError
    assert ArrayEvaluator.correct.__code__ is before


@pytest.mark.parametrize("fault", ["told.cs-off", "formula.lint-masses-ignored", "formula.kernel-support-two"])
def test_other_faults_are_refused(fault: str) -> None:
    with pytest.raises(InputError, match="fault: must be"), in_place.made(fault):
        pass


def test_every_mistake_of_a_rule_can_be_made() -> None:
    for fault in {fault for rule in RULES.values() for fault in rule.faults} & set(formula.edits()):
        with in_place.made(fault):
            pass
