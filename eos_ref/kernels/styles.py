"""The kernel styles of fix rheo: which kernel, and which correction of its gradients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from eos_ref.kernels.kernel import Kernel
from eos_ref.kernels.quintic import QUINTIC

KernelStyle = Literal["quintic", "RK0", "RK1", "RK2"]


@dataclass(frozen=True)
class Corrected:
    """A kernel and the order of the reproducing kernel based on it; -1 for none."""

    kernel: Kernel
    order: int


KERNELS: dict[str, Corrected] = {
    "quintic": Corrected(QUINTIC, -1),
    "RK0": Corrected(QUINTIC, 0),
    "RK1": Corrected(QUINTIC, 1),
    "RK2": Corrected(QUINTIC, 2),
}
