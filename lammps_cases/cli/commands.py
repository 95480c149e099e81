"""Click commands made from the signatures of functions: names, types, defaults and help are written once, there.

A parameter whose annotation holds an `Option` or `Positional` becomes one of the command; a dataclass stands for its
options. A flag is bool, a choice a Literal, a repeatable option has the default () or is a tuple. Options common to
several commands are annotations here; some act when they are parsed. Shell completions are read without the packages
that check them.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import re
from collections.abc import Callable, Iterable
from itertools import product
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import click
from annotated_types import Ge
from click.shell_completion import get_completion_class

from lammps_cases.records.options import Option, Positional, gathered, option_of, parameters

ROOT = Path(__file__).parents[1]
VARIABLE = "_EOS_REF_COMPLETE"  # click's name
# Shell: the file for the script.
INSTALLED = {"bash": ">> ~/.bashrc", "zsh": ">> ~/.zshrc", "fish": "> ~/.config/fish/completions/eos-ref.fish"}
BEFORE = {
    "bash": "COMP_WORDBREAKS=${COMP_WORDBREAKS//:}  # engines are named pypi:VERSION\n",
    "zsh": "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }\n",
    "fish": "",
}

Run = Annotated[Path, Positional()]
Json = Annotated[bool, Option("Print only one JSON document.", "--json")]
Report = Annotated[Path | None, Option("Report folder.  [default: by date, in reports or reports/parts]")]
Engines = Annotated[
    tuple[str, ...],
    Option("env (default), pypi:VERSION or path:PLACE; may be repeated.", "--engine", complete="engines"),
]
Processes = Annotated[Annotated[int, Ge(1)] | None, Option("Processes at a time (default: one per core).")]
Resume = Annotated[bool, Option("Keep the parts that the folder has (default), or redo all.", "--resume/--fresh")]
Baselines = Annotated[Path, Option("Folder of the baselines, one per engine.")]
ACCEPTED = Path("reports/accepted")
Deck = Annotated[Path | None, Option("Engines audit this deck, or all decks of this folder, instead of running cases.")]


def command(
    *others: click.Parameter, cls: type[click.Command] = click.Command
) -> Callable[[Callable[..., int]], click.Command]:
    """Return a decorator that makes a command of a function NAME_command; ``others`` act and are not passed on."""

    def made(function: Callable[..., int]) -> click.Command:
        return cls(
            function.__name__.removesuffix("_command").replace("_", "-"),
            params=[*(parameter(each) for each in parameters(function) if option_of(each.annotation)), *others],
            callback=lambda **given: function(**gathered(function, given)),
            help=inspect.getdoc(function),
        )

    return made


def parameter(of: inspect.Parameter) -> click.Parameter:
    """Return the parameter of a command."""
    option, needed = option_of(of.annotation), of.default is of.empty
    assert option is not None, of
    settings, default = option.settings.copy(), None if needed else of.default
    settings = ({} if default in (None, ()) else {"default": default}) | settings
    if kind_of_names := settings.pop("complete", None):
        settings["shell_complete"] = lambda _, __, incomplete: completed(kind_of_names, incomplete)
    kind = Path if settings.pop("path", False) else _value(of.annotation)
    many = default == () or get_origin(kind) is tuple
    settings = {"type": _type(kind, of.annotation, settings.pop("like", ""))} | settings
    if isinstance(option, Positional):
        return click.Argument([of.name], nargs=-1 if many else 1, required=needed, **settings)
    flags = option.flags or (f"--{of.name.replace('_', '-')}",)
    shown = default not in (None, "", ()) and kind is not bool and "[default" not in option.text
    settings = {"multiple": many, "is_flag": kind is bool or None, "show_default": shown} | settings
    return click.Option([*flags, of.name], required=needed, help=option.text, **settings)


def _value(annotation: Any) -> Any:
    while get_origin(annotation) in (Annotated, Union, UnionType):
        annotation = get_args(annotation)[0]
    return annotation


class ChoiceOrLike(click.Choice[str]):
    """A choice, or a text that matches a pattern."""

    def __init__(self, choices: tuple[str, ...], pattern: str) -> None:
        super().__init__(choices)
        self.pattern = pattern

    def convert(self, value: Any, param: click.Parameter | None, context: click.Context | None) -> Any:
        """Return the value."""
        return value if re.fullmatch(self.pattern, value) else super().convert(value, param, context)


def _type(kind: Any, annotation: Any, pattern: str) -> Any:
    if get_origin(kind) is tuple:
        return _type(get_args(kind)[0], annotation, pattern)
    if get_origin(kind) is Literal:
        return ChoiceOrLike(get_args(kind), pattern)
    if bounds := _bounds(annotation):
        return (click.IntRange if kind is int else click.FloatRange)(*bounds)
    return click.Path(path_type=Path) if kind is Path else kind


def _bounds(annotation: Any) -> tuple[Any, Any] | None:
    """Return the least and the largest value from the metadata of an annotation."""
    own = getattr(annotation, "__metadata__", ())
    found = next((each for each in own if hasattr(each, "ge")), None)
    inner = (bounds for part in get_args(annotation) if (bounds := _bounds(part)))
    return (found.ge, getattr(found, "le", None)) if found else next(inner, None)


def _use_launcher(_: click.Context, __: click.Parameter, template: str | None) -> None:
    if template:
        from lammps_cases.engine import mpi

        os.environ[mpi.VARIABLE] = mpi.checked(template)  # read by the processes of the engine


def _limit_memory(context: click.Context, _: click.Parameter, text: str | None) -> None:
    if text:
        from lammps_cases.engine import pool

        context.with_resource(pool.limited(text))


def _use_cluster(context: click.Context, _: click.Parameter, scheduler: str | None) -> None:
    if scheduler:
        from lammps_cases.engine import cluster

        context.with_resource(cluster.used(scheduler))


LAUNCHER = click.Option(
    ["--launcher"],
    metavar="COMMAND",
    envvar="EOS_REF_LAUNCHER",
    expose_value=False,
    callback=_use_launcher,
    help="How to start several ranks: 'mpirun -n {n}', 'srun -n {n}' (default: that of LAMMPS' MPI).",
)
MEMORY = click.Option(
    ["--memory"],
    metavar="SIZE",
    envvar="EOS_REF_MEMORY",
    expose_value=False,
    callback=_limit_memory,
    help="Memory of each LAMMPS process: 500M, 4G, 1T (default: its share of 80 % of the machine).",
)


def cluster(what: str) -> click.Option:
    """Return the option of a Dask cluster, with ``what`` its workers do."""
    text = f"Scheduler of a Dask cluster (tcp://HOST:PORT), whose workers {what}."
    return click.Option(["--cluster"], metavar="ADDRESS", expose_value=False, callback=_use_cluster, help=text)


CLUSTER = cluster("take the place of --jobs")


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
    from lammps_cases.cli.main import group

    made = get_completion_class(shell)
    assert made is not None
    script = made.source_template % made(group, {}, "eos-ref", VARIABLE).source_vars()  # source() starts the shell
    click.echo(f"# eos-ref completion {shell} {INSTALLED[shell]}\n{BEFORE[shell]}{script}")
    return 0


def completed(kind: str, incomplete: str) -> list[str]:
    """Return the names of a kind, a key of `NAMES`, that begin with some text."""
    return [name for name in NAMES[kind]() if name.startswith(incomplete)]


def case_names() -> list[str]:
    """Return the names of the shipped cases, and of their files."""
    return _kept()["cases"]


def tag_names() -> set[str]:
    """Return the tags that the shipped case files name."""
    return set(_kept()["tags"])


def finding_names() -> list[str]:
    """Return the ids of the findings."""
    return list(json.loads((ROOT / "findings" / "shown_by.json").read_text(encoding="utf-8")))


def engine_names() -> list[str]:
    """Return the names of the registered engines."""
    content = json.loads((ROOT / "findings" / "engines.json").read_text(encoding="utf-8"))
    return ["env", *(f"pypi:{version}" for version in content["engines"]), "path:"]


NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "cases": case_names,
    "tags": lambda: sorted({*tag_names(), "all", "more"}),
    "findings": finding_names,
    "findings_and_cases": lambda: [*finding_names(), *case_names()],
    "engines": engine_names,
}


def _kept() -> dict[str, list[str]]:
    """Return names and tags, cached: reading all files takes as long as everything else in a completion."""
    import platformdirs  # not eos_ref.cache and records.files, which load numpy

    paths = sorted((ROOT / "data" / "cases").rglob("*.yaml"))
    key = json.dumps([(str(path), path.stat().st_mtime_ns) for path in paths])
    kept = Path(platformdirs.user_cache_dir("eos-ref")) / "completion.json"
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        document = json.loads(kept.read_text(encoding="utf-8"))
        if document["key"] == key:
            return {name: list(map(str, document[name])) for name in ("cases", "tags")}
    names = _read(paths)
    with contextlib.suppress(OSError):
        kept.parent.mkdir(parents=True, exist_ok=True)
        made = kept.with_name(f"{kept.name}.{os.getpid()}")
        made.write_text(json.dumps({"key": key, **names}), encoding="utf-8")
        made.replace(kept)
    return names


def _read(paths: Iterable[Path]) -> dict[str, list[str]]:
    import yaml

    names, tags, loader = list[str](), set[str](), getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    for path in paths:
        file: dict[str, Any] = yaml.load(path.read_text(encoding="utf-8"), loader)
        axes = file.get("matrix", {}).values()
        names += [file["name"], *(".".join((file["name"], *labels)) for labels in product(*axes) if labels)]
        patches = (patch for axis in axes for patch in axis.values())
        for part in (file, *(patch for patch in patches if isinstance(patch, dict))):
            tags.update(part["tags"] if isinstance(part.get("tags"), list) else ())
    return {"cases": names, "tags": sorted(tags)}
