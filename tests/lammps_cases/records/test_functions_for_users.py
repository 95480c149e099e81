"""Functions for users: wrong arguments and files are one line, other errors pass."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

from eos_ref import InputError
from lammps_cases.records.checked import checked


class Inner(BaseModel):
    """An object that the function makes inside."""

    n: int


@checked
def twice(n: int, path: Path | None = None, *, inner: object = 1) -> int:
    """Return twice a number."""
    if path is not None:
        path.read_text()
    return 2 * n * Inner(n=inner).n


@checked
def fails() -> None:
    raise OSError("neither a file nor a reason")


def test_good_arguments_and_errors_inside_pass_through() -> None:
    assert twice(2) == twice(n=2) == 4
    assert twice.__name__ == "twice" and twice.__doc__ == "Return twice a number."
    with pytest.raises(ValidationError, match="Inner"):
        twice(1, inner="one")
    with pytest.raises(OSError, match="neither"):
        fails()


@pytest.mark.parametrize(
    ("arguments", "more", "said"),
    [
        (("two",), {}, r"^argument n: .*integer.*, found 'two' \(twice\(\)\)$"),
        ((1, 2.5), {}, r"^argument path: .*, found 2.5 \(twice\(\)\)$"),
        ((1,), {"odd": 3}, r"^argument odd: .*, found 3 \(twice\(\)\)$"),
        ((), {}, r"^argument n: .*\(twice\(\)\)$"),
        ((1, "/nowhere/gone"), {}, r"gone: cannot be used: No such file or directory \(twice\(\)\)$"),
    ],
)
def test_wrong_argument_or_file_is_one_line_with_its_name(
    arguments: tuple[object, ...], more: dict[str, object], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        twice(*arguments, **more)
