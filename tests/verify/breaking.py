"""Breaks a file in one place: which places there are, and the file broken there (``mutants``).

A mutant drops an assignment, a call, a row of a table or a guard that returns, negates a condition, takes
another member of an enum, or takes ``<`` for ``<=``. Left out is only what cannot change anything but the
words of a message.
"""

import ast
import marshal
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
OTHER_COMPARISON: Final[dict[type[ast.cmpop], type[ast.cmpop]]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}
ENUMS: Final = (
    "Answer",
    "Block",
    "BlockEvent",
    "Completeness",
    "ForwardEvent",
    "ForwardState",
    "MotionEvent",
    "MotionState",
    "OnWire",
    "Outcome",
    "Phase",
    "Prefetched",
    "Progress",
    "ReferenceEvent",
    "ReferenceState",
    "Reported",
    "Step",
    "StopEvent",
    "Stopping",
    "WireEvent",
)
"""Names of enums whose members are taken for each other."""


@dataclass(frozen=True)
class Mutant:
    """One place of a file that is broken."""

    file: str
    number: int
    """Of the place, in the order in which they stand in the file."""
    line: int
    statement_line: int
    """Where the statement begins in which the place is."""
    unit: str
    """The method, function or table in which the place is: ``Motion.enter``, ``MOTION_AFTER``."""
    what: str
    nth: int
    """Of those in the same unit that break the same: 1, 2, ..."""
    digest: str
    """Of the unit's code and the place: as long as it stays, a verdict on the mutant holds."""

    @property
    def name(self) -> str:
        """How the mutant is called where it is judged and explained; no change elsewhere changes it."""
        return f"{Path(self.file).stem}:{self.unit}:{self.what}" + (f" ({self.nth})" if self.nth > 1 else "")

    @property
    def source(self) -> str:
        """The whole file, broken there."""
        return ast.unparse(self.tree())

    def tree(self) -> ast.Module:
        """The same as a tree, which can be compiled."""
        path = ROOT / self.file
        broken = _Breaker(self.number, _members(path)).visit(ast.parse(path.read_text()))
        assert isinstance(broken, ast.Module)
        return ast.fix_missing_locations(broken)

    def code(self) -> bytes:
        """The same compiled, as marshal keeps it: to be sent to another process."""
        return marshal.dumps(compile(self.tree(), str(ROOT / self.file), "exec"))


@dataclass(frozen=True)
class _Unit:
    """A method, a function, or a statement of a module."""

    name: str
    first: int
    last: int
    digest: str


class _Breaker(ast.NodeTransformer):
    """Goes through all places that can be broken, and breaks the one with a certain number; -1: none."""

    def __init__(self, wanted: int, members: dict[str, list[str]]) -> None:
        self._wanted = wanted
        self._members = members
        self._count = -1
        self.places: list[tuple[int, str]] = []
        """Line and meaning of each place; listed only where none is broken."""

    def _is_here(self, node: ast.AST, what: Callable[[], str]) -> bool:
        self._count += 1
        if self._wanted < 0:
            self.places.append((getattr(node, "lineno", 0), what()))
        return self._count == self._wanted

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.body = self._broken_block(node.body)
        return node

    def _broken_block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        found: list[ast.stmt] = []
        for statement in body:
            found += self._broken(statement)
        return found or [ast.Pass()]

    def _broken(self, statement: ast.stmt) -> list[ast.stmt]:
        def shown(kind: str) -> Callable[[], str]:
            return lambda: f"{kind}: {ast.unparse(statement).splitlines()[0]}"

        if isinstance(statement, ast.Assign | ast.AugAssign):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            if isinstance(target, ast.Attribute | ast.Subscript) and self._is_here(
                statement, shown("dropped")
            ):
                return []
        is_call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
        if is_call and self._is_here(statement, shown("dropped")):
            return []
        if isinstance(statement, ast.If):
            if all(map(_is_wording, statement.body)) and not statement.orelse:
                return [statement]
            is_guard = (
                len(statement.body) == 1
                and isinstance(statement.body[0], ast.Return)
                and not statement.orelse
            )
            if is_guard and self._is_here(statement, shown("guard dropped")):
                return []
            if self._is_here(statement, shown("negated")):
                statement.test = ast.UnaryOp(ast.Not(), statement.test)
                return [statement]
        self._broken_inside(statement)
        return [statement]

    def _broken_inside(self, statement: ast.stmt) -> None:
        for name in ("body", "orelse", "finalbody"):
            block = getattr(statement, name, None)
            if block:
                setattr(statement, name, self._broken_block(block))
        for name, value in ast.iter_fields(statement):
            if isinstance(value, ast.expr):
                setattr(statement, name, self.visit(value))
            elif isinstance(value, list) and name in ("targets", "items"):
                setattr(statement, name, [self.visit(each) for each in value])

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        other = OTHER_COMPARISON.get(type(node.ops[0]))
        if other is not None and self._is_here(node, lambda: f"other comparison: {ast.unparse(node)}"):
            node.ops[0] = other()
        self.generic_visit(node)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if self._is_member(node) and isinstance(node.ctx, ast.Load):
            assert isinstance(node.value, ast.Name)
            members = self._members[node.value.id]
            other = members[(members.index(node.attr) + 1) % len(members)]
            if self._is_here(node, lambda: f"other member: {ast.unparse(node)} -> {other}"):
                node.attr = other
        self.generic_visit(node)
        return node

    def _is_member(self, node: ast.AST | None) -> bool:
        return (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.attr in self._members.get(node.value.id, ())
        )

    def visit_Dict(self, node: ast.Dict) -> ast.AST:
        for at, key in enumerate(node.keys):
            if not (isinstance(key, ast.Tuple) or self._is_member(key)):
                continue
            assert key is not None
            if self._is_here(key, partial("row dropped: {}".format, ast.unparse(key))):
                del node.keys[at], node.values[at]
                return node
        self.generic_visit(node)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        if self._is_here(node, lambda: f"and for or: {ast.unparse(node)}"):
            node.op = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        self.generic_visit(node)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        if not (_is_text(node.body) and _is_text(node.orelse)):
            self.generic_visit(node)
        return node


def _is_text(value: ast.expr) -> bool:
    return isinstance(value, ast.JoinedStr) or (
        isinstance(value, ast.Constant) and isinstance(value.value, str)
    )


def _is_wording(statement: ast.stmt) -> bool:
    """Whether a statement only words a message."""
    return (
        isinstance(statement, ast.Assign)
        and isinstance(statement.targets[0], ast.Name)
        and _is_text(statement.value)
    )


@lru_cache
def _members(path: Path) -> dict[str, list[str]]:
    """Return the members of the enums that a file knows by name, without running any of it."""
    found: dict[str, list[str]] = {}
    for each in (path, *_imported_by(path)):
        for node in ast.parse(each.read_text()).body:
            if isinstance(node, ast.ClassDef) and node.name in ENUMS:
                found[node.name] = [
                    line.targets[0].id
                    for line in node.body
                    if isinstance(line, ast.Assign)
                    and isinstance(line.targets[0], ast.Name)
                    and not line.targets[0].id.startswith("_")
                ]
    return found


def _imported_by(path: Path) -> list[Path]:
    modules = [node.module for node in ast.parse(path.read_text()).body if isinstance(node, ast.ImportFrom)]
    paths = (ROOT / f"{(module or '').replace('.', '/')}.py" for module in modules)
    return [each for each in paths if each.is_file()]


def mutants_of(path: Path) -> list[Mutant]:
    """Return every mutant of a file, as they stand in it."""
    path = path.resolve()
    tree = ast.parse(path.read_text())
    statements, units = _statement_lines(tree), _units(tree)
    breaker = _Breaker(-1, _members(path))
    breaker.visit(ast.parse(path.read_text()))
    file = str(path.relative_to(ROOT))
    met: Counter[tuple[str, str]] = Counter()
    found: list[Mutant] = []
    for number, (line, what) in enumerate(breaker.places):
        unit = next(each for each in units if each.first <= line <= each.last)
        met[unit.name, what] += 1
        nth = met[unit.name, what]
        digest = sha256(f"{file} {unit.name} {unit.digest} {what} {nth}".encode()).hexdigest()[:16]
        found.append(Mutant(file, number, line, statements[line], unit.name, what, nth, digest))
    return found


def _units(tree: ast.Module) -> list[_Unit]:
    found: list[_Unit] = []

    def take(statements: list[ast.stmt], prefix: str) -> None:
        for each in statements:
            if isinstance(each, ast.ClassDef):
                take(each.body, f"{each.name}.")
                continue
            target = each.targets[0] if isinstance(each, ast.Assign) else getattr(each, "target", None)
            name = getattr(each, "name", "") or getattr(target, "id", "") or type(each).__name__
            first = min([each.lineno, *(one.lineno for one in getattr(each, "decorator_list", ()))])
            code = sha256(ast.dump(_without_docstrings(each)).encode()).hexdigest()
            found.append(_Unit(prefix + name, first, each.end_lineno or each.lineno, code))

    take(tree.body, "")
    return found


def _without_docstrings(statement: ast.stmt) -> ast.stmt:
    """Return it without strings that stand alone: those of functions, attributes and members."""
    for node in ast.walk(statement):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [each for each in body if not _is_docstring(each)] or [ast.Pass()]  # type: ignore[attr-defined]
    return statement


def _is_docstring(statement: ast.stmt) -> bool:
    is_constant = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)
    return is_constant and isinstance(statement.value.value, str)  # type: ignore[attr-defined]


def _statement_lines(tree: ast.Module) -> dict[int, int]:
    """Return for each line where the innermost statement begins that it belongs to."""
    found: dict[int, int] = {}
    for node in ast.walk(tree):  # breadth first: what is inside comes later
        if isinstance(node, ast.stmt):
            found |= dict.fromkeys(range(node.lineno, (node.end_lineno or node.lineno) + 1), node.lineno)
    return found
