"""Loops translated to C: what `compiled` marks in the files of `native.units`, so that wheels need no compiler.

The marked functions keep to a small part of Python: numbers, contiguous arrays and named tuples of them; `range` loops;
views by leading indices. Types flow from the annotations of the functions that Python calls, which say the rank of
every array (`Floats2`), into the functions that these call; nothing is guessed. What is outside that part is an error
with its line. Standard library only, since it runs where a wheel is built.

An array is a pointer and its lengths: arrays that Python hands in are contiguous (`wrappers` sees to it), and so are
their views. Memory is taken from an arena that ends with the outermost call; what is returned leaves it.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass, field
from pathlib import Path

DECORATORS = ("compiled", "inlined")
CELLS = {"f": "double", "i": "I", "b": "B"}
ANNOTATED = {"float": "f", "int": "i", "bool": "b", "None": "v"}
DTYPES = {"int64": "i", "float64": "f", "bool_": "b"}
MATHS = {"sqrt", "exp", "sin", "cos", "log", "atan2", "floor", "fabs", "tan", "log1p"}
OPERATORS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
COMPARED = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
Type = str
"""f, i, b: a number; f2: an array of rank 2; (f,i): a tuple; v: nothing; else the name of a named tuple."""


class UntranslatableError(Exception):
    """What is outside the part of Python that is translated, with its place."""


@dataclass
class Unit:
    """One source file: its compiled functions, named tuples, constants, and what it imports of other units."""

    path: Path
    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    tuples: dict[str, list[tuple[str, Type]]] = field(default_factory=dict)
    constants: dict[str, ast.expr] = field(default_factory=dict)
    imports: dict[str, tuple[str, str]] = field(default_factory=dict)


def read_unit(path: Path) -> Unit:
    """What of a source file takes part."""
    unit = Unit(path)
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef):
            if any(isinstance(d, ast.Name) and d.id in DECORATORS for d in node.decorator_list):
                unit.functions[node.name] = node
        elif isinstance(node, ast.ClassDef) and any(getattr(b, "id", "") == "NamedTuple" for b in node.bases):
            fields = [n for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)]
            unit.tuples[node.name] = [(n.target.id, annotated(n.annotation)) for n in fields]  # type: ignore[union-attr]
        elif isinstance(node, ast.ImportFrom) and node.module:
            for name in node.names:
                unit.imports[name.asname or name.name] = (node.module, name.name)
        elif isinstance(node, ast.Assign) and len(node.targets) == 1:
            _constants(unit, node.targets[0], node.value)
    return unit


def _constants(unit: Unit, target: ast.expr, value: ast.expr) -> None:
    if isinstance(target, ast.Name) and isinstance(value, ast.Constant):
        unit.constants[target.id] = value
    elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for one, its in zip(target.elts, value.elts, strict=True):
            _constants(unit, one, its)


def annotated(node: ast.expr | None) -> Type:
    """The type that an annotation says; "?" where it leaves the rank open."""
    if node is None:
        return "?"
    text = ast.unparse(node)
    if text in ANNOTATED:
        return ANNOTATED[text]
    found = re.fullmatch(r"(Floats|Ints|Bools)(\d?)", text)
    if found is None:
        return text
    return found.group(1)[0].lower() + found.group(2) if found.group(2) else "?"


def is_array(kind: Type) -> bool:
    """Whether values of the type are arrays."""
    return re.fullmatch(r"[fib]\d", kind) is not None


def rank(kind: Type) -> int:
    """How many indices an array of the type takes."""
    return int(kind[1])


def c_type(kind: Type) -> str:
    """The name of a type in C."""
    if kind in CELLS:
        return CELLS[kind]
    if kind == "v":
        return "void"
    if kind.startswith("("):
        return "T_" + kind.strip("()").replace(",", "_")
    return kind


def parts(kind: Type) -> list[Type]:
    """The types inside a tuple."""
    return kind.strip("()").split(",")


class Program:
    """All functions that the exported ones reach, each for the types that it is called with."""

    def __init__(self, units: dict[str, Unit]) -> None:
        """`units` by the name of their modules."""
        self.units = units
        self.tuples: dict[str, list[tuple[str, Type]]] = {}
        self.returned: dict[str, None] = {}
        self.done: dict[tuple[str, str, tuple[Type, ...]], tuple[str, Type]] = {}
        self.bodies: list[str] = []
        for unit in units.values():
            self.tuples.update(unit.tuples)

    def exported(self) -> list[tuple[str, str, list[Type], str, Type]]:
        """Module, name, types of arguments, C name and type of result of every function that Python calls."""
        out = []
        for module, unit in self.units.items():
            for name, node in unit.functions.items():
                kinds = [annotated(a.annotation) for a in node.args.args]
                if all(self._is_whole(k) for k in kinds):
                    c_name, kind = self.function(module, name, tuple(kinds))
                    out.append((module, name, kinds, c_name, kind))
        return out

    def _is_whole(self, kind: Type) -> bool:
        if kind in self.tuples:
            return all(self._is_whole(k) for _, k in self.tuples[kind])
        return kind in CELLS or is_array(kind)

    def found(self, module: str, name: str) -> tuple[str, str]:
        """Where the function that `module` calls `name` is defined, and its name there."""
        while name not in self.units[module].functions:
            if name not in self.units[module].imports:
                raise UntranslatableError(f"{module}: {name} is not a compiled function")
            module, name = self.units[module].imports[name]
            if module not in self.units:
                raise UntranslatableError(f"{module}.{name} is not among the translated files")
        return module, name

    def constant(self, module: str, name: str) -> ast.expr | None:
        """A number that a module names, its own or imported."""
        while module in self.units:
            if name in self.units[module].constants:
                return self.units[module].constants[name]
            module, name = self.units[module].imports.get(name, ("", ""))
        return None

    def function(self, module: str, name: str, kinds: tuple[Type, ...]) -> tuple[str, Type]:
        """C name and type of result of a function for these types of arguments."""
        module, name = self.found(module, name)
        key = module, name, kinds
        if key not in self.done:
            c_name = f"{name.lstrip('_')}_{len(self.done)}"
            self.done[key] = c_name, "?"  # no recursion
            kind, text = Function(self, module, self.units[module].functions[name], kinds).translated(c_name)
            self.done[key] = c_name, kind
            self.bodies.append(text)
        if self.done[key][1] == "?":
            raise UntranslatableError(f"{module}.{name} calls itself")
        return self.done[key]


class Function:
    """One function for one choice of types."""

    def __init__(self, program: Program, module: str, node: ast.FunctionDef, kinds: tuple[Type, ...]) -> None:
        """`kinds` of the arguments."""
        self.program, self.module, self.node = program, module, node
        names = [a.arg for a in node.args.args]
        if len(names) != len(kinds):
            raise self.wrong(node, f"{len(kinds)} arguments given")
        self.arguments = dict(zip(names, kinds, strict=True))
        self.kinds: dict[str, Type] = dict(self.arguments)
        self.result: Type = "v"
        self.temporaries = 0

    def wrong(self, node: ast.AST, what: str) -> UntranslatableError:
        """An error with its place."""
        line = getattr(node, "lineno", 0)
        return UntranslatableError(f"{self.program.units[self.module].path}:{line} in {self.node.name}: {what}")

    def translated(self, c_name: str) -> tuple[Type, str]:
        """Type of the result, and the C text."""
        body = [s for s in self.node.body if not (isinstance(s, ast.Expr) and isinstance(s.value, ast.Constant))]
        known: dict[str, Type] = {}
        lines: list[str] = []
        while True:
            self.temporaries = 0
            lines = self.block(body, 1)
            if known == self.kinds:
                break
            known = dict(self.kinds)
        given = ", ".join(["Arena *arena", *(f"{c_type(k)} {n}" for n, k in self.arguments.items())])
        own = [f"    {c_type(k)} {n} = {'{0}' if len(k) > 1 else '0'};" for n, k in self.kinds.items()
               if n not in self.arguments]  # fmt: skip
        if self.result.startswith("("):
            self.program.returned[self.result] = None
        return self.result, "\n".join([f"static {c_type(self.result)} {c_name}({given}) {{", *own, *lines, "}"])

    # --- statements

    def block(self, body: list[ast.stmt], depth: int) -> list[str]:
        """Statements, indented."""
        out = []
        for statement in body:
            out += [("    " * depth + line) for line in self.statement(statement)]
        return out

    def statement(self, s: ast.stmt) -> list[str]:
        """One statement as lines."""
        if isinstance(s, ast.Assign):
            return self.assigned(s.targets, s.value)
        if isinstance(s, ast.AnnAssign) and s.value is not None:
            return self.assigned([s.target], s.value)
        if isinstance(s, ast.AugAssign):
            return self.augmented(s)
        if isinstance(s, ast.For):
            return self.loop(s)
        if isinstance(s, ast.If):
            lines = [f"if ({self.value(s.test)[0]}) {{", *self.block(s.body, 1), "}"]
            return lines if not s.orelse else [*lines, "else {", *self.block(s.orelse, 1), "}"]
        if isinstance(s, ast.While):
            return [f"while ({self.value(s.test)[0]}) {{", *self.block(s.body, 1), "}"]
        if isinstance(s, ast.Continue):
            return ["continue;"]
        if isinstance(s, ast.Break):
            return ["break;"]
        if isinstance(s, ast.Pass):
            return []
        if isinstance(s, ast.Expr):
            return [self.value(s.value)[0] + ";"]
        if isinstance(s, ast.Return):
            return self.returning(s)
        raise self.wrong(s, f"{type(s).__name__} is not translated")

    def returning(self, s: ast.Return) -> list[str]:
        """`return`; numbers are those that the annotation says."""
        if s.value is None:
            return ["return;"]
        if not isinstance(s.value, ast.Tuple):
            text, self.result = self.value(s.value)
            told = annotated(self.node.returns)
            if told in CELLS:
                self.result = told
            return [f"return {text};"]
        found = [self.value(v) for v in s.value.elts]
        told = self.node.returns
        wanted = [annotated(e) for e in told.slice.elts] if isinstance(told, ast.Subscript) and isinstance(
            told.slice, ast.Tuple) else ["?"] * len(found)  # fmt: skip
        kinds = [w if w in CELLS else k for (_, k), w in zip(found, wanted, strict=True)]
        self.result = "(" + ",".join(kinds) + ")"
        self.program.returned[self.result] = None
        return [f"return ({c_type(self.result)}){{{', '.join(t for t, _ in found)}}};"]

    def assigned(self, targets: list[ast.expr], value: ast.expr) -> list[str]:
        """An assignment to one or several targets."""
        if len(targets) > 1:
            out = []
            for target in targets:
                out += self.assigned([target], value)
            return out
        target = targets[0]
        if not isinstance(target, ast.Tuple):
            return self.stored(target, *self.value(value))
        if isinstance(value, ast.Tuple):
            pairs = [self.value(v) for v in value.elts]
            lines, names = [], []
            for text, kind in pairs:
                self.temporaries += 1
                names.append(f"t_{self.temporaries}")
                lines.append(f"{c_type(kind)} {names[-1]} = {text};")
            for one, name, (_, kind) in zip(target.elts, names, pairs, strict=True):
                lines += self.stored(one, name, kind)
            return ["{", *("    " + line for line in lines), "}"]
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            text, kind = self.value(value.value)
            return [line for k, one in enumerate(target.elts) for line in self.stored(one, f"{text}.n[{k}]", "i")]
        text, kind = self.value(value)
        self.temporaries += 1
        name = f"t_{self.temporaries}"
        inside = self.program.tuples.get(kind) or [(f"m{k}", p) for k, p in enumerate(parts(kind))]
        lines = [f"{c_type(kind)} {name} = {text};"]
        for one, (member, its) in zip(target.elts, inside, strict=True):
            lines += self.stored(one, f"{name}.{member}", its)
        return ["{", *("    " + line for line in lines), "}"]

    def stored(self, target: ast.expr, text: str, kind: Type) -> list[str]:
        """`target` = a value; a number into an array fills it, an array into an array is copied."""
        if isinstance(target, ast.Name):
            if target.id == "_":
                return []
            self.know(target, target.id, kind)
            return [f"{target.id} = {text};"]
        place, its = self.value(target)
        if is_array(its):
            return [f"{its}_copied({place}, {text});" if is_array(kind) else f"{its}_filled({place}, {text});"]
        return [f"{place} = {text};"]

    def know(self, node: ast.AST, name: str, kind: Type) -> None:
        """The variable has this type; a whole number and a real one together are real."""
        old = self.kinds.get(name)
        if old is None or old == kind:
            self.kinds[name] = kind
        elif {old, kind} == {"i", "f"} and name not in self.arguments:
            self.kinds[name] = "f"
        else:
            raise self.wrong(node, f"{name} is {old} and {kind}")

    def augmented(self, s: ast.AugAssign) -> list[str]:
        """`x += value`."""
        text, kind = self.value(s.value)
        if isinstance(s.target, ast.Name):
            self.know(s, s.target.id, "f" if isinstance(s.op, ast.Div) or kind == "f" else self.kinds[s.target.id])
        place, its = self.value(s.target)
        operator = OPERATORS.get(type(s.op)) or ("/" if isinstance(s.op, ast.Div) and its == "f" else None)
        if operator is None or is_array(its):
            raise self.wrong(s, "an assignment of this kind is not translated")
        return [f"{place} {operator}= {text};"]

    def loop(self, s: ast.For) -> list[str]:
        """`for i in range(...)`."""
        if not (isinstance(s.target, ast.Name) and isinstance(s.iter, ast.Call) and isinstance(s.iter.func, ast.Name)
                and s.iter.func.id == "range" and not s.orelse):  # fmt: skip
            raise self.wrong(s, "only loops over ranges are translated")
        bounds = [self.value(a)[0] for a in s.iter.args]
        first, last = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        step = bounds[2] if len(bounds) == 3 else "1"
        down = step.startswith(("(-", "-"))
        i = s.target.id
        self.know(s, i, "i")
        if self.kinds[i] != "i":
            raise self.wrong(s, f"{i} counts a loop and is a real number elsewhere")
        self.temporaries += 1
        end = f"t_{self.temporaries}"
        plain = ["#pragma GCC ivdep"] if is_parallel(s) else []
        head = f"for ({i} = {first}; {i} {'>' if down else '<'} {end}; {i} += {step}) {{"
        return ["{", f"    const I {end} = {last};", *plain, "    " + head, *self.block(s.body, 2), "    }", "}"]

    # --- expressions

    def value(self, e: ast.expr) -> tuple[str, Type]:
        """An expression and its type."""
        if isinstance(e, ast.Constant):
            return self.number(e)
        if isinstance(e, ast.Name):
            return self.name(e)
        if isinstance(e, ast.Attribute):
            return self.attribute(e)
        if isinstance(e, ast.Subscript):
            return self.subscript(e)
        if isinstance(e, ast.BinOp):
            return self.binary(e)
        if isinstance(e, ast.UnaryOp):
            text, kind = self.value(e.operand)
            return (f"(!{text})", "b") if isinstance(e.op, ast.Not) else (f"(-{text})", kind)
        if isinstance(e, ast.Compare):
            return self.compared(e)
        if isinstance(e, ast.BoolOp):
            sign = " && " if isinstance(e.op, ast.And) else " || "
            return "(" + sign.join(self.value(v)[0] for v in e.values) + ")", "b"
        if isinstance(e, ast.IfExp):
            (yes, kind), (no, other) = self.value(e.body), self.value(e.orelse)
            return f"({self.value(e.test)[0]} ? {yes} : {no})", self.common(e, kind, other)
        if isinstance(e, ast.Call):
            return self.call(e)
        raise self.wrong(e, f"{type(e).__name__} is not translated")

    def common(self, node: ast.AST, one: Type, other: Type) -> Type:
        """The type that two have in common."""
        if one == other:
            return one
        if {one, other} <= {"f", "i", "b"}:
            return "f" if "f" in (one, other) else "i"
        raise self.wrong(node, f"{one} and {other} together")

    def number(self, e: ast.Constant) -> tuple[str, Type]:
        """A literal."""
        if isinstance(e.value, bool):
            return str(int(e.value)), "b"
        if isinstance(e.value, int):
            return str(e.value), "i"
        if isinstance(e.value, float):
            return repr(e.value), "f"
        raise self.wrong(e, f"{e.value!r} is not translated")

    def name(self, e: ast.Name) -> tuple[str, Type]:
        """A variable, or a number that the module names."""
        if e.id in self.kinds:
            return e.id, self.kinds[e.id]
        known = self.program.constant(self.module, e.id)
        if known is None:
            raise self.wrong(e, f"{e.id} is not known here")
        return self.value(known)

    def attribute(self, e: ast.Attribute) -> tuple[str, Type]:
        """A field of a named tuple, or infinity."""
        if isinstance(e.value, ast.Name) and e.value.id in ("np", "math"):
            if e.attr in ("inf", "nan", "pi"):
                return {"inf": "INFINITY", "nan": "NAN", "pi": "M_PI"}[e.attr], "f"
            raise self.wrong(e, f"{e.attr} is not translated")
        text, kind = self.value(e.value)
        for name, its in self.program.tuples.get(kind, []):
            if name == e.attr:
                return f"{text}.{name}", its
        raise self.wrong(e, f"{kind} has no {e.attr}")

    def subscript(self, e: ast.Subscript) -> tuple[str, Type]:
        """A number, a view by leading indices, a view of part of the first axis, or a length."""
        if isinstance(e.value, ast.Attribute) and e.value.attr == "shape":
            text, kind = self.value(e.value.value)
            return f"{text}.n[{self.value(e.slice)[0]}]", "i"
        text, kind = self.value(e.value)
        if not is_array(kind):
            raise self.wrong(e, f"{kind} has no elements")
        if isinstance(e.slice, ast.Slice):
            if e.slice.step is not None:
                raise self.wrong(e, "a slice with a step is not translated")
            low = self.value(e.slice.lower)[0] if e.slice.lower is not None else "0"
            high = self.value(e.slice.upper)[0] if e.slice.upper is not None else f"{text}.n[0]"
            return (text if low == "0" and e.slice.upper is None else f"{kind}_part({text}, {low}, {high})"), kind
        indices = e.slice.elts if isinstance(e.slice, ast.Tuple) else [e.slice]
        where, r = "", rank(kind)
        for k, index in enumerate(indices):
            at, its = self.value(index)
            if its not in ("i", "b") or at.startswith("(-"):
                raise self.wrong(index, f"an index of type {its}: {at}")
            where = at if not where else f"({where}) * {text}.n[{k}] + {at}"
        if len(indices) == r:
            return f"{text}.p[{where}]", kind[0]
        if len(indices) > r:
            raise self.wrong(e, f"{len(indices)} indices of {r}")
        view = f"{kind[0]}{r - len(indices)}"
        rest = ", ".join(f"{text}.n[{k}]" for k in range(len(indices), r))
        stride = " * ".join(f"{text}.n[{k}]" for k in range(len(indices), r))
        return f"(({view}){{{text}.p + ({where}) * {stride}, {{{rest}}}}})", view

    def binary(self, e: ast.BinOp) -> tuple[str, Type]:
        """Arithmetic of numbers."""
        (a, one), (b, other) = self.value(e.left), self.value(e.right)
        kind = self.common(e, one, other)
        if is_array(kind):
            raise self.wrong(e, "arithmetic of whole arrays is not translated")
        if isinstance(e.op, ast.Div):
            return f"({a} / (double)({b}))", "f"
        if isinstance(e.op, ast.FloorDiv | ast.Mod) and kind == "i":
            return f"{'quotient' if isinstance(e.op, ast.FloorDiv) else 'rest'}({a}, {b})", "i"
        if type(e.op) not in OPERATORS:
            raise self.wrong(e, f"{type(e.op).__name__} is not translated")
        return f"({a} {OPERATORS[type(e.op)]} {b})", "i" if kind == "b" else kind

    def compared(self, e: ast.Compare) -> tuple[str, Type]:
        """a < b <= c."""
        values = [self.value(v)[0] for v in (e.left, *e.comparators)]
        each = [f"({a} {COMPARED[type(o)]} {b})" for a, o, b in zip(values, e.ops, values[1:], strict=False)]
        return each[0] if len(each) == 1 else "(" + " && ".join(each) + ")", "b"

    def call(self, e: ast.Call) -> tuple[str, Type]:
        """A function of mathematics, of arrays, or a compiled one."""
        if isinstance(e.func, ast.Attribute):
            return self.of_module(e, e.func)
        if not isinstance(e.func, ast.Name):
            raise self.wrong(e, "a call of this kind is not translated")
        given = [self.value(a) for a in e.args]
        name = e.func.id
        if name == "len":
            return f"{given[0][0]}.n[0]", "i"
        if name in ("min", "max"):
            return self.extreme(e, name, given)
        if name == "abs":
            return (f"fabs({given[0][0]})", "f") if given[0][1] == "f" else (f"llabs({given[0][0]})", "i")
        if name in ("int", "float", "bool"):
            return f"(({CELLS[ANNOTATED[name]]})({given[0][0]}))", ANNOTATED[name]
        c_name, kind = self.program.function(self.module, name, tuple(k for _, k in given))
        return f"{c_name}({', '.join(['arena', *(t for t, _ in given)])})", kind

    def extreme(self, e: ast.Call, name: str, given: list[tuple[str, Type]]) -> tuple[str, Type]:
        """`min` and `max` of numbers."""
        text, kind = given[0]
        for other, its in given[1:]:
            kind = self.common(e, kind, its)
            text = f"{name}_{kind}({text}, {other})"
        return text, kind

    def of_module(self, e: ast.Call, function: ast.Attribute) -> tuple[str, Type]:
        """math.sqrt, np.zeros, array.copy and the like."""
        base = function.value.id if isinstance(function.value, ast.Name) else ""
        if base == "math" and function.attr in MATHS:
            return f"{function.attr}({', '.join(self.value(a)[0] for a in e.args)})", "f"
        if base == "np" and function.attr in ("zeros", "empty", "full", "ones"):
            return self.allocated(e, function.attr)
        if function.attr in ("copy", "max", "min") and not e.args:
            text, kind = self.value(function.value)
            if is_array(kind):
                return (f"{kind}_copy(arena, {text})", kind) if function.attr == "copy" else (
                    f"{kind}_{function.attr}({text})", kind[0]
                )  # fmt: skip
        raise self.wrong(e, f"{ast.unparse(function)} is not translated")

    def allocated(self, e: ast.Call, how: str) -> tuple[str, Type]:
        """A new array."""
        shape = e.args[0].elts if isinstance(e.args[0], ast.Tuple) else [e.args[0]]
        lengths = ", ".join(self.value(s)[0] for s in shape)
        cell, rest = "f", e.args[1:]
        filled = ""
        if how == "full":
            filled, cell = self.value(rest[0])
            rest = rest[1:]
        if rest:
            cell = DTYPES[ast.unparse(rest[0]).removeprefix("np.")]
        kind = f"{cell}{len(shape)}"
        made = f"{kind}_new(arena, {int(how == 'zeros')}, {lengths})"
        if how == "ones":
            filled = "1"
        return (f"{kind}_filled({made}, {filled})" if filled else made), kind


def is_parallel(s: ast.For) -> bool:
    """Whether no turn of an innermost loop can touch what another one writes.

    So it is where every array is indexed by the loop's own variable alone in its last place, or only read.
    """
    i = s.target.id if isinstance(s.target, ast.Name) else ""
    written, read_still = set(), set()
    for node in [n for statement in s.body for n in ast.walk(statement)]:
        if isinstance(node, ast.For | ast.While | ast.If | ast.Return | ast.Continue | ast.Break):
            return False
        if isinstance(node, ast.Call) and not (
            (isinstance(node.func, ast.Name) and node.func.id in ("min", "max", "len", "abs"))
            or (isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) == "math")
        ):
            return False
        if isinstance(node, ast.Subscript):
            indices = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            inside = [any(isinstance(n, ast.Name) and n.id == i for n in ast.walk(index)) for index in indices]
            base = ast.unparse(node.value)
            if any(inside):
                if any(inside[:-1]) or not isinstance(indices[-1], ast.Name):
                    return False
            elif not base.endswith(".shape"):
                read_still.add(base)
            if isinstance(node.ctx, ast.Store):
                written.add(base)
                if not inside[-1]:
                    return False
    return not written & read_still
