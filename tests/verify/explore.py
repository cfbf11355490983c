"""Walks a world: every event in every state, breadth first, until nothing is new; then random steps."""

import time
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from random import Random
from typing import Any, Final

from gateway.exchange.axis.impossible import raise_them
from tests.verify.errors import BrokenRuleError
from tests.verify.rules import is_settled
from tests.verify.snapshot import TAKEN, watch_tables
from tests.verify.wires import BytesSide, world_of
from tests.verify.world import START_NS, Design, Happening, Kept, World

LOOK_EVERY: Final = 64
"""States between two looks at the clock."""
KINDLY: Final = frozenset(
    {"ask", "drive", "arrive", "wait", "plug", "homed", "done", "undone", "late", "tail", "reply_tail"}
)
"""Events of which a way back may consist: traffic, a drive that does what it is told, time."""
BY_A_PERSON: Final = frozenset({"declare", "switch", "end_dry_run"})
UNKIND: Final = frozenset({"refuse", "obey", "obey-refuse", "garble"})
SETTLE: Final = ("settle",)
"""On a way: the drive acknowledges until nothing is on the wire any more."""
DEAD_END: Final = "nothing can happen any more: a world with an end proves less than it seems to (10)"
MOST_STEPS: Final = 200
RANDOM_STEPS: Final = 60
"""Of one random walk, before the next one begins."""


@dataclass
class Broken:
    """A rule that was broken, and the shortest way there that was found."""

    what: str
    trace: tuple[Happening, ...]


@dataclass
class Outcome:
    """What a walk has shown."""

    world: str
    states: int = 0
    transitions: int = 0
    depth: int = 0
    seconds: float = 0.0
    is_closed: bool = False
    random_steps: int = 0
    settled: int = 0
    """States in which all is as it should be."""
    without_way_back: int = 0
    broken: list[Broken] = field(default_factory=list)
    met: dict[str, int] = field(default_factory=dict)
    """Events of the gateway, refusals, rows of the table of whereabouts, ends of what was cut through."""
    stop_ticks: int = 0
    digest: str = ""
    """Of all that left, was answered and was told."""

    def add(self, other: "Outcome") -> None:
        """Add what another walk through the same world has shown."""
        self.random_steps += other.random_steps
        self.seconds += other.seconds
        self.broken += other.broken
        self.met |= other.met
        self.stop_ticks = max(self.stop_ticks, other.stop_ticks)
        self.digest += other.digest

    @property
    def rate(self) -> float:
        """Transitions a second."""
        return (self.transitions + self.random_steps) / self.seconds if self.seconds else 0.0


def is_kindly(event: Happening) -> bool:
    """Whether an event may be part of a way back (6)."""
    if event[0] == "drive":
        return event[1] not in UNKIND
    return event[0] in KINDLY or event[0] in BY_A_PERSON


class Walk:
    """One walk through one world."""

    def __init__(self, design: Design, *, most_broken: int = 1) -> None:
        raise_them()
        watch_tables()
        TAKEN.clear()
        self.world = world_of(design)
        self.outcome = Outcome(design.name)
        self._most_broken = most_broken
        self._numbers: dict[bytes, int] = {}
        self._parents = array("i")
        self._events = array("H")
        self._event_numbers: dict[Happening, int] = {}
        self._edges_from = array("i")
        self._edges_to = array("i")
        self._settled = bytearray()
        self._whats: Counter[str] = Counter()
        self._first = self.world.keep()

    def breadth_first(self, depth: int = 0, seconds: float = 0.0) -> Outcome:
        """Walk until nothing is new, to a depth, or for so long; 0: without that limit."""
        world, outcome, numbers = self.world, self.outcome, self._numbers
        parents, events, event_numbers = self._parents, self._events, self._event_numbers
        began = time.process_time()
        first = self._first
        world.restore(first, is_live_known=False)
        self._note(world.key(first), -1, 0)
        level: list[tuple[Kept, int]] = [(first, 0)]
        following: list[tuple[Kept, int]] = []
        tried: set[Happening] = set()
        is_out_of_time = False
        checks_way_back = world.design.checks_way_back
        from_, to = self._edges_from, self._edges_to
        while level and not is_out_of_time:
            if depth and outcome.depth >= depth:
                break
            for count, (kept, number) in enumerate(level):
                if seconds and not count % LOOK_EVERY and time.process_time() - began > seconds:
                    is_out_of_time = True
                    break
                world.restore(kept)
                happenings = world.happenings()
                if not happenings and self._is_enough(DEAD_END, self._trace(number)):
                    is_out_of_time = True
                tried.update(happenings)
                for event in happenings:
                    world.restore(kept)
                    outcome.transitions += 1
                    try:
                        world.happen(event)
                        after = world.keep()
                    except BrokenRuleError as violation:
                        world.restore(kept, is_live_known=False)
                        if self._is_enough(str(violation), (*self._trace(number), event)):
                            is_out_of_time = True
                            break
                        continue
                    key = world.key(after)
                    at = numbers.get(key)
                    if at is None:
                        event_number = event_numbers.setdefault(event, len(event_numbers))
                        at = self._note(key, number, event_number)
                        following.append((after, at))
                    if checks_way_back and is_kindly(event):
                        from_.append(number)
                        to.append(at)
                if is_out_of_time:
                    break
            else:
                outcome.depth += 1
                level, following = following, []
        outcome.states = len(parents)
        outcome.is_closed = not level and not following
        self._check_all_tried(tried)
        self._check_way_back()
        outcome.seconds += time.process_time() - began
        self._sum_up()
        assert len(events) == len(parents)
        return outcome

    def along(self) -> Outcome:
        """Walk the traces that the world declares, with each event in each state on them."""
        world, outcome = self.world, self.outcome
        began = time.process_time()
        for way in world.design.ways:
            world.restore(self._first, is_live_known=False)
            trace: list[Happening] = []
            steps = deque(way)
            while steps:
                event = steps.popleft()
                if event == SETTLE:
                    if world.state.wire is None or len(trace) > MOST_STEPS:
                        continue
                    steps.appendleft(SETTLE)
                    event = ("drive", "ack")
                kept = world.keep()
                others = world.happenings()
                try:
                    if event not in others:
                        raise BrokenRuleError(f"{event} cannot happen on a way that has to be possible (10)")
                    for each in (*(other for other in others if other != event), event):
                        world.restore(kept, is_live_known=False)
                        outcome.transitions += 1
                        trace.append(each)
                        world.happen(each)
                        if each != event:
                            trace.pop()
                except BrokenRuleError as violation:
                    if self._is_enough(str(violation), tuple(trace)):
                        steps.clear()
                        break
                    world.restore(kept, is_live_known=False)
                    break
            if len(outcome.broken) >= self._most_broken:
                break
        world.restore(self._first, is_live_known=False)
        outcome.seconds += time.process_time() - began
        return outcome

    def random(self, steps: int, seed: int = 1, seconds: float = 0.0) -> Outcome:
        """Take random steps from the start, again and again."""
        world, outcome, random = self.world, self.outcome, Random(seed)
        began = time.process_time()
        first, trace, known = self._first, list[Happening](), len(outcome.broken)
        for step in range(steps):
            if seconds and not step % LOOK_EVERY and time.process_time() - began > seconds:
                break
            if step % RANDOM_STEPS == 0:
                world.restore(first, is_live_known=False)
                trace = []
            outcome.random_steps += 1
            try:
                happenings = world.happenings()
                if not happenings:
                    raise BrokenRuleError(DEAD_END)
                event = random.choice(happenings)
                trace.append(event)
                world.happen(event)
            except BrokenRuleError as violation:
                if self._is_enough(str(violation), tuple(trace)):
                    break
                world.restore(first, is_live_known=False)
                trace = []
        outcome.broken[known:] = [shortened(world.design, each) for each in outcome.broken[known:]]
        outcome.seconds += time.process_time() - began
        self._sum_up()
        return outcome

    def _note(self, key: bytes, parent: int, event: int) -> int:
        number = self._numbers[key] = len(self._parents)
        self._parents.append(parent)
        self._events.append(event)
        self._settled.append(is_settled(self.world))
        return number

    def _trace(self, number: int) -> tuple[Happening, ...]:
        by_number = {n: event for event, n in self._event_numbers.items()}
        found: deque[Happening] = deque()
        while self._parents[number] >= 0:
            found.appendleft(by_number[self._events[number]])
            number = self._parents[number]
        return tuple(found)

    def _is_enough(self, what: str, trace: tuple[Happening, ...]) -> bool:
        kind = _kind(what)
        self._whats[kind] += 1
        if self._whats[kind] == 1:
            self.outcome.broken.append(Broken(what, trace))
        return len(self.outcome.broken) >= self._most_broken

    def _check_all_tried(self, tried: set[Happening]) -> None:
        """Look whether all that a closed world declares can happen in it: else it proves too little."""
        design, outcome = self.world.design, self.outcome
        if outcome.is_closed and not outcome.broken:
            missing = {*design.menu, *design.answers, *design.happenings}.difference(*tried)
            if missing:
                what = f"declared, and can never happen: {', '.join(sorted(missing))} (10)"
                outcome.broken.append(Broken(what, ()))

    def _check_way_back(self) -> None:
        """Look whether every state has a way to one in which all is as it should be (6)."""
        outcome = self.outcome
        outcome.settled = sum(self._settled)
        if not (self.world.design.checks_way_back and outcome.is_closed) or outcome.broken:
            return
        count = len(self._parents)
        starts = array("i", bytes(4 * (count + 1)))
        for at in self._edges_to:
            starts[at + 1] += 1
        for at in range(count):
            starts[at + 1] += starts[at]
        places, before = starts[:], array("i", bytes(4 * len(self._edges_to)))
        for one, other in zip(self._edges_from, self._edges_to, strict=True):
            before[places[other]] = one
            places[other] += 1
        is_reached = bytearray(self._settled)
        queue = deque(i for i, is_one in enumerate(is_reached) if is_one)
        while queue:
            at = queue.popleft()
            for i in range(starts[at], starts[at + 1]):
                if not is_reached[before[i]]:
                    is_reached[before[i]] = 1
                    queue.append(before[i])
        outcome.without_way_back = count - sum(is_reached)
        if outcome.without_way_back:
            trace = self._trace(is_reached.index(0))
            outcome.broken.append(Broken("no way leads back to settled, referenced, corrected (6)", trace))

    def _sum_up(self) -> None:
        tally, outcome = self.world.tally, self.outcome
        tally.rows |= TAKEN
        outcome.stop_ticks, outcome.digest = tally.stop_ticks, tally.digest
        outcome.met = dict.fromkeys((f"event {each}" for each in sorted(tally.events)), 1)
        outcome.met |= dict.fromkeys((f"exception {each:#04x}" for each in sorted(tally.refusals)), 1)
        outcome.met |= dict.fromkeys((f"row {each}" for each in sorted(tally.rows)), 1)
        outcome.met |= dict.fromkeys((f"cut {each}" for each in sorted(tally.cuts)), 1)


def replay(design: Design, trace: tuple[Happening, ...]) -> Iterator[str]:
    """Play a trace again; tell with each event what went over the wires. The last line is what was broken."""
    world = world_of(design)
    lines: list[str] = []
    listen(world, lines.append)
    for event in trace:
        yield f"{(world.now_ns - START_NS) // 1_000_000:6d} ms  {' '.join(map(str, event))}"
        try:
            world.happen(event)
        except BrokenRuleError as violation:
            yield from lines
            yield f"broken: {violation}"
            return
        yield from lines
        lines.clear()


def shortened(design: Design, broken: Broken, *, passes: int = 6) -> Broken:
    """Return a shorter trace to the same broken rule: events are left out, first many in a row, then few.

    What is left may not be the shortest there is; leaving any one event or any two neighbours out mends it.
    """
    kind, world = _kind(broken.what), world_of(design)
    first = world.keep()
    best = broken
    for _ in range(passes):
        before, size = best, max(1, len(best.trace) // 2)
        while size:
            at = 0
            while at < len(best.trace):
                shorter = best.trace[:at] + best.trace[at + size :]
                world.restore(first, is_live_known=False)
                found = broken_by(world, shorter)
                if found is not None and _kind(found.what) == kind:
                    best = found
                else:
                    at += 1
            size = size // 2 if size > 3 else size - 1
        if len(best.trace) == len(before.trace):
            break
    return best


def _kind(what: str) -> str:
    return "".join(each for each in what if not each.isdigit())


def broken_by(world: World, trace: tuple[Happening, ...]) -> Broken | None:
    """Play a trace as far as a rule breaks; None where it cannot happen, or breaks none."""
    for count, event in enumerate(trace, 1):
        if event not in world.happenings():
            return None
        try:
            world.happen(event)
        except BrokenRuleError as violation:
            return Broken(str(violation), trace[:count])
    return None


def listen(world: World, tell: Callable[[str], None]) -> None:
    """Tell of each frame and each answer as it goes, but for those that are cut through."""
    side = world.sides[0]
    send = side.link.send_request
    line: Any = side.line if isinstance(side, BytesSide) else side
    reply, request = line.reply, line.request

    def sent(unit_id: int, pdu: bytes) -> None:
        tell(f"             to the drive    {unit_id}  {pdu.hex(' ')}")
        send(unit_id, pdu)

    def replied(unit_id: int, pdu: bytes, now_ns: int) -> None:
        tell(f"             from the drive  {unit_id}  {pdu.hex(' ')}")
        reply(unit_id, pdu, now_ns)

    def requested(
        port: object, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int, **why: str
    ) -> None:
        tell(f"             asked           {unit_id}  {pdu.hex(' ')}")
        request(port, transaction_id, unit_id, pdu, now_ns, **why)

    side.link.send_request = sent  # type: ignore[method-assign]
    line.reply, line.request = replied, requested
    for number, port in enumerate(side.ports):
        outlet, name = (side.pipes[number], "_take") if isinstance(side, BytesSide) else (port, "send_reply")
        answer = getattr(outlet, name)

        def answered(
            transaction_id: int, unit_id: int, pdu: bytes, answer: Callable[[int, int, bytes], None] = answer
        ) -> None:
            tell(f"             answered        {unit_id}  {pdu.hex(' ')}")
            answer(transaction_id, unit_id, pdu)

        setattr(outlet, name, answered)


def as_test(design: Design, broken: Broken) -> str:
    """Return a trace as a test that can be pasted: it fails as long as the rule is broken."""
    played = "\n".join(f"    # {line}" for line in replay(design, broken.trace))
    events = "\n".join(f"        {event!r}," for event in broken.trace)
    name = design.name.replace("-", "_")
    return f"""
def test_found_in_{name}() -> None:
{played}
    play(
        BY_NAME["{design.name}"],
{events}
    )
"""


def play(design: Design, *trace: Happening) -> World:
    """Play a trace; raises BrokenRuleError where it breaks a rule."""
    world = world_of(design)
    for event in trace:
        if event not in world.happenings():
            raise AssertionError(f"{event} cannot happen here; there are {world.happenings()}")
        world.happen(event)
        world.keep()
    return world
