"""``make mutants``: breaks the gateway in one place at a time; who notices?

Each mutant (``breaking``) is loaded in a process of its own, in place of the file that it was made of. The
small worlds that run through the broken place are walked until one of them breaks a rule, or for so long. A
trace that breaks a rule on the gateway as it is too counts for nothing. Tests of the exchange are asked with
``--by-tests``: of most mutants that is quicker, so it may come first.

Verdicts are kept in ``mutants_verdicts.tsv``, by a digest of the method that was broken: a run that was
stopped goes on where it was, and after a change only the mutants of changed methods are tried. Mutants are
tried in an order that is drawn by lot from their names, so the first hundred are a sample of all. A first run
asks some worlds of each mutant (``--most-worlds``); what survives these is tried with all of them later
(``--again``). ``mutants_explained.toml`` has the reason for each that survives tests and worlds.
"""

import argparse
import ast
import importlib.util
import json
import marshal
import multiprocessing
import os
import resource
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from dis import get_instructions
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, Final

from gateway.compiled import is_compiled
from tests.verify.breaking import ROOT, Mutant, mutants_of

_EXCHANGE: Final = ROOT / "gateway" / "exchange"
FILES: Final = (
    *(_EXCHANGE / "axis" / f"{each}.py" for each in ("motion", "reference", "acknowledge", "interlock")),
    *(_EXCHANGE / "axis" / f"{each}.py" for each in ("axis", "registers", "reach", "reports", "member")),
    *(_EXCHANGE / "axis" / f"{each}.py" for each in ("correction", "recall", "targets")),
    *(
        _EXCHANGE / f"{each}.py"
        for each in ("effects", "group", "kept_words", "decode", "scheduler", "transaction")
    ),
    *(
        _EXCHANGE / "cut_through" / f"{each}.py"
        for each in ("frame", "delay", "forward", "line", "requests", "replies")
    ),
)
"""What decides a move, and whether a frame leaves."""
KEPT: Final = Path(__file__).with_name("mutants_verdicts.tsv")
REACH: Final = ROOT / "build" / "mutants" / "reach.jsonl"
TESTS_REACH: Final = REACH.with_name("tests.jsonl")
EXPLAINED: Final = Path(__file__).with_name("mutants_explained.toml")
FIRST_SECONDS: Final = 0.1
"""Of each world in a first round, which kills most mutants."""
SECONDS: Final = 1.0
"""The same in the second round. Half of each are walked breadth first, half at random."""
REACH_SECONDS: Final = 2.0
"""Of each world, to find out which lines it runs through. It is slower then by about four times."""
SILENT_SECONDS: Final = 10.0
"""A mutant that walks one world for so much longer than it should never ends: seconds of the processor."""
MOST_BYTES: Final = 6 << 30
ENDLESS: Final = 1_000_000_000
LOADED: Final = multiprocessing.get_context("forkserver")
"""Its processes begin with the gateway and the worlds imported, as copies of one that did nothing else."""
LOADED.set_forkserver_preload(["tests.verify.running"])
EXAMPLES: Final = """examples:
  python -m tests.verify.mutants --most 90                 a sample of ninety
  python -m tests.verify.mutants --minutes 140             as many as that, then go on another day
  python -m tests.verify.mutants --most-worlds 24          of each only so many worlds, the likeliest first
  python -m tests.verify.mutants --again                   then what survived, with all worlds
  python -m tests.verify.mutants --by-tests                what nothing has noticed yet: does a test?
  python -m tests.verify.mutants --summary                 what is known by now
  python -m tests.verify.mutants gateway/exchange/scheduler.py --list
  python -m tests.verify.mutants --named scheduler:Scheduler.take --again
"""


@dataclass
class Verdict:
    """What became of a mutant."""

    digest: str
    name: str
    line: int
    is_killed: bool = False
    world: str = ""
    how: str = ""
    worlds: int = 0
    """That run through the broken place."""
    asked: int = 0
    """So many of them were walked."""
    walked_s: float = 0.0
    """How long each of them was walked in the last round."""
    seconds: float = 0.0
    misled: int = 0
    """Worlds that broke a rule, and do so without the mutant too: they count for nothing."""
    test: str | None = None
    """Of one that the worlds do not notice: the first test that does; "": none; None: not asked yet."""

    @property
    def is_noticed(self) -> bool:
        """Whether a world or a test notices it."""
        return self.is_killed or bool(self.test)

    @property
    def row(self) -> str:
        """What is kept of it: one row of the file of verdicts."""
        if self.is_killed:
            return f"{self.digest}\tkilled\t{self.world}\n"
        row = f"{self.digest}\tsurvived\t{self.asked}\t{self.worlds}\t{self.walked_s:g}"
        return f"{row}\n" if self.test is None else f"{row}\t{self.test}\n"

    @classmethod
    def of_row(cls, row: str, name: str, line: int) -> "Verdict":
        """Return what was kept of a mutant."""
        digest, fate, *rest = row.rstrip("\n").split("\t")
        if fate == "killed":
            return cls(digest, name, line, is_killed=True, world=rest[0])
        asked, worlds, walked_s, *test = rest
        verdict = cls(digest, name, line, worlds=int(worlds), asked=int(asked), walked_s=float(walked_s))
        verdict.test = test[0] if test else None
        return verdict


class BrokenFile:
    """Gives a mutant to those who import its file, in place of the file."""

    def __init__(self, mutant: Mutant, code: CodeType) -> None:
        self._module, self._code = _module_of(mutant.file), code

    def find_spec(self, name: str, path: object = None, target: object = None) -> object:
        """See importlib."""
        if name != self._module:
            return None
        return importlib.util.spec_from_loader(name, self)  # type: ignore[arg-type]

    def create_module(self, spec: object) -> None:
        """See importlib."""

    def exec_module(self, module: object) -> None:
        """See importlib."""
        exec(self._code, module.__dict__)


def load(mutant: Mutant, compiled: bytes) -> bool:
    """Break the gateway in this process, with ``Mutant.code``; return whether what was imported stays.

    A method gets the code of the broken one: whoever holds the method calls that. Where a file is broken
    outside of its methods, or in a function that is called while it is imported, everything that was imported
    is imported anew.
    """
    name = _module_of(mutant.file)
    method = _method(sys.modules.get(name), mutant.unit)
    whole = marshal.loads(compiled)
    code = _code_of(whole, mutant.unit)
    is_late = not any(
        each.opname == "LOAD_NAME" and each.argval == mutant.unit for each in get_instructions(whole)
    )
    if (
        method is not None
        and code is not None
        and method.__code__.co_freevars == code.co_freevars
        and is_late
    ):
        method.__code__ = code
        return True
    for each in [each for each in sys.modules if each.partition(".")[0] in ("gateway", "tests")]:
        del sys.modules[each]
    sys.meta_path.insert(0, BrokenFile(mutant, whole))  # type: ignore[arg-type]
    return False


def _method(found: Any, path: str) -> FunctionType | None:
    """Return the method of a module: ``Motion.enter``; None: that is no method, or one that is wrapped."""
    for part in path.split("."):
        found = vars(found).get(part) if hasattr(found, "__dict__") else None
    if isinstance(found, property) and found.fset is None:
        found = found.fget
    elif isinstance(found, staticmethod | classmethod):
        found = found.__func__
    return found if isinstance(found, FunctionType) else None


def _code_of(code: CodeType, path: str) -> CodeType | None:
    """Return the code of a method in the code of its file; None: it has none, or more than one."""
    found = [code]
    for part in path.split("."):
        inner = [const for each in found for const in each.co_consts if isinstance(const, CodeType)]
        found = [each for each in inner if each.co_name == part]
    return found[0] if len(found) == 1 else None


def _try(mutant: Mutant, compiled: bytes, worlds: Sequence[str], seconds: float, answer: Any) -> None:
    """Walk the worlds with a mutant, in a process of its own.

    Sent are the name of each world before it is walked, and what it broke; the last is None. Asked back is
    whether that counts.
    """
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    load(mutant, compiled)
    world = ""
    try:
        from tests.verify.running import walked

        left = list(worlds)
        for each in (FIRST_SECONDS, seconds) if seconds > FIRST_SECONDS else (seconds,):
            for world in left[:]:
                answer.send(world)
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


def judged(mutant: Mutant, worlds: Sequence[str], seconds: float) -> Verdict:
    """Find out whether the worlds notice a mutant."""
    began = time.monotonic()
    count = len(worlds)
    verdict = Verdict(mutant.digest, mutant.name, mutant.line, worlds=count, asked=count, walked_s=seconds)
    if not worlds:
        verdict.how = "no world runs through it"
        return verdict
    ours, theirs = multiprocessing.Pipe()
    process = LOADED.Process(target=_try, args=(mutant, mutant.code(), worlds, seconds, theirs))
    process.start()
    theirs.close()
    try:
        while (found := heard(ours, process, SILENT_SECONDS + seconds)) is not ENDLESS:
            if found is None:
                break
            if isinstance(found, str):
                verdict.world = found
                continue
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
    if not verdict.is_killed:
        verdict.world = ""
    verdict.seconds = round(time.monotonic() - began, 1)
    return verdict


def heard(ours: Any, process: Any, most_s: float) -> Any:
    """Return what a process says next; ``ENDLESS``: nothing, while it computed for so long."""
    began_s = _computed_s(process.pid)
    while not ours.poll(1.0):
        if _computed_s(process.pid) - began_s > most_s:
            return ENDLESS
    return ours.recv()


def _computed_s(pid: int) -> float:
    """Return how long a process has computed (proc_pid_stat(5), utime)."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return int(fields[11]) / os.sysconf("SC_CLK_TCK")


def breaks_unbroken(world: str, how: str, trace: tuple[Any, ...]) -> bool:
    """Whether a trace breaks a rule on the gateway as it is: then it proves nothing about a mutant.

    Where a way could not be gone the ways are, there too. Where there is no trace the gateway has raised an
    error; a world that does so with the gateway as it is ends the whole run with that error.
    """
    from tests.verify.designs import BY_NAME
    from tests.verify.explore import Walk, broken_by
    from tests.verify.wires import world_of

    if how.endswith("(10)"):
        return bool(Walk(BY_NAME[world]).along().broken)
    if not trace:
        return bool(world) and breaks_anyway(world)
    return broken_by(world_of(BY_NAME[world]), trace) is not None


@cache
def breaks_anyway(world: str) -> bool:
    """Whether a world breaks a rule, or raises an error, on the gateway as it is."""
    from tests.verify.running import walked

    return bool(walked(world, 0, SECONDS, ENDLESS, 1).broken)


def lines_run(world: str) -> tuple[str, dict[str, list[int]]]:
    """Walk a world and return its name and the lines of each file that it runs through, from its start on."""
    files = {str(path): str(path.relative_to(ROOT)) for path in FILES}
    met: dict[str, set[int]] = {file: set() for file in files.values()}

    def on_call(frame: Any, _event: str, _argument: object) -> Any:
        file = files.get(frame.f_code.co_filename)
        if file is None:
            return None
        add = met[file].add

        def on_line(frame: Any, _event: str, _argument: object) -> Any:
            add(frame.f_lineno)
            return on_line

        add(frame.f_lineno)
        return on_line

    from tests.verify.running import walked

    sys.settrace(on_call)
    try:
        walked(world, 0, REACH_SECONDS / 2, ENDLESS, 1)
    finally:
        sys.settrace(None)
    for path in FILES:
        met[files[str(path)]] |= rows_looked_up(path)
    return world, {file: sorted(lines) for file, lines in met.items() if lines}


def rows_looked_up(path: Path) -> set[int]:
    """Return the lines of the rows of tables in a file that were asked for in this process."""
    from tests.verify.snapshot import WatchedRows

    module = importlib.import_module(_module_of(str(path.relative_to(ROOT))))
    found: set[int] = set()

    def take(node: ast.Dict, table: Any) -> bool:
        is_met = False
        for key, row in zip(node.keys, node.values, strict=True):
            if key is None:
                continue
            value = eval(compile(ast.Expression(key), str(path), "eval"), vars(module))
            if isinstance(row, ast.Dict):
                is_one = take(row, table[value])
            else:
                is_one = isinstance(table, WatchedRows) and value in table.looked_up
            if is_one:
                is_met = True
                found.update((key.lineno, row.lineno))
        return is_met

    for each in ast.parse(path.read_text()).body:
        if isinstance(each, ast.AnnAssign) and isinstance(each.value, ast.Dict):
            take(each.value, getattr(module, ast.unparse(each.target)))
    return found


def _module_of(file: str) -> str:
    return ".".join(Path(file).with_suffix("").parts)


class Reach:
    """Which worlds run through a line: found out once for each state of the files, and kept by world."""

    def __init__(self, names: Sequence[str], path: Path, jobs: int) -> None:
        here = Path(__file__).parent.glob("*.py")
        sources = sorted(
            (
                *FILES,
                *(each for each in here if each.stem != "breaking" and not each.stem.startswith("mutants")),
            )
        )
        digest = sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:16]
        rows = path.read_text().splitlines() if path.exists() else []
        if rows[:1] != [digest]:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(f"{digest}\n")
            rows = [digest]
        self._lines: dict[str, dict[str, set[int]]] = {}
        for row in rows[1:]:
            self._take(*json.loads(row))
        left = [name for name in names if name not in self._lines]
        with path.open("a") as kept:
            for found in _all_lines(left, jobs):
                kept.write(f"{json.dumps(found)}\n")
                kept.flush()
                self._take(*found)

    def _take(self, world: str, by_file: dict[str, list[int]]) -> None:
        self._lines[world] = {file: set(lines) for file, lines in by_file.items()}

    def worlds(self, mutant: Mutant) -> list[str]:
        """Return the worlds that run through the place of a mutant, or ask for the row of a table.

        Of a table whose rows are not watched: every world that there is.
        """
        lines = {mutant.line, mutant.statement_line}
        is_row = "." not in mutant.unit and mutant.unit.isupper()
        if is_row and self._is_watched(mutant):
            lines = {mutant.line}
        elif is_row:
            return list(self._lines)
        return [name for name, by_file in self._lines.items() if lines & by_file.get(mutant.file, set())]

    def _is_watched(self, mutant: Mutant) -> bool:
        """Whether it is noted which rows of the table of a mutant are asked for."""
        from tests.verify.snapshot import is_watched

        module = importlib.import_module(_module_of(mutant.file))
        return is_watched(getattr(module, mutant.unit))


def _all_lines(names: Sequence[str], jobs: int) -> Iterator[tuple[str, dict[str, list[int]]]]:
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, mp_context=context, max_tasks_per_child=1) as pool:
        for count, found in enumerate(pool.map(lines_run, names)):
            if not count % 25:
                print(f"which lines does a world run through? {count} of {len(names)}", file=sys.stderr)
            yield found


class Judge:
    """Tries one mutant after the other. Worlds that have killed others of the same method go first."""

    def __init__(self, reach: Reach, seconds: float, most_worlds: int, verdicts: Iterable[Verdict]) -> None:
        self._reach, self._seconds, self._most_worlds = reach, seconds, most_worlds
        self._kills: Counter[str] = Counter()
        self._by_unit: Counter[tuple[str, str]] = Counter()
        self._before: dict[str, str] = {}
        for verdict in verdicts:
            self.note(verdict)

    def note(self, verdict: Verdict) -> None:
        """Learn from a verdict which worlds kill."""
        if verdict.is_killed and verdict.world:
            self._kills[verdict.world] += 1
            self._by_unit[_unit_of(verdict.name), verdict.world] += 1
            self._before[verdict.name] = verdict.world

    def __call__(self, mutant: Mutant) -> Verdict:
        """Judge one mutant."""
        unit, before = _unit_of(mutant.name), self._before.get(mutant.name)

        def likely(world: str) -> tuple[bool, int, int]:
            return world != before, -self._by_unit[unit, world], -self._kills[world]

        worlds = sorted(self._reach.worlds(mutant), key=likely)
        verdict = judged(mutant, worlds[: self._most_worlds or None], self._seconds)
        verdict.worlds = len(worlds)
        self.note(verdict)
        return verdict


def _unit_of(name: str) -> str:
    return ":".join(name.split(":")[:2])


def _all_worlds() -> tuple[str, ...]:
    from tests.verify.designs import BY_NAME, CLOSES_LATER

    return tuple(name for name in BY_NAME if name not in CLOSES_LATER)


def by_lot(mutants: Iterable[Mutant]) -> list[Mutant]:
    """Return mutants in an order that is drawn from their names: the first so many are a sample."""
    return sorted(mutants, key=lambda mutant: sha256(mutant.name.encode()).digest())


def kept_verdicts(mutants: Iterable[Mutant], path: Path = KEPT) -> dict[str, Verdict]:
    """Return what is known of mutants, by digest: of each the last verdict, or the last that noticed it."""
    by_digest = {mutant.digest: mutant for mutant in mutants}
    found: dict[str, Verdict] = {}
    for row in path.read_text().splitlines() if path.exists() else ():
        mutant = by_digest.get(row.partition("\t")[0])
        if mutant is None:
            continue
        verdict = Verdict.of_row(row, mutant.name, mutant.line)
        before = found.get(mutant.digest)
        if before is None or verdict.is_noticed or not before.is_noticed:  # two runs may have asked at a time
            found[mutant.digest] = verdict
    return found


def tidy(path: Path = KEPT) -> None:
    """Write the verdicts anew, without those on mutants that are no more."""
    verdicts = kept_verdicts((mutant for file in FILES for mutant in mutants_of(file)), path)
    path.write_text("".join(sorted(verdict.row for verdict in verdicts.values())))


class Reasons:
    """Why mutants survive: of single ones, and of all in a method through which no world runs."""

    def __init__(self, path: Path = EXPLAINED) -> None:
        rows = tomllib.loads(path.read_text()) if path.exists() else {}
        self.mutants: dict[str, tuple[str, str]] = {
            name: (row["kind"], row["why"]) for row in rows.get("mutant", ()) for name in row["names"]
        }
        """By name: equivalent, left out or open, and why."""
        self.units: dict[str, str] = {row["unit"]: row["why"] for row in rows.get("unit", ())}
        """By ``FILE:METHOD``: why no world runs through it."""

    def kind(self, verdict: Verdict) -> str:
        """Return what is known of a mutant that the worlds do not notice; "" where nothing explains it."""
        if verdict.test:
            return "by a test"
        if verdict.worlds == 0 and _unit_of(verdict.name) in self.units:
            return "left out"
        return self.mutants.get(verdict.name, ("", ""))[0]


def summary(mutants: Sequence[Mutant], verdicts: Mapping[str, Verdict]) -> str:
    """Return what became of the mutants of each file, as a table in Markdown."""
    reasons = Reasons()
    kinds = ("killed", "by a test", "equivalent", "left out", "open", "unexplained", "not tried")
    rows: dict[str, Counter[str]] = {}
    for mutant in mutants:
        row = rows.setdefault(mutant.file.removeprefix("gateway/exchange/"), Counter())
        verdict = verdicts.get(mutant.digest)
        if verdict is None:
            row["not tried"] += 1
        elif verdict.is_killed:
            row["killed"] += 1
        else:
            row[reasons.kind(verdict) or "unexplained"] += 1
    total = sum(rows.values(), Counter[str]())
    head = f"| file | mutants | {' | '.join(kinds)} |\n|---|{'---:|' * (len(kinds) + 1)}\n"
    lines = (
        f"| {name} | {sum(row.values())} | {' | '.join(str(row[kind]) for kind in kinds)} |"
        for name, row in (*((f"`{file}`", row) for file, row in rows.items()), ("all", total))
    )
    return head + "\n".join(lines)


def _parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m tests.verify.mutants",
        description="Breaks the gateway in one place at a time, and looks whether the small worlds notice.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("files", nargs="*", type=Path, default=FILES, metavar="FILE")
    parser.add_argument("--most", type=int, default=0, metavar="N", help="only the first N of the lot")
    parser.add_argument("--minutes", type=float, default=0.0, metavar="M", help="begin no mutant after that")
    parser.add_argument("--named", nargs="*", default=(), metavar="NAME", help="those that begin so")
    parser.add_argument("--worlds", nargs="*", default=(), metavar="WORLD", help="(all)")
    parser.add_argument(
        "--seconds", type=float, default=SECONDS, metavar="S", help="of each world (%(default)s)"
    )
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="mutants at a time (%(default)s)")
    parser.add_argument("--again", action="store_true", help="try what survived before once more")
    parser.add_argument(
        "--most-worlds", type=int, default=0, metavar="N", help="of each mutant, the likeliest first (all)"
    )
    parser.add_argument(
        "--by-tests", action="store_true", help="ask the tests of the exchange about what nothing has noticed"
    )
    parser.add_argument(
        "--tests-seconds",
        type=float,
        default=0.0,
        metavar="S",
        help="of each mutant only the first tests",
    )
    parser.add_argument("--summary", action="store_true", help="say what is known, and what is unexplained")
    parser.add_argument("--list", action="store_true", help="say what mutants there are")
    asked = parser.parse_args(arguments)
    if is_compiled():
        parser.error("mutants are sources that were changed, and compiled modules are imported here instead")
    return asked


def main(arguments: Sequence[str] | None = None) -> int:
    """Try the mutants of some files; return the exit code: 1 where one survives that nothing explains."""
    asked = _parsed(arguments)
    mutants = [mutant for path in asked.files for mutant in mutants_of(path)]
    if asked.named:
        mutants = [each for each in mutants if each.name.startswith(tuple(asked.named))]
    if asked.list:
        for mutant in mutants:
            print(f"{mutant.file}:{mutant.line}: {mutant.name}")
        return 0
    verdicts = kept_verdicts(mutants)
    if asked.by_tests:
        _try_by_tests(by_lot(mutants), verdicts, asked)
        tidy()
        verdicts = kept_verdicts(mutants)
    elif not asked.summary:
        drawn = by_lot(mutants)[: asked.most or None]
        left = [
            mutant
            for mutant in drawn
            if (known := verdicts.get(mutant.digest)) is None or (asked.again and not known.is_noticed)
        ]
        print(f"{len(left)} of {len(drawn)} mutants are to be tried", file=sys.stderr)
        if left:
            reach = Reach(asked.worlds or _all_worlds(), REACH, asked.jobs)
            _try_all(left, Judge(reach, asked.seconds, asked.most_worlds, verdicts.values()), asked)
            tidy()
        verdicts = kept_verdicts(mutants)
        mutants = drawn
    print(summary(mutants, verdicts))
    return _tell_unexplained(mutants, verdicts)


def _try_by_tests(mutants: Sequence[Mutant], verdicts: dict[str, Verdict], asked: argparse.Namespace) -> None:
    """Ask the tests about each mutant that nothing has noticed yet, and keep each verdict as it falls."""
    from tests.verify.mutants_by_tests import Asker, all_tests

    until = time.monotonic() + asked.minutes * 60.0 if asked.minutes else float("inf")
    left: list[tuple[Mutant, Verdict]] = []
    for mutant in mutants:
        verdict = verdicts.get(mutant.digest) or Verdict(mutant.digest, mutant.name, mutant.line)
        if not verdict.is_noticed and (verdict.test is None or asked.again):
            left.append((mutant, verdict))
    print(f"{len(left)} mutants: do the tests of the exchange notice them?", file=sys.stderr)
    if not left:
        return
    asker = Asker(all_tests(FILES, TESTS_REACH, asked.jobs), asked.tests_seconds, verdicts.values())
    with KEPT.open("a") as kept:
        for mutant, verdict in left[: asked.most or None]:
            if time.monotonic() >= until:
                break
            test = asker(mutant)
            print(f"{test or 'NO TEST'}: {mutant.name} (line {mutant.line})", flush=True)
            if test or (test is not None and mutant.digest in verdicts):
                verdict.test = test
                kept.write(verdict.row)
                kept.flush()
    asker.end()


def _try_all(mutants: Sequence[Mutant], judge: Judge, asked: argparse.Namespace) -> None:
    """Judge mutants two at a time, and keep each verdict as it falls."""
    until = time.monotonic() + asked.minutes * 60.0 if asked.minutes else float("inf")

    def judge_in_time(mutant: Mutant) -> Verdict | None:
        return judge(mutant) if time.monotonic() < until else None

    with ThreadPoolExecutor(asked.jobs) as pool, KEPT.open("a") as kept:
        for done in as_completed([pool.submit(judge_in_time, mutant) for mutant in mutants]):
            verdict = done.result()
            if verdict is None:
                continue
            kept.write(verdict.row)
            kept.flush()
            fate = f"killed in {verdict.world or 'no world'}" if verdict.is_killed else "SURVIVED"
            print(f"{fate:26} {verdict.seconds:5.1f} s  {verdict.name} (line {verdict.line})", flush=True)


def _tell_unexplained(mutants: Sequence[Mutant], verdicts: Mapping[str, Verdict]) -> int:
    reasons = Reasons()
    tried = [(each, verdicts[each.digest]) for each in mutants if each.digest in verdicts]
    noticed = sum(verdict.is_noticed for _, verdict in tried)
    print(f"{noticed} of {len(tried)} noticed, {100.0 * noticed / max(1, len(tried)):.1f} %")
    unexplained = [
        (mutant, verdict) for mutant, verdict in tried if not verdict.is_noticed and not reasons.kind(verdict)
    ]
    for mutant, verdict in unexplained:
        print(f"unexplained: {mutant.file}:{mutant.line}: {mutant.name}; worlds: {verdict.worlds}")
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
