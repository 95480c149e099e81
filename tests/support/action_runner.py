"""Runs the steps of a composite action as GitHub's runner does; other actions are only recorded."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

EXPRESSION = re.compile(r"\$\{\{(.*?)\}\}")
CONTEXT = re.compile(r"\b(?:github|inputs|runner|steps)(?:\.[\w-]+)+")


@dataclass
class Done:
    """The results of running an action."""

    code: int = 0
    out: str = ""
    outputs: dict[str, str] = field(default_factory=dict)
    used: dict[str, dict[str, str]] = field(default_factory=dict)  # other actions, with their inputs
    summary: str = ""


def run_action(
    folder: Path,
    given: Mapping[str, str],
    workspace: Path,
    programs: Path,
    leave_out: tuple[str, ...] = ("install",),
    github: Mapping[str, str] | None = None,
) -> Done:
    """Run the action in ``folder`` with some inputs, in a workspace, without the steps whose ids are left out.

    ``github`` is GitHub's description of the event, by default a push; ``programs`` holds the eos-ref that an
    installation would put on the path.
    """
    action = yaml.safe_load((folder / "action.yml").read_text())
    assert set(given) <= set(action["inputs"]), "an input that the action does not have"
    known: dict[str, Any] = {f"inputs.{name}": str(spec["default"]) for name, spec in action["inputs"].items()}
    known |= {f"inputs.{name}": value for name, value in given.items()}
    known |= {"runner.os": "Linux", "runner.arch": "X64", "github.event_name": "push", "github.event.number": ""}
    known |= github or {}
    done = Done()
    for at, step in enumerate(action["runs"]["steps"]):
        if step.get("id") in leave_out or not _due(step, known, done):
            continue
        if "uses" in step:
            done.used[step["uses"]] = {key: _filled(str(value), known) for key, value in step["with"].items()}
            continue
        code, said, outputs = _shell(step, known, folder, workspace, programs, at)
        done.out += said
        done.code = done.code or code
        known |= {f"steps.{step.get('id')}.outputs.{name}": value for name, value in outputs.items()}
    done.outputs = {name: _filled(spec["value"], known) for name, spec in action["outputs"].items()}
    summary = workspace / ".runner" / "summary"
    done.summary = summary.read_text() if summary.exists() else ""
    return done


def _due(step: Mapping[str, Any], known: Mapping[str, Any], done: Done) -> bool:
    condition = step.get("if", "success()")
    if "always()" not in condition and done.code:
        return False
    python = EXPRESSION.sub(r"\1", condition).replace("&&", " and ").replace("||", " or ")
    python = CONTEXT.sub(lambda found: repr(known[found[0]]), python)
    return bool(eval(python, {"always": lambda: True, "success": lambda: True}))


def _filled(text: str, known: Mapping[str, Any]) -> str:
    """A text with its expressions evaluated: names alone, as this action has no others."""
    return EXPRESSION.sub(lambda found: str(known.get(found[1].strip(), "")), text)


def _shell(
    step: Mapping[str, Any], known: Mapping[str, Any], folder: Path, workspace: Path, programs: Path, at: int
) -> tuple[int, str, dict[str, str]]:
    assert "${{" not in step["run"], "an input in the text of a command could be a command"
    place = workspace / ".runner"
    place.mkdir(exist_ok=True)
    output = place / f"output-{at}"
    output.touch()
    environ = {
        **os.environ,
        "PATH": os.pathsep.join([str(programs), os.environ["PATH"]]),
        "GITHUB_ACTIONS": "true",
        "GITHUB_ACTION_PATH": str(folder),
        "GITHUB_WORKSPACE": str(workspace),
        "GITHUB_OUTPUT": str(output),
        "GITHUB_PATH": str(place / "path"),
        "GITHUB_STEP_SUMMARY": str(place / "summary"),
        "RUNNER_TEMP": str(place),
        **{name: _filled(str(value), known) for name, value in step.get("env", {}).items()},
    }
    # GitHub's own options for shell: bash
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
    ended = subprocess.run(command, cwd=workspace, env=environ, capture_output=True, text=True, check=False)
    outputs = dict(line.split("=", 1) for line in output.read_text().splitlines())
    return ended.returncode, ended.stdout + ended.stderr, outputs
