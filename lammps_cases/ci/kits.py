"""The kits: the files, their templates, and how they are written."""

from __future__ import annotations

import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from eos_ref import InputError
from eos_ref.errors import nearest
from lammps_cases.records.files import DATA, write_atomically
from lammps_cases.run.shards import DOCUMENT as COSTS
from lammps_cases.run.shards import Costs

TEMPLATES = DATA / "kits"
PLACE = re.compile(r"@([A-Z]+)@")  # in a template: a value given when the kit is made


@dataclass(frozen=True)
class KitFile:
    """A file for a user's repository."""

    path: str
    content: str
    executable: bool


@dataclass(frozen=True)
class Kit:
    """Files that belong together: path in the repository, or in a separate folder, by template."""

    name: str
    about: str
    files: Mapping[str, str]
    cluster: bool = False
    tests: bool = False  # force-style tests and decks come with them (`lammps_cases.bugs.upstream`)

    def filled(self, values: Mapping[str, str]) -> list[KitFile]:
        """Return the files with values in their placeholders."""
        filled = []
        for template, path in self.files.items():
            text = (TEMPLATES / template).read_text(encoding="utf-8")
            content = PLACE.sub(lambda place: values[place[1]], text)
            filled.append(KitFile(path, content, executable=content.startswith("#!")))
        return filled

    def __str__(self) -> str:
        return f"{self.name:12s}{self.about} ({', '.join(self.files.values())})"


_OF_SHARDS = {name: name for name in ("shard.sh", "merge.sh", "costs.json")}


KITS = (
    Kit("github", "your own cases in GitHub Actions", {"github.yml": ".github/workflows/eos-ref.yml"}),
    Kit("gitlab", "your own cases in GitLab CI", {"gitlab.yml": ".gitlab-ci.yml"}),
    Kit(
        "lammps",
        "a build of LAMMPS in, a verdict out: a script and a workflow for LAMMPS' own repository",
        {"verdict.sh": "tools/eos-ref/eos-ref.sh", "lammps.yml": ".github/workflows/eos-ref.yml"},
    ),
    Kit(
        "nightly",
        "LAMMPS' develop branch built and run every night; one issue, only if something changed",
        {"nightly.yml": ".github/workflows/eos-ref-nightly.yml"},
    ),
    Kit(
        "decks",
        "your own input decks as a regression test, in GitHub Actions and GitLab CI",
        {"decks.yml": ".github/workflows/eos-ref-decks.yml", "decks-gitlab.yml": "eos-ref-decks.gitlab-ci.yml"},
    ),
    Kit(
        "pre-commit",
        "the cases that a commit changes, before it is made",
        {"pre-commit.yaml": ".pre-commit-config.yaml"},
    ),
    Kit(
        "slurm",
        "a run in shards on a cluster: as a job array, or in one allocation",
        {"array.sh": "array.sh", "allocation.sh": "allocation.sh", **_OF_SHARDS},
        cluster=True,
    ),
    Kit("parallel", "a run in shards on one machine", {"parallel.sh": "parallel.sh", **_OF_SHARDS}, cluster=True),
    Kit(
        "reframe",
        "a run in shards as checks of ReFrame",
        {"reframe.txt": "eos_ref_check.py", **_OF_SHARDS},
        cluster=True,
    ),
    Kit(
        "unittest",
        "tests for LAMMPS' own test programs, with the reference's numbers",
        {"unittest.md": "unittest/force-styles/README.eosref.md"},
        tests=True,
    ),
)


def in_repository(repository: str) -> dict[str, str]:
    """Return the values of a kit for a CI service: owner and name of the repository that holds eos-ref.

    Raises
    ------
    InputError
        Not the name of a repository.
    """
    if not re.fullmatch(r"[A-Za-z0-9][\w.-]*/[\w.-]+", repository, re.ASCII):
        raise InputError("repository", "must be OWNER/NAME", repository)
    return {"REPOSITORY": repository}


def in_shards(costs: Costs, shards: int, options: Sequence[str]) -> dict[str, str]:
    """Return the values of a kit for a cluster: the shards, and the call of ``eos-ref run`` for each of them."""
    return {
        "COSTS": COSTS.text(costs).decode(),
        "SHARDS": str(shards),
        "OPTIONS": shlex.join(options),
        "FOLDER": shlex.quote(str(Path.cwd())),
        "PROGRAM": shlex.quote(str(Path(sys.executable).parent / "eos-ref")),
    }


def kit(name: str) -> Kit:
    """Return the kit with a name.

    Raises
    ------
    InputError
        No such kit (the nearest is suggested).
    """
    kits = {each.name: each for each in KITS}
    if name not in kits:
        raise InputError("kit", f"must be one of {', '.join(kits)}{nearest(name, kits)}", name)
    return kits[name]


def write(files: Sequence[KitFile], directory: Path) -> list[Path]:
    """Write files into a repository, all or none; existing files with the same content stay.

    Raises
    ------
    InputError
        A file exists with other content, or cannot be written.
    """
    for file in files:
        path = directory / file.path
        if path.exists() and (not path.is_file() or path.read_bytes() != file.content.encode()):
            raise InputError("file of the kit", "must not be there yet, or be the same", where=str(path))
    written = []
    for file in files:
        path = directory / file.path
        try:
            write_atomically(path, file.content)
            if file.executable:
                path.chmod(0o755)
        except OSError as error:
            raise InputError("file of the kit", f"cannot be written: {error.strerror}", where=str(path)) from None
        written.append(path)
    return written
