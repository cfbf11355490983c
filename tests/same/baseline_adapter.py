"""What the same-bytes test reaches inside of this revision: one file, so that a reshaping changes only it.

``baseline_adapter.py`` is this file as it was at the baseline, and stays so. Both have the same functions.
Each yields what went over the wires and what was told: a line for each frame or event, with its time.
"""

import asyncio
import random
from collections.abc import Callable, Iterator
from contextlib import AsyncExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from gateway.catalogue.entry import EventEntry
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.drives.library import names
from gateway.exchange.line import LineExchange
from tests.contract.bench import SESSIONS, DriveBench
from tests.contract.script import run
from tests.contract.through import master_through_gateway, table_of
from tests.fuzz import line as fuzz_line
from tests.fuzz import targets
from tests.fuzz.targets import TARGETS
from tests.ledger import world as ledger_world
from tests.ledger.events import Book
from tests.ledger.ledger import Ledger
from tests.ledger.world import SETUPS, World
from tests.verify import explore
from tests.verify.designs import BY_NAME
from tests.verify.errors import BrokenRuleError
from tests.verify.wires import world_of

FAULT_SHARE: Final = 0.05
WORLD_EVENTS: Final = 300
Note = Callable[[str], None]


def session_names() -> list[str]:
    """Return the sessions that controllers have with drives."""
    return [session.drive for session in SESSIONS]


def corpus() -> list[str]:
    """Return the inputs that the fuzzer has kept, each as TARGET/NAME."""
    return [f"{name}/{label}" for name in TARGETS for label in targets.corpus(name)]


def ledger(seed: int, requests: int) -> Iterator[str]:
    """Play every line of the ledger in virtual time, with faults."""
    lines: list[str] = []
    _hear_events(ledger_world, lines.append)
    _hear_ledger(lines.append)
    for setup in SETUPS:
        lines.append(f"line {setup.name}")
        book = Book(seed, stops_at_first=False)
        World(setup, seed, book, FAULT_SHARE).run(requests // len(SETUPS))
        lines += (f"count {name} {count}" for name, count in sorted(book.seen.items()))
        lines += (f"violation {name} {count}" for name, count in sorted(book.violations.items()))
        yield from lines
        lines.clear()


def session(name: str) -> Iterator[str]:
    """Have a controller speak to a drive through the gateway: real cables, the time of the script."""
    (found,) = (each for each in SESSIONS if each.drive == name)

    async def played() -> list[str]:
        async with AsyncExitStack() as exits:
            bench = DriveBench(found, exits)
            master = await master_through_gateway(bench, exits, table_of(0.3, -0.2, 0.001))
            said = await run(found, master, bench.clock)
            return [*(f"{asked} = {answer}" for asked, answer in said), *(str(move) for move in bench.moves)]

    yield from asyncio.run(played())


def fuzzed(name: str) -> Iterator[str]:
    """Give one input of the corpus to its target."""
    lines: list[str] = []
    _hear_events(fuzz_line, lines.append)
    _hear_fuzz(lines.append)
    target, _, label = name.partition("/")
    TARGETS[target].run(targets.corpus(target)[label])
    yield from lines
    yield "taken"


def plans() -> list[str]:
    """Return what configurations are compiled of: one with every key, and one for each drive profile."""
    return ["every-key", *names()]


def plan(name: str) -> Iterator[str]:
    """Compile a configuration; yield the plan that is made of it, a line for each value."""
    text = Path(__file__).with_name("every_key.toml").read_text()
    if name != "every-key":
        text = text.partition("[axis.y]")[0]
        kept = [line for line in text.splitlines() if not line.startswith(("registers.", "unmapped"))]
        text = "\n".join(kept).replace('units = "mm"', f'units = "mm"\ndrive = "{name}"', 1)
    with TemporaryDirectory() as folder:
        path = Path(folder, "gateway.toml")
        path.write_text(text)
        try:
            found = load(path).plan
        except ConfigErrors as errors:
            yield from (f"refused {problem.key}" for problem in errors.problems)
            return
        yield from _leaves("plan", found)


def _leaves(path: str, value: Any) -> Iterator[str]:
    fields = getattr(value, "__dataclass_fields__", None) or getattr(value, "__struct_fields__", None)
    if fields is not None and not isinstance(value, type):
        for name in (each for each in fields if not each.startswith("_")):
            yield from _leaves(f"{path}.{name}", getattr(value, name))
    elif isinstance(value, dict):
        for key, each in sorted(value.items(), key=str):
            yield from _leaves(f"{path}[{key}]", each)
    elif isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        for number, each in enumerate(value):
            yield from _leaves(f"{path}[{number}]", each)
    elif isinstance(value, frozenset):
        yield f"{path} = {sorted(map(str, value))}"
    else:
        yield f"{path} = {_plain(value)}"


def worlds() -> list[str]:
    """Return the names of the worlds of ``tests.verify``."""
    return sorted(BY_NAME)


def world(name: str) -> Iterator[str]:
    """Walk through a world at random, seeded by its name: events, frames, and what axes keep."""
    design, rng, lines = BY_NAME[name], random.Random(name), list[str]()
    played = world_of(design)
    explore.listen(played, lines.append)
    for _ in range(WORLD_EVENTS):
        events = played.happenings()
        if not events:
            break
        event = rng.choice(events)
        lines.append(str(event))
        try:
            played.happen(event)
        except BrokenRuleError as violation:
            lines.append(f"broken: {violation}")
            break
        played.keep()
        if design.has_record:
            lines += (f"record {plan.name} {played.records.read(plan.name)}" for plan in design.plans)
        yield from lines
        lines.clear()
    yield from lines


def _hear_events(module: Any, note: Note) -> None:
    """Have the lines that a module makes tell their events here, too."""

    name = "BookedLine" if hasattr(module, "BookedLine") else "LineExchange"
    kind = getattr(module, name)

    def made(plans: Any, timing: Any, link: Any, tell: Callable[[Any], None], **more: Any) -> LineExchange:
        def told(event: Any) -> None:
            fields = sorted(
                (name, _plain(value)) for name, value in _fields(event).items() if name != "detail"
            )
            note(f"event {fields}")
            note(f"sentence {event.kind.name}: {event.detail}")
            tell(event)

        line: LineExchange = kind(plans, timing, link, told, **more)
        return line

    setattr(module, name, made)


def _fields(event: Any) -> dict[str, Any]:
    names = (
        getattr(event, "_fields", None)
        or getattr(event, "__dataclass_fields__", None)
        or event.__struct_fields__
    )
    return {name: getattr(event, name) for name in names}


def _plain(value: Any) -> str:
    """Return a value as it is told: of an enum its value, of an entry of the catalogue its name."""
    return value.name if isinstance(value, EventEntry) else str(getattr(value, "value", value))


def _hear_ledger(note: Note) -> None:
    arrived, sent, delivering = Ledger.arrived, Ledger.sent, Ledger.delivering
    abandoned, dropping, replied = Ledger.abandoned, Ledger.dropping, Ledger.replied

    def on_arrived(  # noqa: PLR0917 - as the ledger has it
        self: Any, controller: Any, transaction_id: int, unit: int, pdu: bytes, written_ns: int
    ) -> Any:
        note(f"{self.clock.now_ns} {controller.name} #{transaction_id} asks {unit} {pdu.hex(' ')}")
        return arrived(self, controller, transaction_id, unit, pdu, written_ns)

    def on_sent(self: Any, unit: int, pdu: bytes, **more: Any) -> Any:
        note(f"{self.clock.now_ns} to drive {unit} {pdu.hex(' ')} {sorted(more.items())}")
        return sent(self, unit, pdu, **more)

    def on_delivering(self: Any, pdu: bytes, answered: Any) -> None:
        note(f"{self.clock.now_ns} from drive {pdu.hex(' ')}")
        delivering(self, pdu, answered)

    def on_abandoned(self: Any, **more: Any) -> None:
        note(f"{self.clock.now_ns} given up {sorted(more.items())}")
        abandoned(self, **more)

    def on_dropping(self: Any) -> None:
        note(f"{self.clock.now_ns} line down")
        dropping(self)

    def on_replied(self: Any, controller: Any, transaction_id: int, unit: int, pdu: bytes) -> None:
        note(f"{self.clock.now_ns} {controller.name} #{transaction_id} is answered {unit} {pdu.hex(' ')}")
        replied(self, controller, transaction_id, unit, pdu)

    for name, heard in (
        ("arrived", on_arrived), ("sent", on_sent), ("delivering", on_delivering),
        ("abandoned", on_abandoned), ("dropping", on_dropping), ("replied", on_replied),
    ):  # fmt: skip
        setattr(Ledger, name, heard)


def _hear_fuzz(note: Note) -> None:
    send_request, send_reply = fuzz_line.Drives.send_request, fuzz_line.Controller.send_reply

    def on_request(self: Any, unit_id: int, pdu: bytes) -> None:
        note(f"to drive {unit_id} {pdu.hex(' ')}")
        send_request(self, unit_id, pdu)

    def on_reply(self: Any, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        note(f"{self.plan.name} #{transaction_id} is answered {unit_id} {pdu.hex(' ')}")
        send_reply(self, transaction_id, unit_id, pdu)

    fuzz_line.Drives.send_request = on_request  # type: ignore[method-assign]
    fuzz_line.Controller.send_reply = on_reply  # type: ignore[method-assign]
