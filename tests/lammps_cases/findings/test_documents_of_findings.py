"""Documents of findings: errors for damaged ones, and that none is read before it is needed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from eos_ref import InputError
from lammps_cases.findings import LEDGER
from lammps_cases.findings.document import FOLDER, document

NAME = "cubic-unit"


def test_every_document_has_a_record() -> None:
    assert {path.stem for path in FOLDER.iterdir()} == {entry.id for entry in LEDGER}


def test_numbers_are_inserted(tmp_path: Path) -> None:
    text = (FOLDER / f"{NAME}.md").read_text()
    damaged = text.replace("---\n\n", 'numbers:\n  ratio: "1.40"\n---\n\n').replace("dimensionless", r"\*{ratio}\*")
    (tmp_path / f"{NAME}.md").write_text(damaged)
    assert "is *1.40*." in document(NAME, tmp_path)["argument"]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("---\n\n", "", "finding: must begin with front matter"),
        ("number: 15", "number: fifteen", "number: must be a whole number, found 'fifteen'"),
        ("severity: medium\n", "", "severity: is missing"),
        ("severity: medium", "severity: grave", "severity: must be high, medium, low, found 'grave'"),
        ("severity: medium", "severity: [medium", "finding: is not valid YAML"),
        ("severity", "gravity", "gravity: is no key of a finding"),
        ("id: cubic-unit", "id: other", "id: must be cubic-unit, as the file, found 'other'"),
        ("---\n\n", "numbers:\n  ratio: 1.40\n---\n\n", "numbers.ratio: must be a name and text in quotes"),
        ("dimensionless", "{ratio}", "argument: must name numbers of the front matter, found 'ratio'"),
        ("## Workaround", "## Way out", "headings: must be What is documented, What LAMMPS does"),
        ("Convert A3 as 1/density^2.", "", "workaround: must be text, found ''"),
    ],
)
def test_a_damaged_document_is_refused_with_file_and_key(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text = (FOLDER / f"{NAME}.md").read_text()
    assert text.count(old) == 1
    path = tmp_path / f"{NAME}.md"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError) as raised:
        document(NAME, tmp_path)
    assert str(raised.value).startswith(complaint) and str(path) in str(raised.value)


def test_help_reads_no_document() -> None:
    code = (
        "import sys; from lammps_cases.cli import main; sys.argv[1:] = ['--help']\n"
        "try: main.main()\nfinally: print('lammps_cases.findings.document' in sys.modules, file=sys.stderr)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stderr == "False\n" and "findings" in ran.stdout
