"""Every reader under atheris: inputs evolved from valid content that reach new branches.

``python -m tests.workshop.fuzz_nightly OUT RUNS [READER...]`` gives every reader so many inputs, and writes a table of
inputs, refused inputs and seconds; exceptions other than refusals are kept in OUT/READER. One process each, as
atheris never returns.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path

from tests.support import hostile

SLOWEST = 20  # seconds for one input
MEMORY = 4096  # MiB
# Of the runs, as many as the same time allows.
SHARES = {"message": 0.5, "csv": 0.2, "npz": 0.2, "baseline": 0.2, "deck": 0.2, "run.json": 0.2}
SHARES |= {"case file": 0.02, "extxyz": 0.01, "history": 0.02}


def fuzz(name: str, out: Path, runs: int) -> None:
    """Fuzz one reader in this process, which atheris ends."""
    import atheris

    reader = hostile.readers()[name]
    corpus = out / "corpus"
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(reader.seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    folder = Path(tempfile.mkdtemp(dir=os.environ.get("EOS_REF_FUZZ_TMP")))
    told = {"": 0, "refused": 0}
    begin = time.monotonic()

    def one(content: bytes) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            told["refused" if hostile.outcome(reader, content, folder) else ""] += 1
        if sum(told.values()) % 1000 == 0 or sum(told.values()) >= runs:
            line = (name, sum(told.values()), told["refused"], round(time.monotonic() - begin))
            (out / "counts").write_text("\t".join(map(str, line)) + "\n")

    options = [f"-runs={runs}", f"-timeout={SLOWEST}", f"-rss_limit_mb={MEMORY}", "-max_len=4096", "-verbosity=0"]
    atheris.Setup(["fuzz", *options, f"-artifact_prefix={out}/", str(corpus)], one)
    atheris.Fuzz()


INSTRUMENTED = ["eos_ref.syntax", "eos_ref.errors", "lammps_cases.audit", "lammps_cases.records", "lammps_cases.scene"]
INSTRUMENTED += ["lammps_cases.versions", "lammps_cases.run.shards", "yaml", "zipfile", "csv"]


def main() -> int:
    """Fuzz all readers, one after the other, and print the table."""
    out, runs, names = Path(sys.argv[1]).resolve(), int(float(sys.argv[2])), sys.argv[3:]
    failed = 0
    for name in names or list(hostile.readers()):
        folder = out / name.replace("/", "-").replace(" ", "-")
        folder.mkdir(parents=True, exist_ok=True)
        count = max(1, int(runs * SHARES.get(name, 1.0)))
        with (folder / "log").open("w") as log:
            code = subprocess.call([sys.executable, "-c", CHILD, name, str(folder), str(count)], stdout=log, stderr=log)
        failed += code != 0
        line = (folder / "counts").read_text().strip() if (folder / "counts").is_file() else f"{name}\t0\t0\t0"
        print(line, "" if code == 0 else f"FAILED: {folder}/log", sep="\t", flush=True)
    return int(failed > 0)


CHILD = f"""
import sys, pathlib, atheris
with atheris.instrument_imports(include={INSTRUMENTED!r}):
    from tests.workshop import fuzz_nightly
fuzz_nightly.fuzz(sys.argv[1], pathlib.Path(sys.argv[2]), int(sys.argv[3]))
"""

if __name__ == "__main__":
    sys.exit(main())
