"""What of the schema has been drawn: choices, and pairs of choices."""

from __future__ import annotations

import numpy as np

from tests.workshop.fuzz import schema
from tests.workshop.fuzz.rules import NEVER


def argued(choice: str) -> str:
    """Return why a choice is never drawn; empty if it may be."""
    place = choice.partition("=")[0]
    return next((why for part, why in NEVER.items() if part == choice or f"{place}.".startswith(f"{part}.")), "")


class ChoiceCounts:
    """How often every choice of the schema was drawn, and together with which others."""

    def __init__(self) -> None:
        self.choices = [choice for choice in schema.choices() if not argued(choice)]
        self._row = {choice: k for k, choice in enumerate(self.choices)}
        self._together = np.zeros((len(self.choices), len(self.choices)), int)
        places = np.array([choice.partition("=")[0] for choice in self.choices])
        self._pairs = np.triu(places[:, None] != places[None, :], 1)

    def add(self, taken: set[str]) -> None:
        """Count a scene that takes some choices."""
        rows = sorted(self._row[choice] for choice in taken if choice in self._row)
        self._together[np.ix_(rows, rows)] += 1

    def counts(self) -> dict[str, int]:
        """Return of every choice how many scenes take it."""
        return dict(zip(self.choices, np.diag(self._together).tolist(), strict=True))

    def pairs(self) -> tuple[int, int]:
        """Return how many pairs of choices of different keys were drawn, and how many there are, possible or not."""
        return int(((self._together > 0) & self._pairs).sum()), int(self._pairs.sum())
