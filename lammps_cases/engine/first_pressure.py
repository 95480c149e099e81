"""The pressure that thermo prints before the first step of a deck, on some number of ranks.

``python -m lammps_cases.engine.first_pressure SITE DECK`` is what a rank runs, in the folder of the deck.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from lammps_cases.engine import mpi
from lammps_cases.engine.ranks import require_mpi
from lammps_cases.engine.session import EngineLacks, EngineRefused, open_lammps, package_directory
from lammps_cases.engine.stepping import instance

RUN = re.compile(r"^[ \t]*run\s.*", re.MULTILINE)


def first_pressure(
    site: str | None, deck: Path, count: int, newton: bool | None = None, timeout: float = 120.0
) -> float:
    """Return it; a function for a worker, as MPI's launcher is that of the MPI that is loaded.

    Parameters
    ----------
    deck : Path
        It is read as far as its first run command.
    count : int
        Number of ranks.
    newton : bool, optional
        A setting to take in place of the deck's.

    Raises
    ------
    EngineLacks
        This LAMMPS was built without MPI, or there is no launcher.
    EngineRefused
        LAMMPS stopped with an error, or took too long.
    """
    command, environment = _launcher(site, count) if count > 1 else ([], dict(os.environ))
    paths = [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    with tempfile.TemporaryDirectory(prefix="eos-ref-first-") as folder:
        begun = Path(folder) / "in.first"
        begun.write_text(_begun(deck.read_text(), newton))
        program = [sys.executable, "-P", "-m", __name__, site or "", str(begun)]
        try:
            outcome = subprocess.run(
                [*command, *program], cwd=deck.parent, stdin=subprocess.DEVNULL, capture_output=True, text=True,
                timeout=timeout, env={**environment, "PYTHONPATH": os.pathsep.join(paths)}, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            raise EngineRefused(f"no pressure within {timeout:g} s") from None
    lines = [line for line in outcome.stdout.splitlines() if line.startswith("{")]
    if not lines:
        said = [line for line in (outcome.stderr + outcome.stdout).splitlines() if line.strip()]
        raise EngineRefused(said[-1].strip() if said else f"LAMMPS ended with exit status {outcome.returncode}")
    return float(json.loads(lines[0])["press"])


def _launcher(site: str | None, count: int) -> tuple[list[str], dict[str, str]]:
    with instance(site).use() as lmp:
        require_mpi(lmp, count)
    try:
        return mpi.launcher(package_directory(site).parent, count)
    except mpi.LauncherMissing as error:
        raise EngineLacks(str(error)) from None


def _begun(text: str, newton: bool | None) -> str:
    """Return a deck as far as its first run, which takes no step."""
    run = RUN.search(text)
    text = text[: run.start()] if run else text
    if newton is not None:
        text = re.sub(r"^[ \t]*newton\s.*", f"newton {'on' if newton else 'off'}", text, flags=re.MULTILINE)
    return f"{text}\nrun 0\n"


def main(site: str, deck: str) -> None:
    """Print the pressure, on the first of the ranks."""
    lmp = open_lammps(site or None)
    lmp.file(deck)
    press = lmp.get_thermo("press")
    if lmp.extract_setting("world_rank") == 0:
        print(json.dumps({"press": press}), flush=True)
    lmp.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
