"""``eos-ref.toml`` beside decks: how they are audited, and which known findings are accepted, why and until when."""

from __future__ import annotations

import calendar
import re
import tomllib
from collections.abc import Collection
from dataclasses import replace
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from eos_ref.errors import InputError, unknown
from lammps_cases.audit.fields import chosen
from lammps_cases.audit.options import AuditOptions
from lammps_cases.findings import LEDGER
from lammps_cases.records.files import MIB, read_text

FILE = "eos-ref.toml"
UNTIL = re.compile(r"until (\d{4})-(\d{2})(?:-(\d{2}))?, (\S.*)")


class DeckLimits(BaseModel):
    """How decks are audited, as the options of the same names; None: not set here."""

    model_config = ConfigDict(extra="forbid", strict=True)

    every: Annotated[int, Field(ge=1, lt=2**31)] | None = None
    steps: Annotated[int, Field(ge=1)] | None = None
    timeout: Annotated[float, Field(gt=0)] | None = None
    fields: list[str] | None = None

    def values(self) -> dict[str, Any]:
        """Return what is set, as `AuditOptions` takes it."""
        values = {name: value for name in DeckLimits.model_fields if (value := getattr(self, name)) is not None}
        return values | ({"fields": chosen(self.fields)} if self.fields is not None else {})


class Settings(DeckLimits):
    """The content of the file.

    Attributes
    ----------
    decks : further decks of the folder, by their paths in it
    skip : patterns of names that are no decks
    allow : by finding ``until DATE, REASON``; the day or the month is the last
    deck : by pattern of names, what is set for these decks
    """

    decks: list[str] = []
    skip: list[str] = []
    allow: dict[str, str] = {}
    deck: dict[str, DeckLimits] = {}

    def options(self, name: str, options: AuditOptions) -> AuditOptions:
        """Return the options for a deck; those that are not the defaults go before the file."""
        values = self.values()
        for pattern, limits in self.deck.items():
            if matches(name, pattern):
                values |= limits.values()
        default = {name for name in values if getattr(options, name) == getattr(AuditOptions, name)}
        return replace(options, **{name: value for name, value in values.items() if name in default})

    def allowed(self, shown: Collection[str], today: date) -> tuple[dict[str, str], list[str]]:
        """Return the allowances that hold, and what to say of the others: expired, or of what no deck shows."""
        held, notes = {}, []
        for finding, text in self.allow.items():
            last, reason = allowance(finding, text)
            if today > last:
                notes.append(f"{FILE}: the allowance of {finding} expired on {last}: {reason}")
            elif finding not in shown:
                notes.append(f"{FILE}: the allowance of {finding} is unused: no deck of this run shows it ({reason})")
            else:
                held[finding] = f"until {last}, {reason}"
        return held, notes


def matches(name: str, pattern: str) -> bool:
    """Return whether a pattern is of a deck: of its path in the folder, or of its name alone."""
    return fnmatchcase(name, pattern) or fnmatchcase(Path(name).name, pattern)


def allowance(finding: str, text: str) -> tuple[date, str]:
    """Return the last day and the reason of an allowance.

    Raises
    ------
    InputError
    """
    ids = [entry.id for entry in LEDGER]
    if finding not in ids:
        raise unknown("finding", finding, ids).at("allow")
    parts = UNTIL.fullmatch(text)
    try:
        if parts is None:
            raise ValueError
        year, month = int(parts[1]), int(parts[2])
        last = date(year, month, int(parts[3]) if parts[3] else calendar.monthrange(year, month)[1])
    except ValueError:  # calendar's error of a month is one, too
        rule = "must be 'until YEAR-MONTH, REASON', or until a day"
        raise InputError(f"allow.{finding}", rule, text) from None
    return last, parts[4]


def read(folder: Path) -> Settings:
    """Return the settings of a folder of decks; without a file those that set nothing.

    Raises
    ------
    InputError
        No TOML, an unknown key, a value that is not allowed: file, key and rule.
    """
    path = folder / FILE
    if not path.exists():
        return Settings()
    try:
        settings = Settings.model_validate(tomllib.loads(read_text(path, "settings", MIB)))
        for finding, text in settings.allow.items():
            allowance(finding, text)
        for limits in (settings, *settings.deck.values()):
            limits.values()
    except tomllib.TOMLDecodeError as error:
        raise InputError("settings", f"must be TOML: {error}", where=str(path)) from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(map(str, first["loc"]))
        raise InputError(key, first["msg"], first["input"], str(path)) from None
    except InputError as error:
        raise InputError(error.what, error.rule, error.found, str(path)) from None
    return settings
