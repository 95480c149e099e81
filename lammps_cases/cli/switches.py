"""The switches of LAMMPS' own command line, spelled as LAMMPS has them, for ``eos-ref audit``."""

from __future__ import annotations

from collections.abc import Sequence

import click

from eos_ref.errors import InputError

IGNORED = {  # they change nothing of what a deck means; with the number of words that follow
    **dict.fromkeys(("log", "l", "screen", "sc", "echo", "e", "cite", "c"), 1),
    **dict.fromkeys(("plog", "pl", "pscreen", "ps"), 1),
    **dict.fromkeys(("nocite", "nc", "nonbuf", "nb"), 0),
}
REFUSED = {
    **dict.fromkeys(("kokkos", "k"), "RHEO has no styles of KOKKOS"),
    **dict.fromkeys(("partition", "p"), "an audit follows one partition"),
    **dict.fromkeys(("reorder", "ro", "r", "mpicolor", "m"), "an audit starts the processes"),
    **dict.fromkeys(("mdi",), "another program would drive LAMMPS"),
    **dict.fromkeys(("plugin",), "no audit loads libraries"),
    **dict.fromkeys(("skiprun", "sr"), "without steps there is nothing to check"),
    **dict.fromkeys(("restart2data", "r2data", "restart2dump", "r2dump", "restart2info", "r2info"),
                    "it converts a file and runs no deck (eos-ref audit --restart FILE --deck DECK checks one)"),
}  # fmt: skip
VARIABLE, PACKAGE = ("-var", "-v"), ("-package", "-pk")


class AsLammps(click.Command):
    """A command that takes the switches of ``lmp`` among its own options: parameters ``var`` and ``package``."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Take the switches of LAMMPS out, and have click parse the rest."""
        var, package, rest = _taken(args)
        left = super().parse_args(context, rest)
        context.params |= {"var": var, "package": package}
        return left


def _taken(args: Sequence[str]) -> tuple[dict[str, tuple[str, ...]], tuple[str, ...], list[str]]:
    """Return variables, arguments of package commands, and the words that are no switches of LAMMPS."""
    var: dict[str, tuple[str, ...]] = {}
    package: list[str] = []
    rest: list[str] = []
    waiting = list(args)
    while waiting:
        word = waiting.pop(0)
        name = word[1:] if word[:1] == "-" else ""
        if word in VARIABLE:
            variable, first = _next(waiting, word, 2, "-var NAME VALUE...")
            var[variable] = (first, *_values(waiting))
        elif word in PACKAGE:
            package.append(" ".join([*_next(waiting, word, 1, "-pk STYLE ARGUMENT..."), *_values(waiting)]))
        elif name in ("kokkos", "k") and waiting[:1] in (["off"], ["no"], ["false"]):
            waiting.pop(0)
        elif name in REFUSED:
            raise InputError(f"switch {word}", f"cannot be used in an audit: {REFUSED[name]}")
        elif name in IGNORED:
            _next(waiting, word, IGNORED[name], f"{word} WORD")
        else:
            rest.append(word)
    return var, tuple(package), rest


def _next(waiting: list[str], switch: str, count: int, usage: str) -> list[str]:
    if len(waiting) < count or any(word.startswith("--") for word in waiting[:count]):
        raise InputError(f"switch {switch}", f"must be given as {usage}")
    return [waiting.pop(0) for _ in range(count)]


def _values(waiting: list[str]) -> Sequence[str]:
    """Take the words before the next switch."""
    values = []
    while waiting and waiting[0][:1] != "-":
        values.append(waiting.pop(0))
    return values
