"""Mistakes made by machine in the reference's source: one operator, number, call or statement at a time.

A deterministic sample of all of them is planted. What cannot show is left out where that can be known: texts, types,
messages of errors, functions that serve other number types (rounding bounds, extended precision) or other callers, and
numbers that stand where the other arm of a `where` counts, or where there is no value.
"""

from __future__ import annotations

import ast
import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import islice

from eos_ref.errors import InputError
from lammps_cases.findings import LEDGER, NEWEST
from tests.workshop.faults.edits import definition, text_of
from tests.workshop.faults.fault import Fault

# Modules that a scene's numbers go through, and how many faults are planted in each.
MODULES = {
    "eos.laws": 8,
    "eos.table": 5,
    "numbers.elementary": 5,
    "kernels.quintic": 10,
    "kernels.reproducing": 2,
    "model.interactions": 16,
    "model.per_atom": 9,
    "evaluation.array_evaluator": 30,
    "evaluation.evaluator": 24,
    "evaluation.time_step": 22,
    "numbers.matrices": 5,
    "numbers.columns": 1,
    "evaluation.pairs": 5,
    "syntax.ranges": 3,
    "model.quantities": 2,
    "model.parameters": 3,
    "eos.rounded_eos": 1,
    "syntax.fixes": 2,
}
# A module's part of the ids of its faults, where that is not its name: ids draw the sample and are in stored results.
IN_IDS = {
    "kernels.quintic": "kernels",
    "kernels.reproducing": "kernels",
    "eos.table": "eos",
    "evaluation.array_evaluator": "plain",
    "evaluation.evaluator": "stages",
    "evaluation.time_step": "steps",
    "model.parameters": "model",
}
# Likewise for classes and functions.
NAMES_IN_IDS = {
    "ArrayEvaluator": "Plain",
    "Evaluator": "Stages",
    "Evaluator.__post_init__": "Stages.__init__",
    "Simulation.properties": "Simulation._properties",
    "Simulation.status": "Simulation._status",
}


def _replaced() -> Iterator[str]:
    """Yield the functions that a finding of the newest engine replaces, in the class of the reference that has them."""
    for entry in LEDGER:
        variant = entry.model_variant
        if variant and variant.stages and entry.listed(NEWEST):
            for function in entry.replaces:
                of = next(base for base in variant.stages.__mro__[1:] if function in vars(base))
                yield f"{of.__module__.removeprefix('eos_ref.')}:{of.__qualname__}.{function}"


# Functions left out, by what they serve in place of a prediction of values.
EXCLUDED: dict[str, tuple[str, ...]] = {
    "other number types": (
        "numbers.elementary:_has",
        "numbers.elementary:_is_ball",
        "numbers.elementary:_unary",
        "evaluation.array_evaluator:ArrayEvaluator.constant",
        "evaluation.array_evaluator:ArrayEvaluator.total",  # of rounded and extended numbers: to the same values
        "evaluation.evaluator:is_class",
        "evaluation.evaluator:Evaluator.constant",
        "evaluation.time_step:Simulation.rounded",
        "evaluation.time_step:Simulation.precise",
        "evaluation.time_step:Simulation._evaluated_in",
        "evaluation.time_step:Simulation.with_evaluator",
    ),
    "derivatives": (
        "eos.laws:linear_stiffness",
        "eos.laws:cubic_stiffness",
        "eos.laws:tait_stiffness",
        "eos.laws:ideal_gas_stiffness",
    ),
    "when neighbours are searched anew": (  # a search too many or, before particles have moved so far, too few
        "evaluation.pairs:Candidates.__init__",
        "evaluation.pairs:Candidates.hold",
        "evaluation.pairs:candidates",
        "evaluation.pairs:sharing",
    ),
    "order of summation": ("evaluation.pairs:_order", "evaluation.pairs:keys"),
    "changed as a whole by a named fault": ("evaluation.evaluator:Evaluator.sound_speed",),
    "other callers": (
        "eos.laws:cubic_density",  # only walls need it, and LAMMPS refuses walls with a cubic law
        "kernels.reproducing:basis_size",
        "evaluation.array_evaluator:ArrayEvaluator.any_neighbour",  # of an audit
        "evaluation.pairs:Search.half",  # of the compiled sums
        "evaluation.pairs:_points_up",
        "evaluation.time_step:Simulation.run",
        "evaluation.time_step:Simulation._check_steps",
    ),
    "replaced by findings of the newest engine": tuple(_replaced()),
}
# Of these modules only some functions.
ONLY = {
    "eos.table": ("EOS.evaluate", "EOS.density"),
    "syntax.fixes": ("resolve",),
    "eos.rounded_eos": ("by_type",),
    "syntax.ranges": ("type_range",),
    "numbers.columns": ("dot",),
    "model.parameters": (
        *("Force.acts_on", "Model.h", "Model.corrects_gradients", "Model.mass", "Model.rho0", "Model.cs"),
        "Model.shifted_t",
    ),
}
# Assignments left out, by function and what is assigned: how a value is computed (where the points of the neighbour
# search lie, which of two forms of a logarithm is taken), or what its rounding bound will be.
EXCLUDED_ASSIGNMENTS = {
    "numbers.elementary:powm1": ("normal",),
    "evaluation.array_evaluator:ArrayEvaluator._apart": ("image_p", "apart.error"),
    "evaluation.pairs:Search.__init__": ("places", "self.wide"),
    "evaluation.pairs:_copies": ("room_c", "most"),
    "evaluation.time_step:Simulation._start": ("self.fresh",),
    "evaluation.time_step:Simulation.step": ("self.fresh",),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.Mod: ast.Mult,
}
COMPARISON: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
CALLED = {"maximum": "minimum", "minimum": "maximum", "max": "min", "min": "max", "sin": "sinh", "asin": "asinh"}


# Products and means of what the arguments are, or functions whose arguments are of different types.
SYMMETRIC = {
    *("arithmetic_mean", "harmonic_mean", "pressure_term", "viscous_term", "heat_term", "diffusion_term", "dot"),
    *("is_class", "heated_volume", "isinstance", "range", "zip", "asarray", "astype", "full"),
}


@dataclass(frozen=True)
class SourceFault(Fault):
    """A fault in a module of the reference: its text with the fault in it."""

    module: str
    text: str


@cache
def faults() -> dict[str, SourceFault]:
    """Return the faults planted, by id: of every module those whose ids have the lowest hashes."""
    planted: dict[str, SourceFault] = {}
    for module in MODULES:
        places = _chosen(module)
        planted |= {name: source_fault(module, name, places[name]) for name in sorted(places)}
    return planted


def _chosen(module: str) -> dict[str, int]:
    """Return the changes drawn in a module: id, and place in the order of the source."""
    tree = ast.parse(text_of(module))
    for function in (*excluded(module), *ONLY.get(module, ())):  # refuse names that the module no longer has
        definition(tree, function, f"exclusions of eos_ref.{module}")
    places = names(module, tree)
    drawn_ids = sorted(places, key=lambda name: hashlib.sha256(name.encode()).digest())[: MODULES[module]]
    return {name: places[name] for name in drawn_ids}


def drawn(module: str) -> list[str]:
    """Return the functions of the changes drawn in a module, one for each change."""
    every = [where for where, *_ in _changes(module, ast.parse(text_of(module)))]
    return [every[place] for place in _chosen(module).values()]


def mutable(module: str) -> set[str]:
    """Return the functions of a module in which anything can be changed."""
    return {where for where, *_ in _changes(module, ast.parse(text_of(module)))}


def excluded(module: str) -> dict[str, str]:
    """Return the qualified names of functions left out of a module, with the reason."""
    return {
        name: reason
        for reason, functions in EXCLUDED.items()
        for of, _, name in (function.partition(":") for function in functions)
        if of == module
    }


def excluded_assignments(module: str, tree: ast.Module) -> list[ast.Assign]:
    """Return the assignments left out of a module.

    Raises
    ------
    InputError
        A function that the module does not define, or that makes no such assignment.
    """
    assignments: list[ast.Assign] = []
    for function, targets in EXCLUDED_ASSIGNMENTS.items():
        of, _, name = function.partition(":")
        for target in targets if of == module else ():
            matching = [node for node in ast.walk(definition(tree, name)) if _assigns(node, target)]
            if not matching:
                raise InputError("excluded assignment", "must be in the function", target, function)
            assignments += matching  # type: ignore[arg-type]
    return assignments


def _assigns(node: ast.AST, target: str) -> bool:
    return isinstance(node, ast.Assign) and ast.unparse(node.targets[0]).strip("()") == target


def names(module: str, tree: ast.Module) -> dict[str, int]:
    """Return everything that can be changed in a module: id, and place in the order of the source."""
    by_id: dict[str, int] = {}
    count: Counter[str] = Counter()
    for place, (where, how, _, _) in enumerate(_changes(module, tree)):
        name = f"source.{_in_ids(module, where)}.{how}"
        count[name] += 1
        by_id[f"{name}-{count[name]}"] = place
    return by_id


def source_fault(module: str, name: str, place: int) -> SourceFault:
    """Return the fault of an id and a place that `names` gives."""
    tree = ast.parse(text_of(module))
    where, how, statement, change = next(islice(_changes(module, tree), place, None))
    before = _line(statement)
    change()
    after = "(left out)" if how == "dropped" else _line(statement)
    what = f"{_in_ids(module, where)}: {before} → {after}"
    return SourceFault(name, "source", what, module, ast.unparse(ast.fix_missing_locations(tree)))


def _in_ids(module: str, function: str) -> str:
    """Return the module and the qualified name of a function as they stand in ids."""
    of, dot, name = function.rpartition(".")
    function = NAMES_IN_IDS.get(function, f"{NAMES_IN_IDS.get(of, of)}{dot}{name}")
    return f"{IN_IDS.get(module, module.rpartition('.')[2])}.{function}"


def _line(statement: ast.stmt) -> str:
    """Return the first line of a statement."""
    return ast.unparse(statement).splitlines()[0]


Change = tuple[str, str, ast.stmt, Callable[[], None]]  # function, operator, statement, what changes it


def _changes(module: str, tree: ast.Module) -> Iterator[Change]:
    """Yield everything that can be changed, in the order of the source; the last entry makes the change in the tree."""
    left_out = excluded_assignments(module, tree)
    for name, function in _functions(module, tree):
        # What is missing there ends every run at once.
        droppable = function.name not in ("__init__", "__post_init__", "move")
        for body, at in _statements(function.body):
            statement = body[at]
            if statement in left_out or (isinstance(statement, ast.If) and _of_type(statement.test)):
                continue
            yield from ((name, how, statement, change) for how, change in _of_statement(body, at, droppable))


def _of_type(test: ast.expr) -> bool:
    """Return whether a test asks for another number type, which only bounds and extended precision use."""
    called = {getattr(part.func, "id", "") for part in ast.walk(test) if isinstance(part, ast.Call)}
    return bool(called & {"isinstance", "hasattr", "getattr", "_is_ball"})


def _functions(module: str, tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield the functions and methods that faults are planted in, with their qualified names."""
    left_out, only = excluded(module), ONLY.get(module)
    for node in tree.body:
        inner = [(f"{node.name}.", part) for part in node.body] if isinstance(node, ast.ClassDef) else [("", node)]
        for parent, function in inner:
            if isinstance(function, ast.FunctionDef):
                name = parent + function.name
                if not is_abstract(function) and name not in left_out and (only is None or name in only):
                    yield name, function


def is_abstract(function: ast.FunctionDef) -> bool:
    """Return whether a method is abstract: it has no body to change."""
    return any(getattr(decorator, "id", "") == "abstractmethod" for decorator in function.decorator_list)


def _statements(body: list[ast.stmt]) -> Iterator[tuple[list[ast.stmt], int]]:
    """Yield the statements with the list that holds them, of all depths, but for texts and checks of input."""
    for at, statement in enumerate(body):
        text = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
        refuses = isinstance(getattr(statement, "body", [statement])[-1], ast.Raise)
        if text or refuses or isinstance(statement, ast.Assert | ast.Import | ast.ImportFrom | ast.FunctionDef):
            continue
        yield body, at
        if not (isinstance(statement, ast.If) and _of_type(statement.test)):
            yield from _statements(getattr(statement, "body", []))
        yield from _statements(getattr(statement, "orelse", []))
        for case in getattr(statement, "cases", []):
            yield from _statements(case.body)


def _of_statement(body: list[ast.stmt], at: int, droppable: bool) -> Iterator[tuple[str, Callable[[], None]]]:
    statement = body[at]
    if droppable and _droppable(statement):
        yield "dropped", lambda: body.__setitem__(at, ast.copy_location(ast.Pass(), statement))
    if isinstance(statement, ast.If):
        yield "not", lambda: setattr(statement, "test", ast.UnaryOp(ast.Not(), statement.test))
    squared = [
        node.left for node in ast.walk(statement) if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow)
    ]
    for node in _expressions(statement):
        yield from (change for change in _of_expression(node) if change[0] != "reversed" or node not in squared)


def _droppable(statement: ast.stmt) -> bool:
    """Return whether what follows can do without: an attribute, item or sum changed, a call for its effect."""
    if isinstance(statement, ast.Assign):
        return all(isinstance(target, ast.Attribute | ast.Subscript) for target in statement.targets)
    return isinstance(statement, ast.AugAssign) or (
        isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
    )


def _expressions(statement: ast.stmt) -> Iterator[ast.AST]:
    """Yield the parts of a statement itself, without the statements in it, types, texts and tests of types."""
    ahead: list[ast.AST] = [statement]
    while ahead:
        node = ahead.pop(0)
        yield node
        for name, child in ast.iter_fields(node):
            for part in child if isinstance(child, list) else [child]:
                if name in ("annotation", "keywords") or not isinstance(part, ast.AST):
                    continue
                arm = isinstance(part, ast.Constant) and isinstance(node, ast.Call) and _called(node) == "where"
                arm |= isinstance(part, ast.Constant) and isinstance(part.value, float) and _stands_in(node)
                tested = arm or (isinstance(part, ast.IfExp) and _of_type(part.test))
                if not tested and not isinstance(part, ast.stmt | ast.match_case | ast.JoinedStr):
                    ahead.append(part)


def _stands_in(node: ast.AST) -> bool:
    """Return whether a number in this place is one for what has none: ``x or 0.0``, ``0.0 if x is None else x``."""
    return isinstance(node, ast.BoolOp) or (
        isinstance(node, ast.IfExp) and isinstance(node.test, ast.Compare) and isinstance(node.test.ops[0], ast.Is)
    )


def _of_expression(node: ast.AST) -> Iterator[tuple[str, Callable[[], None]]]:
    if isinstance(node, ast.BinOp) and type(node.op) in ARITHMETIC:
        operator = ARITHMETIC[type(node.op)]
        yield "operator", lambda: setattr(node, "op", operator())
        if isinstance(node.op, ast.Sub | ast.Div | ast.Pow):
            yield "reversed", lambda: _exchange(node, "left", "right")
    if isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISON:
        comparison = COMPARISON[type(node.ops[0])]
        yield "comparison", lambda: node.ops.__setitem__(0, comparison())
    if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float):
        yield "number", lambda: setattr(node, "value", _other(node.value))  # type: ignore[arg-type]
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Invert):
        yield "sign", _without_sign(node)
    if isinstance(node, ast.BoolOp):
        other = ast.Or if isinstance(node.op, ast.And) else ast.And
        yield "logic", lambda: setattr(node, "op", other())
    if isinstance(node, ast.IfExp):
        yield "branches", lambda: _exchange(node, "body", "orelse")
    if isinstance(node, ast.Call):
        yield from _of_call(node)


def _called(node: ast.Call) -> str:
    """Return the name of the function that is called."""
    return str(getattr(node.func, "id", "") or getattr(node.func, "attr", ""))


def _of_call(node: ast.Call) -> Iterator[tuple[str, Callable[[], None]]]:
    function = node.func
    name = "id" if isinstance(function, ast.Name) else "attr"
    if getattr(function, name, "") in CALLED:
        yield "called", lambda: setattr(function, name, CALLED[getattr(function, name)])
    if (
        len(node.args) >= 2
        and getattr(function, name, "") not in {*CALLED, *SYMMETRIC}
        and not any(isinstance(argument, ast.Starred) for argument in node.args)
    ):
        yield "arguments", lambda: node.args.__setitem__(slice(-2, None), [node.args[-1], node.args[-2]])


def _other(value: float) -> float:
    """Return another number: the next whole one; twice a fraction."""
    if isinstance(value, bool):
        return not value
    return value + 1 if isinstance(value, int) or value == 0 else 2 * value


def _exchange(node: ast.AST, one: str, other: str) -> None:
    first, second = getattr(node, one), getattr(node, other)
    setattr(node, one, second)
    setattr(node, other, first)


def _without_sign(node: ast.UnaryOp) -> Callable[[], None]:
    """Return what takes ``-`` away, or ``~`` by one more of them."""
    if isinstance(node.op, ast.USub):
        return lambda: setattr(node, "op", ast.UAdd())
    return lambda: setattr(node, "operand", ast.UnaryOp(ast.Invert(), node.operand))
