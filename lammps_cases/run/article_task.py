"""The articles of the cases of a run, made by its workers when these have nothing else to do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from lammps_cases.engine.workers import Failure, Workers

if TYPE_CHECKING:  # the main process starts sooner without
    from lammps_cases.report.page import Articles, Family, FamilyArticles

SHARES = 4  # tasks for each worker: the largest first, so that all end at about the same time
LIMIT = 600.0  # seconds that a task may take


def make_articles(site: str | None, families: Sequence[Family]) -> list[FamilyArticles]:
    """Task: return the packed articles of some families of cases."""
    from lammps_cases.report import page

    return page.articles(families)


def begin_articles(workers: Workers, families: Sequence[Family]) -> Articles:
    """Begin with the articles of a run; what no worker brings is made here when it is waited for."""
    shares = divided(families, SHARES * workers.count)
    futures = [workers.call(make_articles, [families[k] for k in share], time_limit=LIMIT) for share in shares]

    def made() -> list[FamilyArticles]:
        from lammps_cases.report import page

        found: dict[int, FamilyArticles] = {}
        for share, future in zip(shares, futures, strict=True):
            texts = workers.outcome(future)
            if isinstance(texts, Failure) or any(lacking for _, lacking in texts):  # a worker's memory may be full
                texts = page.articles([families[k] for k in share])
            found.update(zip(share, texts, strict=True))
        return [found[k] for k in range(len(families))]

    return made


def divided(families: Sequence[Family], most: int) -> list[list[int]]:
    """Divide families, by their places, into about equal shares, the largest first."""
    weights = [sum(entry.weight for entry in family.entries) for family in families]
    shares: list[list[int]] = [[] for _ in range(min(most, len(families)))]
    full = [0] * len(shares)
    for k in sorted(range(len(families)), key=lambda k: -weights[k]):
        least = full.index(min(full))
        shares[least].append(k)
        full[least] += weights[k]
    return shares
