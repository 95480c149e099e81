"""The one exception that bad input raises, and suggestions for it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

SIMILAR = 0.55  # least ratio of `difflib.SequenceMatcher` at which a name may be suggested
MOST_ALIKE = 5  # names among which the one of fewest slips is suggested
LONGEST = {
    "what": 80,
    "rule": 300,
    "found": 120,
    "where": 300,
}  # characters of the parts of a complaint, which may quote anything
MOST = 50  # complaints that are printed about one input


def brief(text: str, most: int) -> str:
    """Return a text, cut where it is too long."""
    return text if len(text) <= most else f"{text[: most - 4]} ..."


def _shown(found: object) -> str:
    try:
        return repr(found)
    except ValueError:  # a whole number of thousands of digits
        return "a number that is too long"


class InputError(ValueError):
    """Bad input, in one line: what, the rule, the value found, and where.

    Parameters
    ----------
    what : str
        The quantity or key that is wrong.
    rule : str
        What a valid value has to satisfy.
    found : object, optional
        The value found.
    where : str, optional
        File and key, or the command, that holds the value.
    key : str, optional
        The key that holds the value, where ``what`` is not a key; not printed.
    """

    def __init__(self, what: str, rule: str, found: object = None, where: str = "", key: str = "") -> None:
        self.what, self.rule, self.found, self.where, self.key = what, rule, found, where, key or what
        line = f"{brief(what, LONGEST['what'])}: {brief(rule, LONGEST['rule'])}"
        if found is not None:
            line += f", found {brief(_shown(found), LONGEST['found'])}"
        if where:
            line += f" ({brief(where, LONGEST['where'])})"
        super().__init__(" ".join(line.split()))

    @property
    def errors(self) -> tuple[InputError, ...]:
        """Return each complaint."""
        return (self,)

    def at(self, where: str) -> InputError:
        """Return the same complaint with the place put in front of what was known of it."""
        place = f"{where}: {self.where}" if self.where else where
        return InputError(self.what, self.rule, self.found, place, self.key)

    def __reduce__(self) -> tuple[Any, ...]:
        return InputError, (self.what, self.rule, self.found, self.where, self.key)


class InputErrors(InputError):
    """Several complaints about one input, the most likely cause of the others first; a line each."""

    def __init__(self, errors: Sequence[InputError]) -> None:
        first = errors[0]
        super().__init__(first.what, first.rule, first.found, first.where, first.key)
        self._errors = tuple(errors)

    @property
    def errors(self) -> tuple[InputError, ...]:
        """Return each complaint."""
        return self._errors

    def __str__(self) -> str:
        more = [f"... and {len(self._errors) - MOST} more"] if len(self._errors) > MOST else []
        return "\n".join([*map(str, self._errors[:MOST]), *more])

    def at(self, where: str) -> InputError:
        """Return the same complaints with the place put in front of what was known of it."""
        return InputErrors([error.at(where) for error in self._errors])

    def __reduce__(self) -> tuple[Any, ...]:
        return InputErrors, (self._errors,)


def together(errors: Sequence[InputError]) -> InputError:
    """Return one exception for some complaints, at least one."""
    every = [each for error in errors for each in error.errors]
    return every[0] if len(every) == 1 else InputErrors(every)


def similar(name: str, names: Iterable[str]) -> str:
    """Return the name that was probably meant: one that begins so, or the nearest; empty if none is close.

    Names are close if a few slips turn one into the other: one, or one for every four letters.
    """
    import difflib

    known, word = list(names), name[:100]
    longer = [each for each in known if each.casefold().startswith(word.casefold())] if len(word) > 1 else []
    if longer:
        return min(longer, key=len)
    alike = difflib.get_close_matches(word, known, MOST_ALIKE, SIMILAR)
    slips = {each: _slips(word.casefold(), each.casefold()) for each in alike}
    close = [each for each in alike if slips[each] <= max(1, len(word) // 4)]
    return min(close, key=slips.__getitem__, default="")


def _slips(a: str, b: str) -> int:
    """Return how many letters are to be changed, left out, put in or exchanged with the next to make b of a."""
    before, last = [0] * (len(b) + 1), list(range(len(b) + 1))
    for i, letter in enumerate(a, 1):
        row = [i]
        for j, other in enumerate(b, 1):
            row.append(min(last[j] + 1, row[j - 1] + 1, last[j - 1] + (letter != other)))
            if i > 1 and j > 1 and letter == b[j - 2] and a[i - 2] == other:
                row[j] = min(row[j], before[j - 2] + 1)
        before, last = last, row
    return last[-1]


def nearest(name: str, names: Iterable[str]) -> str:
    """Return the name that was probably meant, for the end of a rule; empty if none is similar."""
    meant = similar(name, names)
    return f" (did you mean {meant!r}?)" if meant else ""


def unknown(what: str, name: str, names: Iterable[str]) -> InputError:
    """Return the complaint that there is no such thing, with the name that was probably meant."""
    return InputError(f"no such {what}", f"{brief(repr(name), LONGEST['found'])}{nearest(name, names)}")
