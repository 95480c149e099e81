"""Functions that a user calls: turn argument and file-system errors into one-line messages."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from pydantic import ConfigDict, ValidationError, validate_call

from eos_ref.errors import InputError

P = ParamSpec("P")
R = TypeVar("R")


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that raises `eos_ref.InputError` for arguments that its annotations do not admit.

    It also does for files that cannot be used.
    """
    valid: Callable[P, R] = validate_call(config=ConfigDict(arbitrary_types_allowed=True))(function)
    place, names = f"{function.__name__}()", list(inspect.signature(function).parameters)

    @functools.wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return valid(*args, **kwargs)
        except ValidationError as error:
            if error.title != function.__name__:
                raise
            first = error.errors(include_url=False)[0]
            at = first["loc"][0]
            name = names[at] if isinstance(at, int) and at < len(names) else at
            raise InputError(f"argument {name}", first["msg"], first["input"], place) from None
        except OSError as error:
            if not (error.strerror and error.filename):
                raise
            raise InputError(str(error.filename), f"cannot be used: {error.strerror}", where=place) from None

    return call
