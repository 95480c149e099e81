"""Every finding's text: its numbers are recomputed, its workaround runs, its versions are those that show it.

A number follows from an expression in the document (`tests.support.recomputed`) or from a test with ``recomputes``; a
line of a workaround is run by the document, or by a test with ``works_around``. A finding's deck (``eos-ref
report-bug``) or scene shows it, and does not with the changes of the workaround.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packaging.version import Version

from eos_ref import InputError, parse_fix_rheo, parse_fix_rheo_pressure
from eos_ref.model.commands import parse_pair_style_rheo
from lammps_cases.bugs import deck
from lammps_cases.bugs.report import EditedDeck, Workaround
from lammps_cases.claims.probes.run import Reply
from lammps_cases.findings import KNOWN, LEDGER, SEEN_ON
from lammps_cases.findings.entry import Finding
from tests.support.bug_decks import engine_of, report_of, version_of
from tests.support.printed import ENTRIES, RECOMPUTED, VERSION, WORKED_AROUND, quoted, shown, text_of, unnamed
from tests.support.recomputed import from_document, is_documented, recompute, scene_of
from tests.support.small_scene import Engine

LATER = re.compile(rf"{VERSION} or newer|a later version")
TESTS = [f"tests.lammps_cases.findings.{path.stem}" for path in sorted(Path(__file__).parent.glob("test_texts_*.py"))]
ENV, OLDER = version_of("env"), "2025.7.22.1.0"


def lines_of(entry: Finding) -> list[str]:
    """The lines of a workaround."""
    return text_of(entry.id).partition("## Workaround\n\n")[2].strip().splitlines()


@pytest.fixture(scope="module")
def registered() -> None:
    """What tests recompute and run by themselves."""
    for name in TESTS:
        importlib.import_module(name)


def test_every_number_is_recomputed(registered: None) -> None:
    """By its document, or by a test."""
    documented = {(entry.id, name) for entry in LEDGER for name in from_document(entry, shown(entry.id))}
    assert documented | RECOMPUTED == {(entry.id, name) for entry in LEDGER for name in entry.numbers}


@pytest.mark.parametrize("entry", LEDGER, ids=lambda entry: entry.id)
def test_every_digit_is_of_a_number_or_literal(entry: Finding) -> None:
    """And every number occurs in the text."""
    assert unnamed(text_of(entry.id), entry.numbers.values()) == []


def of_older(entry: Finding) -> list[Any]:
    """The mark of a test that needs the older LAMMPS, which has a finding that this one does not have."""
    return [] if entry.listed(ENV) or not entry.listed(OLDER) else [pytest.mark.slow]


@pytest.fixture
def having(request: pytest.FixtureRequest) -> Callable[[Finding], Engine]:
    """The LAMMPS that has a finding."""
    return lambda entry: request.getfixturevalue("older" if of_older(entry) else "lammps")


@pytest.mark.lammps
@pytest.mark.parametrize(
    "entry", [pytest.param(e, id=e.id, marks=of_older(e)) for e in LEDGER if shown(e.id).recomputed]
)
def test_numbers_follow_from_the_scene_of_the_document(entry: Finding, having: Callable[[Finding], Engine]) -> None:
    engine = having(entry)
    recompute(
        entry,
        shown(entry.id),
        lambda scene: engine.fields(scene, every_step=scene.scene.whole_model),
        OLDER if of_older(entry) else ENV,
        engine,
    )


def test_versions_are_those_on_which_a_finding_was_seen() -> None:
    """*Since X*: first seen on X. *From X on* something else, *X or newer* as a way out: last seen before X."""
    found = set()
    for entry in LEDGER:
        text = " ".join([entry.title, entry.observed, entry.argument, entry.workaround])
        began = re.findall(rf"Since {VERSION}", text)
        ended = re.findall(rf"[Ff]rom {VERSION} on", text) + re.findall(rf"{VERSION} or newer", text)
        seen = [Version(engine) for engine in SEEN_ON[entry.id]]
        known = [Version(engine) for engine in KNOWN]
        assert sorted(began + ended) == sorted(re.findall(VERSION, text)), f"{entry.id}: a version in other words"
        for version in map(Version, began):
            assert version == min(seen) > min(known), entry.id
        for version in map(Version, ended):
            assert version == min(engine for engine in known if engine > max(seen)), entry.id
        if began or ended:
            found.add(entry.id)
    gone = {entry.id for entry in LEDGER if KNOWN[-1] not in SEEN_ON[entry.id]}
    new = {entry.id for entry in LEDGER if KNOWN[0] not in SEEN_ON[entry.id]}
    assert found <= gone | new
    assert {name for name in new if KNOWN[-1] in SEEN_ON[name]} <= found, "a finding that is new says since when"


# --- input

PIECES = {  # of the deck of the probes, in which each occurs once
    "law": "1 linear 2 tait/water",
    "keywords": "density 1.2 0.7 speed/sound 3.0 8.0",
    "pair": "pair_style rheo 3.0",
}
PARSERS: dict[str, Callable[[str], object]] = {
    "law": lambda words: parse_fix_rheo_pressure(f"fix 3 all rheo/pressure {words}"),
    "keywords": lambda words: parse_fix_rheo(f"fix 1 all rheo 3.0 quintic 0 {words}"),
    "pair": parse_pair_style_rheo,
}


def words_of(given: EditedDeck) -> tuple[str, tuple[str, ...]]:
    """What an edited deck has other words for, and these."""
    return next(((kind, found) for kind in (*PIECES, "ask") if (found := getattr(given, kind))), ("", ("",)))


def with_words(lammps: Engine, given: EditedDeck, kind: str, words: str) -> Reply:
    if kind in PIECES:
        return lammps.reply(given.base, *given.edits, (PIECES[kind], words))
    asked = f"compute q all rheo/property/atom {words}\n" * bool(words)
    return lammps.reply(given.base, *given.edits, *[("run 3 post no", f"{asked}run 0 post no")] * (kind == "ask"))


DECKS = [(entry.id, given) for entry in LEDGER for given in shown(entry.id).decks]


@pytest.mark.lammps
@pytest.mark.parametrize(
    ("name", "given"), [pytest.param(*one, id=f"{one[0]}: {words_of(one[1])[1][0][:30]}") for one in DECKS]
)
def test_decks_of_the_document(name: str, given: EditedDeck, lammps: Engine) -> None:
    """Their ends, errors and numbers; a crash by a signal has no message."""
    kind, all_words = words_of(given)
    for words in all_words:
        reply, first = with_words(lammps, given, kind, words), (words.split() or [""])[0]
        assert reply.ended == given.ended.replace("nan", "answered"), (words, reply.error)
        assert all(text.replace("@", first) in reply.error for text in given.says), (words, reply.error)
        assert not any(text.replace("@", first) in reply.error for text in given.lacks), (words, reply.error)
        assert "SIGSEGV" not in given.says or reply.error.endswith("SIGSEGV")
        assert "WARNING" not in reply.log or not (given.forbidden or given.as_if)
        if given.ended == "nan":
            arrays = [reply.arrays[each] for each in ("x", "v", "rho", "pressure")]
            assert all(np.isnan(values[:, :2] if values.ndim == 2 else values).all() for values in arrays)
        for other, alike in ((given.as_if, True), (given.unlike, False)):
            if other:
                theirs = with_words(lammps, given, kind, other).arrays
                same = all(np.array_equal(reply.arrays[each], theirs[each]) for each in theirs)
                assert theirs and same == alike, words
        if given.forbidden:
            with pytest.raises(InputError, match=given.forbidden):
                PARSERS[kind](words)


@pytest.mark.parametrize("name", sorted({name for name, _ in DECKS}))
def test_quoted_words_are_in_the_decks(name: str) -> None:
    """Every command and message in quotation marks is given to LAMMPS, or compared with what it prints."""
    given = " ".join(str(each.model_dump()) for each in shown(name).decks)
    for part in ("documented", "observed", "argument", "workaround"):
        assert [text for text in quoted(name, part) if text not in given] == [], part


# --- workarounds


def test_every_line_of_a_workaround_is_run(registered: None) -> None:
    """A newer version is tested with the versions above; those that need a newer LAMMPS are not of this one."""
    for entry in LEDGER:
        hows = shown(entry.id).workaround
        decks = {given.workaround for given in shown(entry.id).decks}
        for number, line in enumerate(lines_of(entry), 1):
            by_test = (entry.id, number) in WORKED_AROUND
            run = by_test + (number in hows) + (number in decks)
            assert run == 1 or (run == 0 and LATER.search(line)), (entry.id, line)
        assert {number for name, number in WORKED_AROUND if name == entry.id} | hows.keys() <= set(
            range(1, len(lines_of(entry)) + 1)
        )
        assert all(how.nothing != "the finding is of a newer LAMMPS" or not entry.listed(ENV) for how in hows.values())


def chosen(kind: str) -> list[Any]:
    """The lines of workarounds that the documents run in one way, for a test."""
    return [
        pytest.param(entry.id, how, marks=of_older(entry), id=f"{entry.id}: {lines_of(entry)[number - 1][:40]}")
        for entry in LEDGER
        for number, how in shown(entry.id).workaround.items()
        if getattr(how, kind)
    ]


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen("scenes"))
def test_a_scene_changed_as_the_workaround_says(
    name: str, how: Workaround, having: Callable[[Finding], Engine]
) -> None:
    lammps = having(ENTRIES[name])
    wrong, *right = (scene_of(name, shown(name), changes) for changes in ({}, *how.scenes))
    assert not is_documented(lammps.fields(wrong), wrong, how.also)
    assert all(is_documented(lammps.fields(scene), scene, how.also) for scene in right)


def judged(name: str, *edits: tuple[str, str]) -> tuple[int, str]:
    """LAMMPS' exit code and the verdict of an edited deck of a finding; each text occurs in it once."""
    made = report_of(name).deck
    text = made.text
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    ending = deck.run(replace(made, lines=tuple(text.splitlines())), engine_of("env"))
    return ending.code, ending.verdict(made)


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen("edits"))
def test_a_deck_edited_as_the_workaround_says(name: str, how: Workaround) -> None:
    assert judged(name)[1] == "FAIL" and judged(name, *how.edits) == (0, "PASS")


def before_the_last_run(name: str, order: str) -> tuple[str, str]:
    """The edit that inserts commands, by name, before the last run of a deck."""
    lines = report_of(name).deck.lines
    fixes = [line for line in lines if line.startswith("fix") and " rheo" in line]
    commands = {
        "define": fixes,
        "remove": [f"unfix {line.split()[1]}" for line in fixes[::-1]],
        "rheo": fixes[:1],
        "remove_rheo": [f"unfix {fixes[0].split()[1]}"],
        "pair": [line for line in lines if line.startswith("pair_")],
        "others": [line for line in lines if line.startswith(("fix", "compute")) and line not in fixes],
        "write": ["write_restart w.restart"],
        "read": ["clear", "comm_modify vel yes", "read_restart w.restart"],
        "run": ["run 0 post no"],
    }
    last = "thermo_style custom step v_inside\n"
    return last, "\n".join([*(line for word in order.split() for line in commands[word]), last])


@pytest.mark.lammps
@pytest.mark.parametrize(("name", "how"), chosen("orders"))
def test_commands_in_the_order_of_the_workaround(name: str, how: Workaround) -> None:
    """Restart files included."""
    for order, verdict in (*((order, "FAIL") for order in how.wrong), *((order, "PASS") for order in how.orders)):
        assert judged(name, before_the_last_run(name, order)) == (0, verdict), order
