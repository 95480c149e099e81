"""The kernel styles of fix rheo: which kernel, and which correction of its gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC


@dataclass(frozen=True)
class Corrected:
    """A kernel, the order of the reproducing kernel based on it (-1 for none), and what its gradients are good for."""

    kernel: Kernel
    order: int
    about: str

    @property
    def corrects_gradients(self) -> bool:
        """Return whether gradients are those of a reproducing kernel (RK1, RK2); RK0 has no unique gradient."""
        return self.order >= 1


KERNELS: dict[str, Corrected] = {
    "quintic": Corrected(QUINTIC, -1, "gradients without correction: cheapest, forces of a pair are opposite"),
    "RK0": Corrected(QUINTIC, 0, "documented as corrected to order 0; its gradients are the quintic's"),
    "RK1": Corrected(QUINTIC, 1, "corrected to first order: gradients of linear fields are exact"),
    "RK2": Corrected(QUINTIC, 2, "corrected to second order: gradients of quadratic fields are exact"),
}
if TYPE_CHECKING:
    KernelStyle = str
else:
    KernelStyle = Literal[tuple(KERNELS)]  # for the schema of scenes
