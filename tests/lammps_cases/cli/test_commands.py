"""Commands are generated from signatures: annotations and defaults define the command line."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import click
import pytest
from annotated_types import Interval
from click.testing import CliRunner

from lammps_cases.cli.commands import command
from lammps_cases.cli.main import COMMANDS, group
from lammps_cases.records.options import Option, Positional, flat, option_of, parameters

given: dict[str, Any] = {}


@dataclass(frozen=True)
class Size:
    """A group of options."""

    width: Annotated[Annotated[int, Interval(ge=1, le=9)] | None, Option("Width.")] = None
    _: KW_ONLY
    names: Annotated[list[str], Option("Made when it is needed.", type=str)] = field(default_factory=lambda: ["own"])
    hidden: str = "not an option"


def try_command(
    place: Annotated[Path, Positional()],
    kind: Annotated[Literal["a", "b"], Option("Kind.", like="c+")] = "a",
    *,
    size: Size,
    parts: Annotated[tuple[int, ...], Option("Parts.", "--part")] = (),
    fresh: Annotated[bool, Option("Fresh.")] = False,
    text: Annotated[str, Option("Text.")] = "",
) -> int:
    """Try."""
    given.update(locals())
    return 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("x", {"place": Path("x"), "kind": "a", "size": Size(), "parts": (), "fresh": False, "text": ""}),
        ("x --kind ccc --width 9 --part 1 --part 2", {"kind": "ccc", "size": Size(9), "parts": (1, 2)}),
        ("--fresh x --text t", {"fresh": True, "text": "t"}),
        ("", "Missing argument 'PLACE'"),
        ("x --kind d", "'d' is not one of 'a', 'b'"),
        ("x --width 10", "10 is not in the range 1<=x<=9"),
        ("x --part one", "'one' is not a valid integer"),
        ("x --hidden y", "No such option"),
    ],
)
def test_command_accepts_the_arguments_of_its_signature(words: str, expected: Any) -> None:
    made = CliRunner().invoke(command()(try_command), words.split())
    if isinstance(expected, str):
        assert made.exit_code == 2 and expected in made.output
    else:
        assert made.exit_code == 0 and given | expected == given


def test_help_and_defaults_follow_the_signature() -> None:
    out = CliRunner().invoke(command()(try_command), ["--help"]).output
    assert out.startswith("Usage: try [OPTIONS] PLACE") and "  Try." in out
    assert "Kind.  [default: a]" in out and out.count("[default") == 1


def test_function_takes_options_as_arguments_and_documents_them() -> None:
    @flat
    def area(at: int, *, size: Size) -> tuple[int, Size]:
        """Compute.

        Parameters
        ----------
        (options)
        """
        return at, size

    assert area(3, width=2) == (3, Size(2)) and area(3) == (3, Size())
    assert "width :\n    Width." in (area.__doc__ or "")
    with pytest.raises(TypeError, match="widht"):
        area(3, widht=2)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_a_help_line(name: str) -> None:
    made = group.get_command(click.Context(group), name)
    assert made is not None
    assert all(option.help for option in made.params if isinstance(option, click.Option))


def test_parameters_without_an_option_are_not_on_the_command_line() -> None:
    assert [each.name for each in parameters(try_command) if option_of(each.annotation)] == [
        *("place", "kind", "width", "names", "parts", "fresh", "text")
    ]
