"""``python -m tests.verify.mutants [FILE...]``: breaks the gateway in one place at a time; who notices?

A mutant drops an assignment, a call, a row of a table or a guard that returns, negates a condition, takes
another member of an enum, or takes ``<`` for ``<=``. Each is loaded in a process of its own, in place of the
file that it was made of, and the small worlds are walked until one of them breaks a rule, or for so long. No
other test is asked. A trace that breaks a rule on the gateway as it is too counts for nothing.

Which mutants are tried is drawn before anything is known of them (``--sample``, ``--seed``), from each file
as many as its share of all mutants. Left out is only what cannot change anything but the words of a message.
"""

import argparse
import ast
import importlib.util
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from gateway.compiled import is_compiled

ROOT: Final = Path(__file__).parents[2]
FILES: Final = (
    ROOT / "gateway" / "exchange" / "axis" / "axis.py",
    ROOT / "gateway" / "exchange" / "axis" / "motion.py",
    ROOT / "gateway" / "exchange" / "axis" / "reference.py",
    ROOT / "gateway" / "exchange" / "axis" / "interlock.py",
    ROOT / "gateway" / "exchange" / "axis" / "acknowledge.py",
    ROOT / "gateway" / "exchange" / "axis" / "registers.py",
    ROOT / "gateway" / "exchange" / "effects.py",
    ROOT / "gateway" / "exchange" / "group.py",
    ROOT / "gateway" / "exchange" / "decode.py",
    ROOT / "gateway" / "exchange" / "turns.py",
    ROOT / "gateway" / "exchange" / "transaction.py",
)
"""What decides a move, and whether a frame leaves."""
SECONDS: Final = 3.0
"""Of each world in the second round, half of them breadth first, half at random."""
FIRST_SECONDS: Final = (0.1, 0.5)
"""The same in rounds before it: most mutants are noticed at once, in one world or another."""
LONGER: Final = 8
"""So many times as long for a world that has killed such a mutant before."""
LOAD_SECONDS: Final = 20.0
"""Beside what the worlds may take: to load the gateway, and to find the shortest way."""
ENDLESS: Final = 1_000_000_000
EXAMPLES: Final = """examples:
  python -m tests.verify.mutants --sample 90 --seed 1 --json build/mutants.json
  python -m tests.verify.mutants gateway/exchange/axis/registers.py
  python -m tests.verify.mutants gateway/exchange/silent_units.py --every 3
  python -m tests.verify.mutants gateway/exchange/cut_through/frame.py --worlds b-rtu-cut-to b-rtu-cut-back
  python -m tests.verify.mutants gateway/exchange/axis/motion.py --list
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
    "Cut",
    "Known",
    "MotionEvent",
    "MotionState",
    "OnWire",
    "Outcome",
    "Phase",
    "ReferenceEvent",
    "ReferenceState",
    "Said",
    "Step",
    "StopEvent",
    "Stopping",
    "CutEvent",
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
    what: str

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


@dataclass
class Verdict:
    """What became of a mutant."""

    file: str
    number: int
    line: int
    what: str
    is_killed: bool = False
    world: str = ""
    how: str = ""
    seconds: float = 0.0
    misled: int = 0
    """Worlds that broke a rule, and do so without the mutant too: they count for nothing."""


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
    breaker = _Breaker(-1, _members(path))
    breaker.visit(ast.parse(path.read_text()))
    file = str(path.relative_to(ROOT))
    return [Mutant(file, number, *place) for number, place in enumerate(breaker.places)]


def sample(files: Sequence[Path], count: int, seed: int) -> list[Mutant]:
    """Draw so many mutants, of each file as many as its share of all mutants.

    Each mutant has a lot by what it breaks, so that a change of a file draws few others.
    """
    by_file = [mutants_of(path) for path in files]
    total = sum(map(len, by_file))
    found: list[Mutant] = []
    left, of = count, total
    for mutants in by_file:
        here = round(left * len(mutants) / of) if of else 0
        left, of = left - here, of - len(mutants)
        met: Counter[str] = Counter()
        lots = []
        for mutant in mutants:
            met[mutant.what] += 1
            lot = f"{seed} {mutant.file} {mutant.what} {met[mutant.what]}"
            lots.append((sha256(lot.encode()).digest(), mutant.number))
        found += [mutants[number] for number in sorted(number for _, number in sorted(lots)[:here])]
    return found


class _Finder:
    """Gives a mutant in place of a file."""

    def __init__(self, module: str, tree: ast.Module) -> None:
        self._module, self._tree = module, tree

    def find_spec(self, name: str, path: object = None, target: object = None) -> object:
        """See importlib."""
        if name != self._module:
            return None
        return importlib.util.spec_from_loader(name, self)  # type: ignore[arg-type]

    def create_module(self, spec: object) -> None:
        """See importlib."""

    def exec_module(self, module: object) -> None:
        """See importlib."""
        exec(compile(self._tree, self._module, "exec"), module.__dict__)


def _try(mutant: Mutant, worlds: Sequence[str], seconds: float, first: Sequence[str], answer: Any) -> None:
    """Walk the worlds with a mutant; runs in a process that has loaded nothing of the gateway."""
    module = ".".join(Path(mutant.file).with_suffix("").parts)
    sys.meta_path.insert(0, _Finder(module, mutant.tree()))  # type: ignore[arg-type]
    world = ""
    try:
        from tests.verify.running import walked

        left = list(worlds)
        rounds = [(LONGER * seconds, list(first)), *((each, left) for each in (*FIRST_SECONDS, seconds))]
        for each, of in rounds:
            for world in of[:]:
                outcome = walked(world, 0, each / 2, ENDLESS, 1)
                if outcome.broken:
                    answer.send((world, outcome.broken[0].what, outcome.broken[0].trace))
                    if answer.recv():
                        return
                    left.remove(world)  # it breaks the same without the mutant
    except Exception as error:  # noqa: BLE001, whatever a broken gateway does is noticed
        answer.send((world, f"{type(error).__name__}: {error}", ()))
        answer.recv()
        return
    answer.send(None)


def judged(mutant: Mutant, worlds: Sequence[str], seconds: float, first: Sequence[str] = ()) -> Verdict:
    """Find out whether the worlds notice a mutant; ``first``: worlds that are asked before the others."""
    began = time.monotonic()
    verdict = Verdict(mutant.file, mutant.number, mutant.line, mutant.what)
    ours, theirs = multiprocessing.Pipe()
    context = multiprocessing.get_context("spawn")
    process = context.Process(target=_try, args=(mutant, worlds, seconds, first, theirs))
    process.start()
    theirs.close()
    limit = (seconds + sum(FIRST_SECONDS) + 3.0) * len(worlds) + LOAD_SECONDS
    limit += (LONGER * seconds + 3.0) * len(first)
    try:
        until = began + limit
        while ours.poll(max(0.0, until - time.monotonic())):
            found = ours.recv()
            if found is None:
                break
            world, how, trace = found
            verdict.is_killed = not breaks_unbroken(world, how, trace)
            ours.send(verdict.is_killed)
            if verdict.is_killed:
                verdict.world, verdict.how = world, how
                break
            verdict.misled += 1
        else:
            verdict.is_killed, verdict.how = True, "it never ends"
    except EOFError:
        verdict.is_killed, verdict.how = True, "it cannot be loaded"
    process.kill()
    process.join()
    verdict.seconds = time.monotonic() - began
    return verdict


def breaks_unbroken(world: str, how: str, trace: tuple[Any, ...]) -> bool:
    """Whether a trace breaks a rule on the gateway as it is: then it proves nothing about a mutant.

    Where a way could not be gone the ways are, there too. Where there is no trace the gateway has raised an
    error; a world that does so with the gateway as it is ends the whole run with that error.
    """
    from tests.verify.designs import BY_NAME
    from tests.verify.explore import Walk, broken_by
    from tests.verify.running import walked
    from tests.verify.wires import world_of

    if how.endswith("(10)"):
        return bool(Walk(BY_NAME[world]).along().broken)
    if not trace:
        return bool(world and walked(world, 0, max(FIRST_SECONDS), ENDLESS, 1).broken)
    return broken_by(world_of(BY_NAME[world]), trace) is not None


class Judge:
    """Tries one mutant after the other; the worlds that have killed most go first.

    Before them, and for longer, those that have killed such a mutant in an earlier run (``before``: by file
    and what is broken).
    """

    def __init__(
        self,
        worlds: Sequence[str],
        seconds: float,
        before: Mapping[tuple[str, str], Sequence[str]] | None = None,
    ) -> None:
        self._worlds, self._seconds = tuple(worlds), seconds
        self._kills: Counter[str] = Counter()
        self._before = before or {}

    def __call__(self, mutant: Mutant) -> Verdict:
        """Judge one mutant."""
        worlds = sorted(self._worlds, key=lambda world: -self._kills[world])
        first = self._before.get((mutant.file, mutant.what), ())
        verdict = judged(mutant, worlds, self._seconds, first)
        if verdict.is_killed:
            self._kills[verdict.world] += 1
        return verdict


def _all_worlds() -> tuple[str, ...]:
    from tests.verify.designs import BY_NAME

    return tuple(BY_NAME)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the mutants of some files; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.verify.mutants",
        description="Breaks the gateway in one place at a time, and looks whether the small worlds notice.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="*", type=Path, default=FILES, metavar="FILE")
    parser.add_argument("--worlds", nargs="*", default=(), metavar="WORLD", help="(all)")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help="of each world (%(default)s)"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="mutants at a time (%(default)s)")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="only each Nth mutant")
    parser.add_argument("--sample", type=int, default=0, metavar="N", help="so many, drawn at random")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the drawing (%(default)s)")
    parser.add_argument(
        "--only", nargs="*", default=(), metavar="FILE:NUMBER", help="of these the ones named so"
    )
    parser.add_argument(
        "--json",
        type=Path,
        metavar="FILE",
        help="write what was found there too; worlds that killed a mutant in what stands there go first",
    )
    parser.add_argument("--list", action="store_true", help="say what mutants there are")
    asked = parser.parse_args(arguments)
    if is_compiled():
        parser.error("mutants are sources that were changed, and compiled modules are imported here instead")
    if asked.sample:
        mutants = sample(asked.files, asked.sample, asked.seed)
    else:
        mutants = [mutant for path in asked.files for mutant in mutants_of(path)][:: asked.every]
    if asked.only:
        mutants = [each for each in mutants if f"{Path(each.file).stem}:{each.number}" in asked.only]
    if asked.list:
        for mutant in mutants:
            print(f"{mutant.file}:{mutant.line}: {mutant.what}  ({mutant.number})")
        return 0
    verdicts: list[Verdict] = []
    judge = Judge(asked.worlds or _all_worlds(), asked.seconds, _killers(asked.json))
    with ThreadPoolExecutor(asked.jobs) as pool:
        for done in as_completed([pool.submit(judge, mutant) for mutant in mutants]):
            verdict = done.result()
            verdicts.append(verdict)
            fate = f"killed in {verdict.world or 'no world'}" if verdict.is_killed else "SURVIVED"
            where = f"{Path(verdict.file).stem}:{verdict.number} (line {verdict.line})"
            print(f"{fate:22} {verdict.seconds:5.1f} s  {where}: {verdict.what}", flush=True)
    verdicts.sort(key=lambda verdict: (verdict.file, verdict.number))
    _write(asked.json, verdicts)
    killed = sum(verdict.is_killed for verdict in verdicts)
    print(f"{killed} of {len(verdicts)} killed, {100.0 * killed / max(1, len(verdicts)):.1f} %")
    return 0


def _killers(path: Path | None) -> dict[tuple[str, str], list[str]]:
    """Return which worlds killed each kind of mutant, as an earlier run has written it down."""
    if path is None or not path.exists():
        return {}
    found = json.loads(path.read_text())["mutants"]
    killers: dict[tuple[str, str], list[str]] = {}
    for each in found:
        worlds = killers.setdefault((each["file"], each["what"]), [])
        if each["is_killed"] and each["world"] and each["world"] not in worlds:
            worlds.append(each["world"])
    return killers


def _write(path: Path | None, verdicts: Sequence[Verdict]) -> None:
    if path is None:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    killed = sum(verdict.is_killed for verdict in verdicts)
    found = {"killed": killed, "total": len(verdicts), "mutants": [asdict(each) for each in verdicts]}
    path.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    sys.exit(main())
