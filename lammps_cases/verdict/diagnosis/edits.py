"""Edits of one function of the reference: every expression of its source, replaced by a plausible mistake.

An operand becomes another value of the same kind in scope, or stands for another particle; a factor or a term is
left out, doubled, squared or negated; a branch is reversed; arguments are exchanged; a statement is left out.
Kinds (number type, shape) are those of the values in an observed call.
"""

from __future__ import annotations

import ast
import copy
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lammps_cases.comparison.changed import bodies, definition, function_of
from lammps_cases.scene.changes import Change, hypothesis

Kind = tuple[Any, ...] | None
Scope = Mapping[str, Any]

_TWINS = {
    "maximum": "minimum", "minimum": "maximum",
    "arithmetic_mean": "harmonic_mean", "harmonic_mean": "arithmetic_mean",
}  # fmt: skip
_CONTAINERS = (ast.Tuple, ast.List, ast.ListComp, ast.Starred, ast.Slice)
_OTHER_SIDE = {"i": "j", "j": "i"}
_COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.Gt, ast.LtE), ast.Gt: (ast.Lt, ast.GtE), ast.LtE: (ast.Gt, ast.Lt), ast.GtE: (ast.Lt, ast.Gt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
}  # fmt: skip
_PAIRS = (
    "self.i > self.j",
    "self.i < self.j",
    "self.type_n[self.i] == self.type_n[self.j]",
    "self.type_n[self.i] != self.type_n[self.j]",
    "self.solid_n[self.i] == self.solid_n[self.j]",
    "self.solid_n[self.i] != self.solid_n[self.j]",
)


EVERYWHERE = "in all its statements"


@dataclass
class _Place:
    """The place of an expression: its parent, and the variables and the statement around it."""

    node: ast.expr
    scope: dict[str, Any]
    parent: ast.AST
    statement: str


def kind(of: Any) -> Kind:
    """Return number type and shape of a value; None if no formula computes with it."""
    if isinstance(of, np.ndarray | np.generic | float | int | bool):
        array = np.asarray(of)
        number = "f" if array.dtype.kind == "f" else array.dtype.kind
        return (number, *array.shape) if number in "fib" else None
    if isinstance(of, list) and of:
        first = kind(of[0])
        return None if first is None else ("list", len(of), *first)
    return None


class FunctionEdits:
    """The changes of one function.

    Parameters
    ----------
    path : str
        ``MODULE:QUALIFIED_NAME``.
    scope : mapping
        Its local variables at the end of an observed call.
    words : str
        What it computes, with ``{}`` for the number of a line.
    others : sequence of str
        Operands of the same class that may replace others.
    """

    def __init__(self, path: str, scope: Scope, words: str, others: tuple[str, ...] = ()) -> None:
        self.path, self.words = path, words
        self.node, _ = definition(path)
        self.scope = {**function_of(path).__globals__, **scope}
        self._values: dict[tuple[int, str], Kind] = {}
        self._number = _numbered(ast.walk(self.node)) | _numbered(s for body in bodies(self.node) for s in body)
        named = sorted({*operands(self.node), *others, *(name for name in scope if name.isidentifier())})
        self.pool = [
            (text, made, _parsed(text)) for text in named if (made := self._kind(text, self.scope)) is not None
        ]

    def __iter__(self) -> Iterator[Change]:
        places = [place for statement in self.node.body for place in _inside(statement, self.scope, "")]
        for place in places:
            before = ast.unparse(place.node)
            around = "" if place.statement == before else f" in `{place.statement}`"
            for after in dict.fromkeys(map(ast.unparse, self._replacements(place))):
                if after != before:
                    yield self._change(place.node, f"had `{after}` for `{before}`{around}", before, after)
        yield from self._everywhere(places)
        for statement in [s for body in bodies(self.node) for s in body if _is_left_out(s)]:
            text = ast.unparse(statement)
            yield self._change(statement, "left out `{}`".format(text.partition("\n")[0]), text, "")

    def _everywhere(self, places: Sequence[_Place]) -> Iterator[Change]:
        """Yield operands replaced wherever they occur."""
        by_text: dict[str, list[_Place]] = {}
        for place in places:
            if _is_operand(place.node) and self._kind_of(place.node, place.scope) is not None:
                by_text.setdefault(ast.unparse(place.node), []).append(place)
        for before, same in by_text.items():
            of = self._kind_of(same[0].node, same[0].scope)
            for after, made, _ in self.pool if len(same) > 1 else ():
                if made == of and after != before:
                    yield self._change(same[0].node, f"had `{after}` for `{before}` {EVERYWHERE}", before, after, 0)

    def _change(self, node: Any, text: str, before: str, after: str, at: int | None = None) -> Change:
        what = f"{self.words.format(node.lineno)} {text}"
        at = self._number[id(node)] if at is None else at
        return hypothesis(what, function=self.path, replace=before, by=after, at=at)

    def _kind(self, text: str, scope: Scope) -> Kind:
        try:
            with np.errstate(all="ignore"):
                return kind(eval(text, dict(scope)))
        except Exception:  # not in this scope
            return None

    def _kind_of(self, node: ast.expr, scope: dict[str, Any]) -> Kind:
        key = id(scope), ast.unparse(node)
        if key not in self._values:
            self._values[key] = self._kind(key[1], scope)
        return self._values[key]

    # --- plausible mistakes in an expression

    def _replacements(self, place: _Place) -> Iterator[ast.expr]:
        node, scope = place.node, place.scope
        of = self._kind_of(node, scope)
        if _is_operand(node) and of is not None:
            yield from (other for _, made, other in self.pool if made == of)
            if len(of) == 1 and of[0] == "f":
                yield from (_parsed("0.0"), _parsed("1.0"))
        yield from _structural(node)
        if of is None and not isinstance(node, ast.Call):
            return
        if of is None or of[0] == "f":
            yield from self._numbers(place, of)
        if of is not None and of[0] == "i" and isinstance(place.parent, ast.Subscript) and "type_n" in _names_of(scope):
            yield _parsed(f"self.type_n[{ast.unparse(node)}]")
            yield _parsed(f"self.type_n[{ast.unparse(node)}] - 1")
            yield _parsed(f"({ast.unparse(node)}) - 1")

    def _numbers(self, place: _Place, of: Kind) -> Iterator[ast.expr]:
        node = place.node
        text = ast.unparse(node)
        inside = isinstance(place.parent, ast.BinOp | ast.UnaryOp)
        if isinstance(node, ast.Call) and not (inside or isinstance(place.parent, ast.Call | ast.Assign | ast.Return)):
            return
        for form in ("-({})", "2 * ({})", "0.5 * ({})", "({0}) * ({0})"):
            yield _parsed(form.format(text))
        if of is not None and isinstance(place.parent, ast.Assign | ast.Return) and not isinstance(node, ast.Constant):
            for other, made, _ in self.pool:
                if other != text and (made == of or made == ("f",)) and made[0] == "f":
                    yield _parsed(f"({text}) * ({other})")
                    yield _parsed(f"({text}) / ({other})")


def _names_of(scope: Scope) -> tuple[str, ...]:
    me = scope.get("self")
    return ("type_n",) if hasattr(me, "type_n") else ()


def _structural(node: ast.expr) -> Iterator[ast.expr]:
    match node:
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            yield from (left, right)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            yield left
            yield ast.BinOp(left, ast.Mult(), right)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            yield from (left, right, ast.BinOp(left, ast.Sub(), right))
        case ast.BinOp(left=left, op=ast.Sub(), right=right):
            yield from (left, ast.UnaryOp(ast.USub(), right), ast.BinOp(left, ast.Add(), right))
        case ast.BinOp(left=left, op=ast.BitAnd(), right=right):
            yield from (left, right, ast.BinOp(left, ast.BitOr(), right))
        case ast.BinOp(left=left, op=ast.BitOr(), right=right):
            yield from (left, right, ast.BinOp(left, ast.BitAnd(), right))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            yield left
        case ast.UnaryOp(operand=operand):
            yield operand
        case ast.Compare(left=left, ops=[op], comparators=[right]):
            for other in _COMPARISONS.get(type(op), ()):
                yield ast.Compare(left, [other()], [right])
        case ast.IfExp(test=test, body=body, orelse=orelse):
            yield from (body, orelse, ast.IfExp(test, orelse, body))
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int() | float() as number):
            yield from map(ast.Constant, (0, 1, number + 1, number - 1, 2 * number, number / 2))
        case ast.Call():
            yield from _calls(node)
    if isinstance(node, ast.BinOp | ast.Call | ast.Subscript | ast.IfExp):
        for to in ("i", "j", ""):
            yield _mirrored(node, to)


def _calls(node: ast.Call) -> Iterator[ast.expr]:
    arguments = node.args
    name = ast.unparse(node.func).rpartition(".")[2]
    if name == "where" and len(arguments) == 3:
        test, yes, no = arguments
        yield from (yes, no, ast.Call(node.func, [test, no, yes], []))
    elif len(arguments) == 1 and not node.keywords:
        yield arguments[0]
    for a in range(len(arguments)):
        for b in range(a + 1, len(arguments)):
            other = list(arguments)
            other[a], other[b] = other[b], other[a]
            yield ast.Call(node.func, other, node.keywords)
    if name in _TWINS:
        yield _renamed(node, {name: _TWINS[name]})
        yield from arguments
    if name == "total":
        for pairs in _PAIRS:
            term = ast.unparse(arguments[0])
            for factor in (0.0, 2.0, 0.5):
                yield _parsed(f"{ast.unparse(node.func)}(({term}) * where({pairs}, {factor}, 1.0))")


class _Renaming(ast.NodeTransformer):
    def __init__(self, other: Callable[[str], str]) -> None:
        self.other = other

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Name(self.other(node.id), node.ctx)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        return ast.Attribute(self.visit(node.value), self.other(node.attr), node.ctx)


def _renamed(node: ast.expr, names: Mapping[str, str]) -> ast.expr:
    return _Renaming(lambda name: names.get(name, name)).visit(copy.deepcopy(node))  # type: ignore[no-any-return]


def _mirrored(node: ast.expr, to: str) -> ast.expr:
    """Return an expression of a pair with its particles exchanged, or with one of them for both."""

    def other(name: str) -> str:
        stem, _, end = name.rpartition("_")
        if end in _OTHER_SIDE and (stem or name == end) and end != to:
            return f"{stem}_{_OTHER_SIDE[end]}" if stem else _OTHER_SIDE[end]
        return name

    return _Renaming(other).visit(copy.deepcopy(node))  # type: ignore[no-any-return]


def operands(tree: ast.AST) -> set[str]:
    """Return the variables, attributes and elements of them that a tree reads."""
    return {ast.unparse(node) for node in ast.walk(tree) if _is_operand(node)}


def _parsed(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _is_operand(node: ast.AST) -> bool:
    match node:
        case ast.Name(ctx=ast.Load()):
            return True
        case ast.Attribute(value=value, ctx=ast.Load()):
            return _is_operand(value)
        case ast.Subscript(value=value, slice=index, ctx=ast.Load()):
            return _is_operand(value) and (_is_operand(index) or isinstance(index, ast.Constant))
    return False


# --- the tree


def _numbered(nodes: Iterable[ast.AST]) -> dict[int, int]:
    """Return the place of every node among those that look the same, from 1, by its id."""
    counts: Counter[str] = Counter()
    numbers = {}
    for node in nodes:
        counts[text := ast.dump(node)] += 1
        numbers[id(node)] = counts[text]
    return numbers


def _is_left_out(statement: ast.stmt) -> bool:
    """Return whether a function makes sense without a statement: a call, or another assignment to a variable."""
    match statement:
        case ast.Expr(value=ast.Call()) | ast.AugAssign():
            return True
        case ast.Assign():
            return _updates(statement)
    return False


def _updates(statement: ast.Assign) -> bool:
    target = ast.unparse(statement.targets[0])
    return any(isinstance(n, ast.Name | ast.Attribute) and ast.unparse(n) == target for n in ast.walk(statement.value))


def _inside(node: ast.AST, scope: dict[str, Any], around: str) -> Iterator[_Place]:
    """Yield the expressions of a statement, of comprehensions with the first values of their variables."""
    if isinstance(node, ast.stmt):
        around = ast.unparse(node).partition("\n")[0]
    if isinstance(node, ast.ListComp | ast.GeneratorExp | ast.SetComp | ast.DictComp):
        scope = _first(node, scope)
    for name, child in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "ctx", "targets", "target"):
            continue
        if isinstance(node, ast.Call) and name in ("func", "keywords"):
            continue
        for each in child if isinstance(child, list) else [child]:
            if not isinstance(each, ast.AST):
                continue
            if isinstance(each, ast.expr) and not isinstance(each, _CONTAINERS):
                yield _Place(each, scope, node, around)
            yield from _inside(each, scope, around)


def _first(node: Any, scope: dict[str, Any]) -> dict[str, Any]:
    inner = dict(scope)
    for generator in node.generators:
        try:
            text = f"{ast.unparse(generator.target)} = next(iter({ast.unparse(generator.iter)}))"
            exec(text, inner)
        except Exception:
            return inner
    return inner
