"""Advised numbers written into a deck, in the place of its own, or into the case file of a scene."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from eos_ref.errors import InputError
from lammps_cases.audit import text
from lammps_cases.audit.messages import DeckSetups, ScriptCommand
from lammps_cases.records.files import read_text
from lammps_cases.records.yaml_files import yaml_text
from lammps_cases.scene.casefile import Case
from lammps_cases.studies.stability.choice import AdvisedNumbers

_VARIABLE = re.compile(r"\$\{(\w+)\}|\$(\w)")
_WORD = re.compile(r"\S+")


def advised_deck(deck: Path, setups: DeckSetups, choice: AdvisedNumbers) -> str:
    """Return the text of a deck with the advised numbers in the place of its own; all else stays as it is.

    A variable that is a plain number, and stands alone in the place of a number, gets the number itself.

    Raises
    ------
    InputError
        A number stands in another file, or in a line that cannot be read word by word.
    """
    lines = read_text(deck, "input script", text.LARGEST_SCRIPT).split("\n")
    ends = [0, *(line.number for line in text.logical_lines("\n".join(lines)))]
    edits = dict[tuple[int, int], str]()

    def physical(command: ScriptCommand) -> range:
        file, _, number = command.where.rpartition(":")
        held = range(ends[ends.index(int(number)) - 1], int(number)) if Path(file).name == deck.name else range(0)
        if not held or text.words(lines[held[0]])[:1] != text.words(command.written)[:1]:
            raise InputError("--write", f"edits lines of {deck.name} alone", command.written, command.where)
        return held

    for command in setups.script:
        for word, new in _new_words(command.values, choice, setups.runs[0].ntypes):
            at, place = _place(command, word, setups.script)
            edits[physical(at)[-1], place] = new
    for (last, word), new in sorted(edits.items(), reverse=True):
        _put(lines, range(ends[ends.index(last + 1) - 1], last + 1), word, new)
    if not any(command.values[:1] == ["timestep"] for command in setups.script):
        run = next(command for command in setups.script if command.values[:1] == ["run"])
        lines.insert(physical(run)[0], f"timestep {choice.of('time step'):.6g}")
    return "\n".join(lines)


def _new_words(values: Sequence[str], choice: AdvisedNumbers, ntypes: int) -> Iterator[tuple[int, str]]:
    """Yield the words of a command that change: their numbers, and the new ones; one behind the last is added."""
    match values:
        case ["timestep", _]:
            named = {1: "time step"}
        case ["fix", _, _, "rheo", _, _, _, *_]:
            named = {4: "cut", 5: "kernel", 6: "zmin"}
            yield from _new_speeds(values, choice, ntypes)
        case ["pair_style", *_] if "rheo" in values:
            named = {values.index("rheo") + 1: "cut"}
            if "rho/damp" in values:
                named[values.index("rho/damp") + 1] = "rho/damp"
            elif values[1] == "rheo" and (new := choice.of("rho/damp")):
                yield len(values), f"rho/damp {new:.6g}"
        case _:
            return
    for word, subject in named.items():
        new = choice.of(subject)
        if new != (values[word] if isinstance(new, str) else float(values[word])):
            yield word, new if isinstance(new, str) else f"{new:.6g}"


def _new_speeds(values: Sequence[str], choice: AdvisedNumbers, ntypes: int) -> Iterator[tuple[int, str]]:
    sound = choice.line("speed of sound")
    if sound.advised is None or sound.advised == sound.now:
        return
    if "speed/sound" not in values:
        yield len(values), f"speed/sound{ntypes * f' {sound.advised:.6g}'}"
        return
    first = values.index("speed/sound") + 1
    for word in range(first, first + ntypes):  # the ratio of the types' speeds stays
        yield word, f"{float(values[word]) * float(sound.advised) / float(sound.now or 1):.6g}"


def _place(command: ScriptCommand, word: int, script: Sequence[ScriptCommand]) -> tuple[ScriptCommand, int]:
    """Return the command and the word that hold a number: its own, or that of the variable which stands for it."""
    written = text.words(command.written)
    if len(written) != len(command.values) or written[0].value != command.values[0]:
        raise InputError("--write", f"cannot edit the line '{command.written}'", where=command.where)
    variable = _VARIABLE.fullmatch(written[word].raw) if word < len(written) else None
    for other in script if variable else ():
        match other.values:
            case ["variable", name, "equal" | "index" | "string", value] if variable and name in variable.groups():
                if text.words(other.written)[-1].value == value and _number(value):
                    return other, 3
    return command, word


def _number(word: str) -> bool:
    with contextlib.suppress(ValueError):
        return math.isfinite(float(word))
    return False


def _put(lines: list[str], physical: range, word: int, new: str) -> None:
    """Replace a word of a command that extends over some lines, or add one behind its last."""
    left, last = word, (physical[0], 0)
    for k in physical:
        for found in _WORD.finditer(lines[k]):
            if found[0].startswith("#"):
                break
            if found[0] == "&":
                continue
            if not left:
                lines[k] = lines[k][: found.start()] + new + lines[k][found.end() :]
                return
            left, last = left - 1, (k, found.end())
    k, end = last
    lines[k] = f"{lines[k][:end]} {new}{lines[k][end:]}"


def case_file(case: Case, choice: AdvisedNumbers | None = None) -> str:
    """Return the text of the case file of a scene, with the advised numbers if there are any."""
    content: dict[str, Any] = case.scene.model_dump(mode="json", exclude_unset=True)
    if choice is not None:
        content["evolve"]["timestep"] = choice.of("time step")
        content["rheo"] = content.get("rheo", {}) | {name: choice.of(name) for name in ("kernel", "cut", "zmin")}
        if damping := choice.of("rho/damp"):
            content["pair"] = content.get("pair", {}) | {"rho_damp": damping}
        sound = choice.line("speed of sound")
        for kind in content["types"] if sound.advised is not None else ():
            kind["cs"] = float(f"{kind.get('cs', 1.0) * float(sound.advised or 0) / float(sound.now or 1):.6g}")
    return yaml_text({"name": case.name.replace(".", "-"), "about": case.about.strip(), "scene": content})
