"""Names in documents and docstrings exist and are unique: modules, classes, files, sections, make targets."""

from __future__ import annotations

import ast
import re
from collections import Counter
from functools import cache
from pathlib import Path

import pytest
from check_jsonschema import main as check_jsonschema
from click.testing import CliRunner

from lammps_cases.findings import LEDGER
from lammps_cases.findings.document import FOLDER
from lammps_cases.scene import casefile

ROOT = Path(__file__).parents[1]
PACKAGES = ("eos_ref", "lammps_cases")
PAGES = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))
ROOM = "tests/workshop/README.md"
DOCUMENTS = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "ARCHITECTURE.md", "eos_ref/NUMERICS.md", ROOM, *PAGES)
SOURCES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))
FORMS = ROOT / ".github" / "ISSUE_TEMPLATE"
FOREIGN = ("np", "numpy", "math", "pow", "llvmlite", "numba", "scipy", "pytest", "pandas")


@cache
def tree(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def defined(path: Path) -> frozenset[str]:
    """Return the names that a module and its classes define, as NAME and CLASS.NAME."""
    names: set[str] = set()

    def collect(body: list[ast.stmt], prefix: str) -> None:
        for node in body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(f"{prefix}{node.name}")
            if isinstance(node, ast.ClassDef):
                collect(node.body, f"{prefix}{node.name}.")
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names.update(
                    f"{prefix}{t.id}" for target in targets for t in ast.walk(target) if isinstance(t, ast.Name)
                )
            elif isinstance(node, ast.ImportFrom):
                names.update(f"{prefix}{alias.asname or alias.name}" for alias in node.names)
            elif isinstance(node, ast.If | ast.Try):
                collect(node.body, prefix)

    collect(tree(path).body, "")
    return frozenset(names)


def exists(dotted: str) -> bool:
    """Return whether a dotted name is a package, a module, or something that a module defines."""
    parts = dotted.split(".")
    for size in range(len(parts), 0, -1):
        path = ROOT.joinpath(*parts[:size])
        module = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if module.is_file():
            rest = parts[size:]
            reexported = bool(rest) and module.name == "__init__.py" and rest[0] in defined(module)
            return not rest or ".".join(rest) in defined(module) or reexported
    return False


@cache
def words() -> frozenset[str]:
    """Return every identifier, argument and short text of the packages' code."""
    names: set[str] = set()
    for path in SOURCES:
        names.add(path.stem)
        for node in ast.walk(tree(path)):
            for name in ("id", "attr", "arg", "name", "asname", "module"):
                names.update(str(getattr(node, name, "") or "").split("."))
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and len(node.value) < 60:
                names.update(re.split(r"[\s,]+", node.value))
    return frozenset(names)


def docstrings() -> list[tuple[str, str]]:
    """Return every docstring of the packages with its place."""
    nodes = ((path, node) for path in SOURCES for node in ast.walk(tree(path)))
    return [
        (f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)}", text)
        for path, node in nodes
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (text := ast.get_docstring(node))
    ]


@pytest.mark.slow
def test_names_in_docstrings_exist() -> None:
    """`NAME` in a docstring is a name of the packages; a dotted one of ours can be resolved."""
    missing = []
    for place, text in docstrings():
        for name in re.findall(r"(?<!`)(?<!:)(?<!\w)`([A-Za-z_][\w.]*)`(?!`)", text):
            parts = name.split(".")
            there = exists(name) if parts[0] in PACKAGES else parts[0] in FOREIGN or set(parts) <= words()
            if not there:
                missing.append(f"{place} `{name}`")
    assert missing == []


def test_class_names_are_unique() -> None:
    """No two public classes of the packages have the same name."""
    texts = (path.read_text(encoding="utf-8") for path in SOURCES)
    classes = Counter(name for text in texts for name in re.findall(r"^ *class (\w+)[(:]", text, re.MULTILINE))
    assert {"EOS", "RunRecord"} <= classes.keys()
    assert [name for name, count in classes.items() if count > 1 and not name.startswith("_")] == []


def test_glossary_is_short() -> None:
    """CONTRIBUTING.md explains at most 40 words."""
    glossary = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Glossary")[2]
    assert 2 < len(re.findall(r"^\|", glossary, flags=re.MULTILINE)) <= 40 + 2


@pytest.mark.parametrize("document", DOCUMENTS)
def test_names_in_documents_exist(document: str) -> None:
    """Files and modules that a document names in backticks or as links exist."""
    text = (ROOT / document).read_text(encoding="utf-8")
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    missing = [name for name in re.findall(r"`((?:eos_ref|lammps_cases)(?:\.\w+)+)`", prose) if not exists(name)]
    # A path below reports/ is what a command writes.
    files = re.findall(r"`((?:eos_ref|lammps_cases|tests|reports/accepted)/[\w./-]+)`", prose)
    links = [link for link in re.findall(r"\]\(([^)#:]+)\)", prose) if "://" not in link]
    missing += [name for name in files if not (ROOT / name).exists()]
    missing += [link for link in links if not ((ROOT / document).parent / link).exists() and not (ROOT / link).exists()]
    assert missing == []


def test_every_page_is_linked() -> None:
    """A page of the documentation can be reached from the README."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    of_findings = (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")
    findings = set(re.findall(r"\]\(\.\./(lammps_cases/data/findings/[\w-]+\.md)\)", of_findings))
    assert findings == {path.relative_to(ROOT).as_posix() for path in FOLDER.glob("*.md")}
    linked = set(re.findall(r"\]\((docs/[\w-]+\.md)\)", text)) | {"docs/index.md"}
    assert linked == set(PAGES)


def test_pages_for_users_are_short() -> None:
    """Together they have 6000 words at most, without the tables that are generated."""
    pages = ("tutorial", "audit", "verdicts", "cases", "ci", "versions", "findings", "faq", "python")
    texts = ((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in pages)
    words = [re.sub(r"<!-- (\w+):begin.*?\1:end -->", "", text, flags=re.DOTALL).split() for text in texts]
    assert sum(map(len, words)) <= 6000


def test_first_pages_quote_the_tutorial() -> None:
    """Headline and deck are those of the tutorial, whose output is tested; the number of findings is the ledger's."""
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    assert (ROOT / "docs" / "decks" / "in.tank").read_text(encoding="utf-8") in tutorial
    for document in ("README.md", "docs/index.md"):
        text = (ROOT / document).read_text(encoding="utf-8")
        (quoted,) = re.findall(r"(?:^> .*\n)+", text, flags=re.MULTILINE)
        assert " ".join(quoted.replace("> ", "").split()) in " ".join(tutorial.split()), document
        assert re.search(rf"\b{len(LEDGER)} (?:differences|bugs)", text), document


def test_evidence_has_one_heading_in_the_navigation() -> None:
    """A page under docs is in the navigation, except those of findings."""
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:\n")[2]
    (evidence,) = re.findall(r"- Evidence: \[(.*)\]", navigation)
    assert {"trust.md", "validation.md", "accuracy.md", "capacity.md"} <= set(evidence.split(", "))
    assert set(PAGES) <= {f"docs/{name}" for name in re.findall(r"[\w-]+\.md", navigation)}


@pytest.mark.parametrize("form", sorted(path.name for path in FORMS.glob("*.yml") if path.name != "config.yml"))
def test_issue_templates_are_valid(form: str) -> None:
    arguments = ["--builtin-schema", "vendor.github-issue-forms", str(FORMS / form)]
    done = CliRunner().invoke(check_jsonschema, arguments)
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(("file", "schema"), [("audit.yml", "github-workflows"), ("gitlab.yml", "gitlab-ci")])
def test_documented_jobs_are_valid(file: str, schema: str, tmp_path: Path) -> None:
    page = (ROOT / "docs" / "ci.md").read_text(encoding="utf-8")
    (block,) = re.findall(rf"Save\s+this as `{file}`.*?^```yaml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (tmp_path / file).write_text(block)
    done = CliRunner().invoke(check_jsonschema, ["--builtin-schema", f"vendor.{schema}", str(tmp_path / file)])
    assert done.exit_code == 0, done.output


def test_readme_is_short() -> None:
    """The first page for a newcomer fits a few screens."""
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 120


def test_architecture_lists_every_room() -> None:
    """ARCHITECTURE.md lists exactly the rooms of both packages."""
    text = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    for package in PACKAGES:
        block = re.search(rf"^{package}/.*?(?=^\S|\Z)", text, flags=re.MULTILINE | re.DOTALL)
        assert block is not None
        named = set(re.findall(r"^  (\w+)/", block[0], flags=re.MULTILINE))
        rooms = {path.name for path in (ROOT / package).iterdir() if path.is_dir() and path.name != "__pycache__"}
        assert named == rooms, package


def test_documents_count_the_cases_that_a_run_leaves_out() -> None:
    text = (ROOT / "docs" / "verdicts.md").read_text(encoding="utf-8")
    cases, more = casefile.load(), len(casefile.more())
    assert f"runs {len(casefile.select(cases))} of {len(cases)} cases" in text and f"all` runs {more} more" in text
    assert len(casefile.select(cases, tag=casefile.ALL)) == len(casefile.select(cases)) + more == len(cases) - 7
    told = {
        "Makefile": "--tag all: all {every})",
        "README.md": "run {runs} cases",
        "docs/trust.md": "runs {runs} of the {every} cases",
    }
    for path, words in told.items():
        said = words.format(runs=len(casefile.select(cases)), every=len(cases) - 7)
        assert said in (ROOT / path).read_text(encoding="utf-8"), path


def test_cited_sections_exist() -> None:
    """A section of NUMERICS.md that code or a document cites is one of its headings."""
    numerics = (ROOT / "eos_ref" / "NUMERICS.md").read_text(encoding="utf-8")
    sections = set(re.findall(r"^#+ (\d+)\.", numerics, flags=re.MULTILINE))
    cited = []
    for path in [*SOURCES, *(ROOT / name for name in DOCUMENTS)]:
        text = path.read_text(encoding="utf-8")
        assert "specification, " not in text, path
        cited += re.findall(r"NUMERICS(?:\.md)?, sections? (\d+)", text)
    assert cited
    assert set(cited) <= sections


def test_make_targets_in_documents_exist() -> None:
    """`make TARGET` in a document is a target of the Makefile."""
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    for document in DOCUMENTS:
        text = (ROOT / document).read_text(encoding="utf-8")
        assert set(re.findall(r"(?:`|^)make ([a-z]+)", text, flags=re.MULTILINE)) <= targets, document


def test_measurements_contain_no_path_of_the_machine() -> None:
    kept = [
        *ROOT.glob("eos_ref/**/*.json"),
        *ROOT.glob("lammps_cases/**/*.json"),
        *ROOT.glob("reports/accepted/**/*.json"),
    ]
    assert kept
    assert not [
        (path.name, place)
        for path in kept
        for place in re.findall(r"(?<!\w)/(?:tmp|root|home|opt|work|mnt|scratch)/\S*", path.read_text(encoding="utf-8"))
    ]
