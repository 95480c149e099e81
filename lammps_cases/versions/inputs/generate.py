"""Inputs generated from the syntax: every argument of every form replaced, left out, repeated, moved."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

from eos_ref.syntax.words import number
from lammps_cases.claims.probes.probe import Commands
from lammps_cases.versions.inputs import syntax
from lammps_cases.versions.inputs.refusals import refusal
from lammps_cases.versions.inputs.syntax import Form, FormWord, forms, text

EXTRA = "9.75"  # a surplus word that no form has
OTHER = 1.5  # factor of the numbers of a first group of two
Groups = tuple[tuple[FormWord, ...], ...]


@dataclass(frozen=True)
class Generated:
    """A command given to LAMMPS and to the reference.

    Attributes
    ----------
    id : of the command, the form, the argument (or how its words are arranged), and the word by its name
    form : the legal form that was changed
    about : the argument, or keyword; for a command as a whole its name
    line : the replacement of the form
    commands : the deck
    clear : the manual's words for the mistake; a clear error contains one of them
    word : the replacement of an argument
    """

    id: str
    form: Form
    about: str
    kind: str
    mutation: str
    line: str
    commands: Commands
    clear: tuple[str, ...]
    word: str = ""

    @property
    def area(self) -> str:
        """Return the command."""
        return self.form.command.command

    @property
    def words(self) -> str:
        """Return the line, or a note that it is left out."""
        return self.line or f"without {self.form.line}"

    @property
    def input(self) -> Commands:
        """Return the deck."""
        return self.commands

    @property
    def control(self) -> Commands:
        """Return the deck of the legal form."""
        return self.form.deck(self.form.line)

    @property
    def promise(self) -> str:
        """Return the manual's syntax; for a number out of range only the statement of a page on the range."""
        if self.mutation == "left-out" and self.kind == "command":
            return self.form.command.needed
        of = self.form.command.arguments.get(self.about)
        if of is not None and of.only and self.word in syntax.LEGAL_TYPES.values():
            return ""
        value = number(self.word) if self.kind in ("number", "integer") else None
        if of is None or value is None or not math.isfinite(value):
            return self.form.command.manual
        if self.kind == "integer" and of.allows(value):  # a whole number, not written as one
            return self.form.command.manual
        return of.manual

    @functools.cached_property
    def refusal(self) -> str:
        """Return the rule by which the reference refuses it; empty if it does not."""
        return refusal(self.commands)

    @property
    def others(self) -> tuple[str, ...]:
        """Return the words of the form that a clear error would not name, those of its other arguments."""
        words = {word for group in self.form.groups for word in group if word.argument or word.keyword}
        names = {name for word in words for name in (word.text, *self.form.names(word))}
        return tuple(sorted(name for name in names - set(self.clear) if re.search("[A-Za-z]", name)))


@functools.cache
def generated() -> tuple[Generated, ...]:
    """Return all inputs, no deck twice in a form."""
    return tuple(one for form in forms() for one in of_form(form))


def of_form(form: Form) -> Iterator[Generated]:
    """Yield the inputs of a form; the first is the form itself."""
    generated: set[Commands] = set()
    for one in (_whole(form, "legal", form.line), *_values(form), *_arrangements(form), *_commands(form)):
        if one.commands not in generated:
            generated.add(one.commands)
            yield one


def _whole(form: Form, mutation: str, *lines: str, deck: Commands | None = None) -> Generated:
    name = form.command.command
    names = (name.rpartition(" ")[2], name, "instance")
    return Generated(
        f"{form.id}.command.{mutation}",
        form,
        name,
        "command",
        mutation,
        "; ".join(lines),
        form.deck(*lines) if deck is None else deck,
        names,
    )


def _changed(form: Form, groups: Groups, word: FormWord, kind: str, mutation: str, other: str = "") -> Generated:
    about = word.argument or word.text
    before = {other.text for group in form.groups for other in group}
    new = [other.text for group in groups for other in group if other.text not in before]
    return Generated(
        f"{form.id}.{about.replace('/', '-')}{_which(form, word)}.{mutation}",
        form,
        about,
        kind,
        mutation,
        text(groups),
        form.deck(text(groups)),
        (*form.names(word), *(part for part in new if not re.fullmatch(r'\d|""', part))),
        other,
    )


def _which(form: Form, word: FormWord) -> str:
    """Distinguish an argument from others of its name in a form, and a keyword from its argument."""
    if word.keyword:
        return "-keyword" if any(word.text == other.argument for group in form.groups for other in group) else ""
    same = [other for group in form.groups for other in group if other.argument and other.argument == word.argument]
    return f"-{next(k for k, other in enumerate(same, 1) if other is word)}" if len(same) > 1 else ""


def _places(form: Form) -> Iterator[tuple[int, int, FormWord]]:
    for g, group in enumerate(form.groups):
        for k, word in enumerate(group):
            if word.argument or word.keyword:
                yield g, k, word


def _with(groups: Groups, g: int, *words: FormWord) -> Groups:
    return (*groups[:g], words, *groups[g + 1 :])


def _values(form: Form) -> Iterator[Generated]:
    """Yield other words in place of each argument, style and keyword."""
    for g, k, word in _places(form):
        group = form.groups[g]
        if word.keyword:
            kind, words = "keyword", syntax.words_for_keyword(word.text)
        else:
            of = form.command.arguments[word.argument]
            kind, words = of.kind, syntax.words_for(of, word.text)
        for mutation, other in words.items():
            groups = _with(form.groups, g, *group[:k], replace(word, text=other), *group[k + 1 :])
            yield _changed(form, groups, word, kind, mutation, other)


def _arrangements(form: Form) -> Iterator[Generated]:
    """Yield too few words, too many, the same twice, another order."""
    for g, k, word in _places(form):
        group, kind = form.groups[g], "arrangement"
        groups = _with(form.groups, g, *group[:k], *group[k + 1 :])
        yield _changed(form, groups, word, kind, "left-out")
        yield _changed(form, (*form.groups[:g], group[:k]), word, kind, "ends-before-it")
        groups = _with(form.groups, g, *group[: k + 1], word, *group[k + 1 :])
        yield _changed(form, groups, word, kind, "twice")
        if k + 1 < len(group):
            groups = _with(form.groups, g, *group[:k], group[k + 1], word, *group[k + 2 :])
            yield _changed(form, groups, word, kind, "changed-places")
    for g, group in enumerate(form.groups):
        marked = next((word for word in group if word.argument or word.keyword), None)
        if marked is None:
            continue
        groups = _with(form.groups, g, *group, FormWord(EXTRA))
        yield _changed(form, groups, marked, "arrangement", "one-word-more")
        if g:
            yield _changed(form, (*form.groups[:g], group, *form.groups[g:]), marked, "arrangement", "group-twice")
            other = tuple(replace(word, text=_scaled(word)) for word in group)
            groups = (*form.groups[:g], other, *form.groups[g:])
            yield _changed(form, groups, marked, "arrangement", "group-twice-first-another")
    if len(form.groups) > 2:
        first, *rest = form.groups
        moved = next((w for group in rest for w in group if w.argument or w.keyword), None)
        if moved is not None:
            yield _changed(form, (first, *reversed(rest)), moved, "arrangement", "groups-reversed")


def _scaled(word: FormWord) -> str:
    if not word.argument or not re.fullmatch(r"\d+\.\d+", word.text):
        return word.text
    return repr(float(word.text) * OTHER)


def _commands(form: Form) -> Iterator[Generated]:
    """Yield the command left out, twice, and as the last one; of the first form of a command alone."""
    if form.name != next(iter(form.command.forms)):
        return
    yield _whole(form, "left-out")
    yield _whole(form, "twice", form.line, form.line)
    if form.line.startswith("fix "):
        again = re.sub(r"^fix \w+", "fix again", form.line)
        yield _whole(form, "twice-by-another-id", form.line, again)
        yield _whole(form, "before-the-others", form.line, deck=_moved(form, first=True))
    yield _whole(form, "last", form.line, deck=_moved(form, first=False))
    yield _whole(
        form, "upper-case", form.line.replace(form.command.command.split()[0], form.line.split()[0].upper(), 1)
    )


def _moved(form: Form, first: bool) -> Commands:
    """Return the deck with the command as the first of the fixes, or as the last before the run."""
    rest = form.deck()
    at = next(k for k, line in enumerate(rest) if line.startswith("fix " if first else "run "))
    return (*rest[:at], form.line, *rest[at:])
