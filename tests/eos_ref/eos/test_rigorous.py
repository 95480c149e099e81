"""Arb values: as accurate as requested, refused where undefined, and the error of a float against them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from flint import arb, ctx

from eos_ref import EOS, InputError
from eos_ref.eos import rigorous
from tests.support.eos_cases import LAWS, RHO0, TAIT, has_value


@pytest.mark.parametrize("bits", [20, 60, 100, 400])  # 20: less than the cancellation costs
@pytest.mark.parametrize("name", LAWS)
def test_relative_accuracy_survives_cancellation(name: str, bits: int) -> None:
    law = LAWS[name]
    e = 2.5 if law.needs_energy else None
    for rho in (RHO0 * (1 + 1e-13), RHO0 * (1 - 1e-9), 2 * RHO0, 1e-200):
        assert rigorous.pressure(law, rho, e, bits).rel_accuracy_bits() >= bits


@pytest.mark.parametrize("name", TAIT)
def test_zero_pressure_terminates(name: str) -> None:
    """At rho0 no relative accuracy can be reached; a background that cancels to the last bit terminates, too."""
    law = TAIT[name]
    assert rigorous.pressure(law, RHO0).contains(0)
    near = rigorous.pressure(law, RHO0 * 1.5)
    cancelling = replace(law, background=-float(near))
    rest = rigorous.pressure(cancelling, RHO0 * 1.5)
    assert abs(rest) <= abs(near) * 2.0**-52


@pytest.mark.parametrize("name", TAIT)
@pytest.mark.parametrize("rho", [-1.0, 0.0, math.nan, math.inf])
def test_undefined_is_refused(name: str, rho: float) -> None:
    law = TAIT[name]
    if has_value(law, rho):
        assert rigorous.pressure(law, rho).is_finite()
    else:
        with pytest.raises(InputError, match="must lie within"):
            rigorous.pressure(law, rho)


def test_missing_energy_is_refused() -> None:
    with pytest.raises(InputError, match="energy"):
        rigorous.pressure(LAWS["ideal/gas"], 1.0)


def test_the_global_precision_is_left_alone() -> None:
    before = ctx.prec
    rigorous.pressure(LAWS["tait/water"], 1.0, bits=500)
    with pytest.raises(InputError):
        rigorous.pressure(LAWS["ideal/gas"], 1.0)
    assert ctx.prec == before


def test_float32_arguments_are_exact() -> None:
    law = EOS("linear", np.float32(0.1), np.float32(1.1))
    rho = np.float32(0.7)
    true = (arb(float(rho)) - arb(float(np.float32(0.1)))) * arb(float(np.float32(1.1))) ** 2
    assert rigorous.pressure(law, float(rho)).overlaps(true)


def test_error_is_never_below_the_truth() -> None:
    before, ctx.prec = ctx.prec, 300
    third = arb(1) / 3
    true = abs(arb(1 / 3) - third)
    ctx.prec = before
    found = arb(rigorous.error(1 / 3, third))
    assert true <= found <= true * (1 + arb(2) ** -50)  # the default precision, 53 bits, rounds twice
    assert rigorous.error(1.5, arb(1)) == 0.5
    assert rigorous.error(math.nan, third) == math.inf
    assert rigorous.error(math.inf, third) == math.inf
