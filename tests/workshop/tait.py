"""The cost of Tait's law in docs/tait.md: ``python -m tests.workshop.tait`` measures it, and writes the table.

The loops of ``tait.c`` are compiled with the same options and timed in turns, in seconds of the processor, as other
programs may run.
"""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from time import process_time

import numpy as np

from lammps_cases.records.files import write_atomically
from lammps_cases.records.measure import Timing, machine
from tests.workshop.tables_validation import placed

SOURCE = Path(__file__).with_suffix(".c")
PAGE = Path(__file__).parents[2] / "docs" / "tait.md"
OPTIONS = ("-O2", "-O3 -march=native")
PARTICLES, CALLS, ROUNDS = 10_000, 20, 51
# Function of the source, by what the table calls it; the first of a law is the one to compare with.
FORMS = {
    "tait/water": {
        "printed, (x^7 - 1)": "water_printed",
        "difference, Horner": "water_difference",
        "difference, factored": "water_factored",
    },
    "tait/general": {"printed, pow": "general_printed", "difference, expm1 and log1p": "general_difference"},
}


class Law(ctypes.Structure):
    """The parameters of a type, as in the source."""

    _fields_ = (
        ("csq", ctypes.c_double),
        ("rho0", ctypes.c_double),
        ("rho0inv", ctypes.c_double),
        ("gamma", ctypes.c_double),
    )


def compiled(options: str, folder: str) -> ctypes.CDLL:
    """Return the loops, compiled with some options."""
    library = f"{folder}/tait{options.replace(' ', '')}.so"
    subprocess.run(["cc", *options.split(), "-shared", "-fPIC", "-o", library, str(SOURCE), "-lm"], check=True)
    return ctypes.CDLL(library)


def timed(library: ctypes.CDLL) -> dict[str, Timing]:
    """Return the processor time of every loop over particles of two types within 5 % of rho0, in turns."""
    laws = (Law * 2)(
        *(Law(cs**2, rho0, 1 / rho0, gamma) for rho0, cs, gamma in ((1.2345, 7.89, 1.4), (0.9, 3.1, 7.15)))
    )
    random = np.random.default_rng(1)
    type_n = random.integers(0, 2, PARTICLES).astype(np.int32)
    rho_n = np.where(type_n, 0.9, 1.2345) * (1 + random.uniform(-0.05, 0.05, PARTICLES))
    p_n = np.empty(PARTICLES)
    rho, kind, p = (ctypes.c_void_p(array.ctypes.data) for array in (rho_n, type_n, p_n))
    calls: dict[str, Callable[[], object]] = {
        name: partial(getattr(library, name), ctypes.c_long(PARTICLES), rho, kind, laws, p)
        for forms in FORMS.values()
        for name in forms.values()
    }
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(ROUNDS):
        for name in sorted(calls, reverse=bool(turn % 2)):
            begin = process_time()
            for _ in range(CALLS):
                calls[name]()
            seconds[name].append((process_time() - begin) / CALLS / PARTICLES)
    return {name: Timing(tuple(each[1:]), CALLS, each[0]) for name, each in seconds.items()}


def table() -> Iterator[str]:
    """Yield the table as Markdown: nanoseconds per particle of each form, and their ratio to the printed form's."""
    version = subprocess.run(["cc", "--version"], check=True, capture_output=True, text=True).stdout.splitlines()[0]
    about = machine()
    day = f"{datetime.now(UTC):%d %B %Y}"
    yield f"`python -m tests.workshop.tait`, {day}, {about['processor']}, {version}, load {about['load']}:\n"
    yield "| law | form | " + " | ".join(f"ns per particle, `{o}` | times the printed form" for o in OPTIONS) + " |"
    yield "|---|---|" + "---|---|" * len(OPTIONS)
    with tempfile.TemporaryDirectory() as folder:
        took = [timed(compiled(options, folder)) for options in OPTIONS]
    for law, forms in FORMS.items():
        printed, *_ = forms.values()
        for form, name in forms.items():
            ratios = [of[name].against(of[printed]) for of in took]
            cells = [
                f"{of[name].seconds.median * 1e9:.2g} | "
                + ("1" if name == printed else f"{ratio.median:.2f} ({ratio.low:.2f} to {ratio.high:.2f})")
                for of, ratio in zip(took, ratios, strict=True)
            ]
            yield f"| {law} | {form} | {' | '.join(cells)} |"


if __name__ == "__main__":
    write_atomically(PAGE, placed(PAGE.read_text(encoding="utf-8"), "\n".join(table())))
