"""eos-ref completion: what the shell completes, and the one command that makes it."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import click
from click.shell_completion import CompletionItem, get_completion_class

ROOT = Path(__file__).parents[1]
VARIABLE = "_EOS_REF_COMPLETE"  # as click names it
# Shell: where a user leads the script.
INSTALLED = {"bash": ">> ~/.bashrc", "zsh": ">> ~/.zshrc", "fish": "> ~/.config/fish/completions/eos-ref.fish"}
BEFORE = {
    "bash": "COMP_WORDBREAKS=${COMP_WORDBREAKS//:}  # engines are named pypi:VERSION\n",
    "zsh": "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }\n",
    "fish": "",
}


@click.command("completion")
@click.argument("shell", type=click.Choice(list(INSTALLED)))
def completion_command(shell: str) -> int:
    """Print the script with which a shell completes commands, options, cases, tags, findings and engines.

    Nothing is written. New sessions complete eos-ref after one of these:

    \b
    Example:  eos-ref completion bash >> ~/.bashrc
              eos-ref completion zsh >> ~/.zshrc
              eos-ref completion fish > ~/.config/fish/completions/eos-ref.fish
    """
    click.echo(f"# eos-ref completion {shell} {INSTALLED[shell]}\n{BEFORE[shell]}{_script(shell)}")
    return 0


def _script(shell: str) -> str:
    from lammps_cases.cli.main import group

    made = get_completion_class(shell)
    assert made is not None
    return made.source_template % made(group, {}, "eos-ref", VARIABLE).source_vars()


# --- what there is, read without the packages that check it


def _files() -> Iterator[dict[str, Any]]:
    import yaml

    loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    for path in sorted((ROOT / "data" / "cases").rglob("*.yaml")):
        yield yaml.load(path.read_text(encoding="utf-8"), loader)


def case_names() -> list[str]:
    """Return the names of the shipped cases, and of their files."""
    return _kept()["cases"]


def tag_names() -> set[str]:
    """Return the tags of the shipped cases."""
    return set(_kept()["tags"])


def _kept() -> dict[str, list[str]]:
    """Return names and tags; they are kept, as reading all files takes as long as all else that a shell waits for."""
    import platformdirs  # not eos_ref.cache and records.files, which load numpy

    at = [(str(path), path.stat().st_mtime_ns) for path in sorted((ROOT / "data" / "cases").rglob("*.yaml"))]
    key, kept = json.dumps(at), Path(platformdirs.user_cache_dir("eos-ref")) / "completion.json"
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        document = json.loads(kept.read_text(encoding="utf-8"))
        if document["key"] == key:
            return {name: list(map(str, document[name])) for name in ("cases", "tags")}
    names = _read()
    with contextlib.suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        made = kept.with_name(f"{kept.name}.{os.getpid()}")
        made.write_text(json.dumps({"key": key, **names}), encoding="utf-8")
        made.replace(kept)
    return names


def _read() -> dict[str, list[str]]:
    names, tags = list[str](), set[str]()
    for file in _files():
        axes = file.get("matrix", {}).values()
        names += [file["name"], *(".".join((file["name"], *labels)) for labels in product(*axes) if labels)]
        patches = (patch for axis in axes for patch in axis.values())
        for part in (file, *(patch for patch in patches if isinstance(patch, dict))):
            tags.update(part["tags"] if isinstance(part.get("tags"), list) else ())
    return {"cases": names, "tags": sorted(tags)}


def finding_names() -> list[str]:
    """Return the ids of the findings."""
    return list(json.loads((ROOT / "findings" / "shown_by.json").read_text(encoding="utf-8")))


def engine_names() -> list[str]:
    """Return the engines that were taken in, by name."""
    content = json.loads((ROOT / "findings" / "engines.json").read_text(encoding="utf-8"))
    return ["env", *(f"pypi:{version}" for version in content["engines"]), "path:"]


def _items(names: Iterable[str], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(incomplete)]


def cases(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a case."""
    return _items(case_names(), incomplete)


def tags(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a tag."""
    return _items(sorted(tag_names()), incomplete)


def findings(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a finding."""
    return _items(finding_names(), incomplete)


def findings_and_cases(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete a finding or a case."""
    return _items([*finding_names(), *case_names()], incomplete)


def engines(_: click.Context, __: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete an engine."""
    return _items(engine_names(), incomplete)
