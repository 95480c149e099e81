"""Changes of the reference's source, addressed by function and syntax tree: line breaks and comments do not matter."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import eos_ref
from eos_ref.errors import InputError

FOLDER = Path(eos_ref.__file__).parent


def text_of(module: str) -> str:
    """Return the source of a module of the reference, named below ``eos_ref``."""
    return (FOLDER / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")


def split_name(function: str) -> tuple[str, str]:
    """Return the module below ``eos_ref`` and the qualified name within it, of ``eos_ref.MODULE:NAME``."""
    module, _, name = function.removeprefix("eos_ref.").partition(":")
    return module, name


def definition(tree: ast.Module, name: str, where: str = "") -> ast.stmt:
    """Return what a module defines by a qualified name: a class, a function, a method, or a constant.

    Raises
    ------
    InputError
        The module defines nothing of this name.
    """
    node: ast.AST = tree
    for part in name.split("."):
        inner = [child for child in getattr(node, "body", ()) if part in _names(child)]
        if not inner:
            raise InputError("name", "must be that of a definition in the reference's module", name, where)
        node = inner[0]
    assert isinstance(node, ast.stmt)
    return node


def _names(statement: ast.stmt) -> list[str]:
    match statement:
        case ast.FunctionDef() | ast.ClassDef():
            return [statement.name]
        case ast.Assign():
            return [target.id for target in statement.targets if isinstance(target, ast.Name)]
        case ast.AnnAssign(target=ast.Name(id=name)):
            return [name]
    return []


def edited(text: str, name: str, replace: str, by: str, at: int | None = None, where: str = "") -> str:
    """Return a module's source with one expression, or one run of statements, replaced in one definition.

    Parameters
    ----------
    text : str
        The module's source.
    name : str
        Qualified name of the definition within the module; see `definition`.
    replace, by : str
        Python expressions; or statements, of which ``by`` may have none.
    at : int, optional
        Which match is replaced, from 1 on; without it there must be exactly one.
    where : str, optional
        What asks for the change, for messages.

    Raises
    ------
    InputError
        Text that is not Python, a name that the module does not define, no match, or several without ``at``.
    """
    old, new = _parsed(replace, where), _parsed(by, where)
    tree = ast.parse(text)
    inside = definition(tree, name, where)
    expressions = [part.value for part in (*old, *new) if isinstance(part, ast.Expr)]
    if len(old) == len(new) == 1 and len(expressions) == 2:
        matches = _expressions(inside, *expressions)
    else:
        matches = _statements(inside, old, new)
    if not matches or (len(matches) > 1 if at is None else at > len(matches)):
        rule = f"must be in {name} once" if at is None else f"must be in {name} at least {at} times"
        raise InputError(f"source {replace!r}", rule, f"{len(matches)} times", where)
    matches[(at or 1) - 1]()
    return ast.unparse(tree)


def _parsed(text: str, where: str) -> list[ast.stmt]:
    try:
        return ast.parse(textwrap.dedent(text)).body
    except SyntaxError as error:
        raise InputError("source", f"must be Python ({error.msg})", text, where) from None


def _expressions(inside: ast.stmt, old: ast.expr, new: ast.expr) -> list[Callable[[], None]]:
    """Return the replacements of an expression, one for each place that has it."""
    changes: list[Callable[[], None]] = []
    for node in ast.walk(inside):
        for name, child in ast.iter_fields(node):
            if isinstance(child, list):
                changes += [_in_list(child, k, k + 1, [new]) for k, part in enumerate(child) if _same(part, old)]
            elif _same(child, old):
                changes.append(partial(setattr, node, name, new))
    return changes


def _statements(inside: ast.stmt, old: list[ast.stmt], new: list[ast.stmt]) -> list[Callable[[], None]]:
    """Return the replacements of a run of statements, one for each place that has it."""
    bodies = [
        body
        for node in ast.walk(inside)
        for body in (getattr(node, name, None) for name in ("body", "orelse", "finalbody"))
        if isinstance(body, list)
    ]
    return [
        _in_list(body, k, k + len(old), new or [ast.Pass()] * (len(body) == len(old)))
        for body in bodies
        for k in range(len(body) - len(old) + 1)
        if all(map(_same, body[k : k + len(old)], old))
    ]


def _same(node: object, wanted: ast.AST) -> bool:
    return isinstance(node, ast.AST) and type(node) is type(wanted) and ast.dump(node) == ast.dump(wanted)


def _in_list(items: list[Any], begin: int, end: int, new: list[Any]) -> Callable[[], None]:
    return lambda: items.__setitem__(slice(begin, end), new)
