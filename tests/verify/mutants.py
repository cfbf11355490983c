"""``python -m tests.verify.mutants FILE...``: breaks the gateway in one place at a time; who notices?

A mutant drops an assignment, a call, a row or a guard that returns, negates a condition, takes another
member of an enum, or takes ``<`` for ``<=``. Each is loaded in a process of its own, in place of the file
that it was made of, and the small worlds are walked until one of them breaks a rule, or for so long. No
other test is asked.
"""

import argparse
import ast
import importlib.util
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
WORLDS: Final = (
    "direct",
    "staged",
    "near",
    "garbled",
    "unplugged",
    "killed",
    "halves",
    "relative",
    "writers",
    "homing",
)
SECONDS: Final = 6.0
"""Of each world, half of them breadth first, half at random."""
ENDLESS: Final = 1_000_000_000
EXAMPLES: Final = """examples:
  python -m tests.verify.mutants gateway/exchange/axis/transitions.py
  python -m tests.verify.mutants gateway/exchange/shadow.py --every 3 --json build/mutants.json
  python -m tests.verify.mutants gateway/exchange/axis/transitions.py --list
"""
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
    "Happening",
    "OnWire",
    "Outcome",
    "Phase",
    "Referenced",
    "ReferenceEvent",
    "Said",
    "Switched",
    "Whereabouts",
)
"""Names of enums whose members are taken for each other."""


@dataclass(frozen=True)
class Mutant:
    """One place of a file that is broken."""

    file: str
    line: int
    what: str
    source: str


@dataclass
class Verdict:
    """What became of a mutant."""

    file: str
    line: int
    what: str
    is_killed: bool = False
    world: str = ""
    how: str = ""
    seconds: float = 0.0


class _Breaker(ast.NodeTransformer):
    """Breaks the place with a certain number, and no other."""

    def __init__(self, wanted: int, members: dict[str, list[str]]) -> None:
        self._wanted = wanted
        self._members = members
        self._count = -1
        self.what = ""
        self.line = 0

    def _is_here(self, node: ast.AST, what: str) -> bool:
        self._count += 1
        if self._count != self._wanted:
            return False
        self.what, self.line = what, getattr(node, "lineno", 0)
        return True

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        node.body = self._broken_block(node.body)
        return node

    def _broken_block(self, body: list[ast.stmt]) -> list[ast.stmt]:
        found: list[ast.stmt] = []
        for statement in body:
            found += self._broken(statement)
        return found or [ast.Pass()]

    def _broken(self, statement: ast.stmt) -> list[ast.stmt]:
        shown = ast.unparse(statement).split("\n")[0]
        if isinstance(statement, ast.Assign | ast.AugAssign):
            target = statement.targets[0] if isinstance(statement, ast.Assign) else statement.target
            if isinstance(target, ast.Attribute | ast.Subscript) and self._is_here(
                statement, f"dropped: {shown}"
            ):
                return []
        is_call = isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Call)
        if is_call and self._is_here(statement, f"dropped: {shown}"):
            return []
        if isinstance(statement, ast.If):
            is_guard = (
                len(statement.body) == 1
                and isinstance(statement.body[0], ast.Return)
                and not statement.orelse
            )
            if is_guard and self._is_here(statement, f"guard dropped: {shown}"):
                return []
            if self._is_here(statement, f"negated: {shown}"):
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
        if other is not None and self._is_here(node, f"other comparison: {ast.unparse(node)}"):
            node.ops[0] = other()
        self.generic_visit(node)
        return node

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if (
            isinstance(node.value, ast.Name)
            and node.value.id in self._members
            and isinstance(node.ctx, ast.Load)
        ):
            members = self._members[node.value.id]
            if node.attr in members and self._is_here(node, f"other member: {ast.unparse(node)}"):
                node.attr = members[(members.index(node.attr) + 1) % len(members)]
                self.what += f" -> {node.attr}"
        self.generic_visit(node)
        return node

    def visit_Dict(self, node: ast.Dict) -> ast.AST:
        for at, key in enumerate(node.keys):
            if isinstance(key, ast.Tuple) and self._is_here(key, f"row dropped: {ast.unparse(key)}"):
                del node.keys[at], node.values[at]
                return node
        self.generic_visit(node)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        if self._is_here(node, f"and for or: {ast.unparse(node)}"):
            node.op = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        self.generic_visit(node)
        return node


def _members(path: Path) -> dict[str, list[str]]:
    """Return the members of the enums that a file knows by name."""
    module = importlib.import_module(".".join(path.relative_to(ROOT).with_suffix("").parts))
    found = {}
    for name in ENUMS:
        kind = getattr(module, name, None)
        if isinstance(kind, type) and issubclass(kind, Enum):
            found[name] = [member.name for member in kind]
    return found


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    path = path.resolve()
    tree, members = ast.parse(path.read_text()), _members(path)
    number = 0
    while True:
        breaker = _Breaker(number, members)
        broken = breaker.visit(deepcopy(tree))
        if not breaker.what:
            return
        source = ast.unparse(ast.fix_missing_locations(broken))
        yield Mutant(str(path.relative_to(ROOT)), breaker.line, breaker.what, source)
        number += 1


class _Finder:
    """Gives the source of a mutant in place of a file."""

    def __init__(self, module: str, source: str) -> None:
        self._module, self._source = module, source

    def find_spec(self, name: str, path: object = None, target: object = None) -> object:
        """See importlib."""
        if name != self._module:
            return None
        return importlib.util.spec_from_loader(name, self)  # type: ignore[arg-type]

    def create_module(self, spec: object) -> None:
        """See importlib."""

    def exec_module(self, module: object) -> None:
        """See importlib."""
        exec(compile(self._source, self._module, "exec"), module.__dict__)


def _try(mutant: Mutant, worlds: Sequence[str], seconds: float, answer: object) -> None:
    """Walk the worlds with a mutant; runs in a process that has loaded nothing of the gateway."""
    module = ".".join(Path(mutant.file).with_suffix("").parts)
    sys.meta_path.insert(0, _Finder(module, mutant.source))  # type: ignore[arg-type]
    try:
        from tests.verify.running import walked

        for world in worlds:
            outcome = walked(world, 0, seconds / 2, ENDLESS, 1)
            if outcome.broken:
                answer.send((world, outcome.broken[0].what))  # type: ignore[attr-defined]
                return
    except Exception as error:  # noqa: BLE001, whatever a broken gateway does is noticed
        answer.send(("", f"{type(error).__name__}: {error}"))  # type: ignore[attr-defined]
        return
    answer.send(None)  # type: ignore[attr-defined]


def judged(mutant: Mutant, worlds: Sequence[str], seconds: float) -> Verdict:
    """Find out whether the worlds notice a mutant."""
    began = time.monotonic()
    verdict = Verdict(mutant.file, mutant.line, mutant.what)
    ours, theirs = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=_try, args=(mutant, worlds, seconds, theirs))
    process.start()
    theirs.close()
    limit = (seconds + 10.0) * len(worlds)
    try:
        if ours.poll(limit):
            found = ours.recv()
            if found is not None:
                verdict.is_killed = True
                verdict.world, verdict.how = found
        else:
            verdict.is_killed, verdict.how = True, "it never ends"
    except EOFError:
        verdict.is_killed, verdict.how = True, "it cannot be loaded"
    process.kill()
    process.join()
    verdict.seconds = time.monotonic() - began
    return verdict


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the mutants of some files; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.verify.mutants",
        description="Breaks the gateway in one place at a time, and looks whether the small worlds notice.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    parser.add_argument("--worlds", nargs="*", default=WORLDS, metavar="WORLD", help="(%(default)s)")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help="of each world (%(default)s)"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="mutants at a time (%(default)s)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each Nth mutant")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write what was found there too")
    parser.add_argument("--list", action="store_true", help="say what mutants there are")
    asked = parser.parse_args(arguments)
    mutants = [mutant for path in asked.files for mutant in mutants_of(path)][:: asked.every]
    if asked.list:
        for mutant in mutants:
            print(f"{mutant.file}:{mutant.line}: {mutant.what}")
        return 0
    verdicts = []
    with ThreadPoolExecutor(asked.jobs) as pool:
        for verdict in pool.map(lambda mutant: judged(mutant, asked.worlds, asked.seconds), mutants):
            verdicts.append(verdict)
            fate = f"killed in {verdict.world or 'no world'}" if verdict.is_killed else "SURVIVED"
            print(
                f"{fate:22} {verdict.seconds:5.1f} s  {verdict.file}:{verdict.line}: {verdict.what}",
                flush=True,
            )
    killed = sum(verdict.is_killed for verdict in verdicts)
    print(f"{killed} of {len(verdicts)} killed, {100.0 * killed / max(1, len(verdicts)):.1f} %")
    if asked.json is not None:
        asked.json.parent.mkdir(parents=True, exist_ok=True)
        found = {"killed": killed, "total": len(verdicts), "mutants": [asdict(each) for each in verdicts]}
        asked.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
