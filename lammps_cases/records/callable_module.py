"""Packages that can be called: ``lammps_cases.run`` is both the room of the main job and the function that does it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any


class CallableModule(ModuleType):
    """A package that is called as the function of its own name in its module ``command``, imported when it is."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self._function(*args, **kwargs)

    @property
    def _function(self) -> Callable[..., Any]:
        function: Callable[..., Any] = getattr(
            import_module(f"{self.__name__}.command"), self.__name__.rpartition(".")[2]
        )
        return function

    @property
    def __signature__(self) -> inspect.Signature:
        """The signature of the function, for ``help`` and notebooks."""
        return inspect.signature(self._function)
