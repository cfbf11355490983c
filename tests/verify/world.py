"""A small world around a line: controllers, a drive that is told what it does with each frame, and time.

Everything that can happen is an *event*, a short tuple of words and numbers. A world says which events can
happen now, does one, and holds it against the rules (``tests.verify.rules``). Between two events all there is
to know is a state: the line's (``tests.verify.snapshot``) and the world's own, a tuple that never changes.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any, Final, NamedTuple

from gateway.compensation.table import CorrectionTable
from gateway.exchange.axis.record_layout import BOOT, HEADER, SLOT_SIZE, SLOTS_AT
from gateway.exchange.commands import (
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
)
from gateway.exchange.control import ControlError
from gateway.exchange.events import Event
from gateway.exchange.gate import UNSEEN
from gateway.exchange.line import LineExchange
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming
from gateway.exchange.ports import ControllerPort, DriveLink
from gateway.exchange.transaction import Stopping
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from gateway.modbus.registers import PositionField
from tests.exchange.line_bench import ACTUAL, COMMAND, MS, read, write
from tests.exchange.record_bench import Records
from tests.exchange.staged_bench import (
    ALARM_BIT,
    COMMANDED,
    DONE_BIT,
    HOME,
    HOMED_BIT,
    JOG,
    MODE,
    MOVING_BIT,
    RUN,
    RUN_RELATIVE,
    STATUS,
    STOP,
    STORED,
    TRIGGER,
    ZERO,
)
from tests.verify import facts, gantries, rules
from tests.verify.errors import BrokenRuleError
from tests.verify.facts import Facts
from tests.verify.gantries import Gantry
from tests.verify.rules import BOTH, LIMIT, LIMIT_COUNTS, MASK, OLD_TICKS, PATIENCE_TICKS, WARM
from tests.verify.screw import REGROUND, WORN, Screw
from tests.verify.snapshot import (
    Lens,
    OnItsWay,
    Said,
    Snapshot,
    is_resting,
    is_sending_unsure,
    on_its_way,
    refused,
    said,
    said_of,
    stopping_of,
    watch_stores,
)

TICK_MS: Final = 80
"""All times of a world are whole ticks. None of the gateway's own constants is one: 100, 200 and 500 ms."""
TICK_NS: Final = TICK_MS * MS
START_NS: Final = 2 * 10**17
HORIZON_TICKS: Final = 4
"""Nothing in a world asks whether something is older."""
RESPONSE_TICKS: Final = 1
DRAIN_TICKS: Final = 1
DONE_DROP_TICKS: Final = 1
UNSEEN_TICKS: Final = 2
LOST_TICKS: Final = 2
TIMING: Final = LineTiming(
    response_timeout_ms=RESPONSE_TICKS * TICK_MS, drain_ms=DRAIN_TICKS * TICK_MS, retry_ms=0.0
)
EXCEPTION: Final = 4
VENDOR: Final = 0x81
"""The function byte of whatever a certain drive refuses."""
MOST_STORES: Final = 3
"""Stores within one event that a kill may come before."""
SCREWS: Final = (WORN, REGROUND)
ON_THE_WAY_COUNTS: Final = (1501, 9060)
WARMER_K: Final = 20.0
Bytes = Callable[[bytes], None]
Happening = tuple[Any, ...]


class Port(ControllerPort):
    """A controller that keeps what it is answered."""

    def __init__(self, plan: ControllerPlan) -> None:
        super().__init__(plan)
        self.replies: list[tuple[int, bytes]] = []

    def send_reply(self, transaction_id: int, unit_id: int, pdu: bytes) -> None:
        """Keep a reply."""
        self.replies.append((transaction_id, pdu))


class Link(DriveLink):
    """The way to the drive."""

    def __init__(self, *, is_serial: bool) -> None:
        super().__init__(is_serial=is_serial)
        self.sent: list[tuple[int, bytes]] = []
        self.is_abandoned = False

    def send_request(self, unit_id: int, pdu: bytes) -> None:
        """Keep a frame."""
        self.sent.append((unit_id, pdu))

    def abandon(self) -> None:
        """Note that a reply comes too late from now on."""
        self.is_abandoned = True


class Side:
    """One gateway with its ports and its link. A world has two where two ways through it are compared."""

    def __init__(self, design: "Design", ways: dict[str, int], tell: Callable[[Event], None]) -> None:
        self.link = Link(is_serial=design.is_serial)
        ports = [Port(plan) for plan in design.controllers]
        self.ports: list[Any] = ports
        self.replies = [port.replies for port in ports]
        """What each controller was answered since that was looked at, with the numbers of its requests."""
        timeout_ms = design.response_ticks * TICK_MS
        timing = replace(TIMING, response_timeout_ms=timeout_ms, retry_ms=design.retry_ms)
        self.line = LineExchange(design.plans, timing, self.link, tell, design.groups, **ways)  # type: ignore[arg-type]
        self.lens = Lens(
            [self.line, *self.ports], TICK_NS, design.horizon_ticks, has_record=design.has_record
        )

    def request(self, port: int, transaction_id: int, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """A controller asks."""
        self.line.request(self.ports[port], transaction_id, unit_id, pdu, now_ns)

    def reply(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """The drive answers what is on the wire."""
        self.line.reply(unit_id, pdu, now_ns)

    def stray(self, unit_id: int, pdu: bytes, now_ns: int) -> None:
        """The drive answers something else."""
        self.line.stray(now_ns, unit_id=unit_id)

    def gone(self, port: int, now_ns: int) -> None:
        """A controller closes its connection, and opens another one."""
        self.line.controller_gone(self.ports[port], now_ns)
        self.ports[port].gate = UNSEEN

    def forget(self) -> None:
        """Nothing has left and nothing was answered."""
        self.link.sent.clear()
        self.link.is_abandoned = False
        self.forget_replies()

    def forget_replies(self) -> None:
        """Nothing was answered."""
        for replies in self.replies:
            replies.clear()


class Aim(NamedTuple):
    """What a frame that makes an axis move is meant to do, as it stood when it was sent."""

    nominal_counts: int
    from_counts: int
    """Where the drive stood."""
    state: str
    """What the gateway said of the compensation."""
    is_unsure: bool
    table: int
    is_gain_half: bool = False
    is_lost: bool = False
    """Its target never was acknowledged."""
    base: tuple[int, bool] | None = None
    """Of a distance: where it starts in nominal counts, and whether that is certain."""
    arrived: "Run | None" = None
    """The motion at whose end it stood, as it was told."""
    tried: "Tried | None" = None
    """The target that nobody had acknowledged until then."""
    others: tuple[tuple[str, int, bool], ...] = ()
    """Of a beam of which nobody can say whether a new round has begun: state, table and gain that may be in
    force as well."""


class Wire(NamedTuple):
    """The frame that the drive has and has not answered."""

    unit_id: int
    pdu: bytes
    owner: int
    """The port that asked for it; -1: the gateway's own."""
    transaction_id: int
    aim: Aim | None
    request: bytes = b""
    """What its controller asked for."""
    is_obeyed: bool = False
    ticks_left: int = 0
    """Of a frame that nobody waits for any more: so long it may still be answered."""
    sent_ns: int = 0
    is_early: bool = False
    """A stop that left while a late reply might come: only its exact echo is its answer."""


class Asked(NamedTuple):
    """A request that its controller waits for."""

    pdu: bytes
    transaction_id: int
    is_sent: bool = False
    ticks: int = 0
    restaged_peers: tuple[tuple[int, tuple[str, int, bool]], ...] = ()
    """The same of the other axes of its group, for the first trigger of which that is done (M11)."""
    restaged: tuple[str, int, bool] | None = None
    """What was in force when its target was written anew for it: state of the compensation, table, half a
    gain. With that it runs, whatever is changed before it has left."""
    is_bit_asked: bool = False
    """The bit on which its reference hangs was read for it."""
    axis: int = 0
    is_broadcast: bool = False
    goes_again: bool = False
    """A stop that left early and was not answered."""
    is_owed: bool = False
    """Its drive owed a silence when it came, or since."""


class Belief(NamedTuple):
    """What a controller believes to stand in the target register."""

    low: int = 0
    high: int = 0
    lost: int = 3
    """Bit 0, 1: the low, the high word was lost, or never written; bit 2: some word was lost, on its way; bit
    3: one was refused, with proof that nothing was written."""
    ticks: int = OLD_TICKS
    """Since then."""

    @property
    def steps(self) -> int:
        """The target, in steps of its register."""
        value = self.high << 16 | self.low
        return value - (1 << 32) if value >> 31 else value


class Tried(NamedTuple):
    """A target that was sent and not acknowledged: the drive may hold it."""

    nominal_counts: int
    end_counts: int
    table: int
    state: str
    is_gain_half: bool
    """With the two before: the correction that made these words, which may be an older one (M4)."""


class Run(NamedTuple):
    """The last motion to a target."""

    nominal_counts: int
    end_counts: int
    is_told: bool = False
    """The gateway had its acknowledgement, and has no reason to have forgotten it."""
    is_unsure: bool = False
    table: int = 0
    state: str = ""
    is_restarted: bool = False
    """The gateway was killed since, and its record with it."""
    is_gain_half: bool = False
    seen: int = 0
    """Since it was told, while it stood there: bit 0, its place was read; bit 1, its drive said done."""
    is_recalled: bool = False
    """The gateway was killed since and has its record: it is told again as soon as the axis is seen there."""
    is_open: bool = False
    """It is recalled, a distance, and until it was seen at its end twice nobody knows that it ran (M5)."""
    is_done_since: bool = False
    """Its drive has said done since."""
    lost_ns: int = 0
    """When a distance from its end went without an answer; 0: none did."""
    is_acked: bool = False
    """It is told, whatever its done bit says."""
    has_blinked: bool = False
    """It was told, and its done bit fell since where it stands."""
    is_held: bool = False
    """Its drive acknowledged it, and nothing else than a reference that was lost can have come since."""
    is_set_out: bool = False
    """It was known where the axis stood, and on which side, when it set out."""
    kept_seen: int = 0
    """Of ``seen``, what its record keeps over a kill."""
    was_lost: bool = False
    """It passed 1:1, and nobody but its drive knows what was held when it was triggered."""
    uncertainty: int = 0
    """1: its drive has said done; 2: and that where it did not stand, or not any more: a look tells more
    (M6). Over repeats, too; kept only where a done bit may do so."""


class Axis(NamedTuple):
    """One axis as it is."""

    stands_counts: int = 0
    goes_counts: int | None = None
    target_counts: int = 0
    """What stands in the target register."""
    commanded_counts: int = 0
    is_done: bool = True
    is_homed: bool = True
    ticks: int = 0
    """Since it began to move."""
    run: Run | None = None
    is_alarmed: bool = False
    mode: int = 1
    """What stands in its mode register: 1, a target is absolute; 2, it is a distance, once."""
    is_fresh: bool = True
    """Since the start, or since it counts from another zero, it was told no target."""
    was_done: bool = False
    """Its drive had said done of its last motion before the bit fell."""
    is_lost_distance: bool = False
    """It goes a distance of which nobody knows whether it was obeyed."""
    is_known_moving: bool = False
    """Its drive has said so since."""
    is_owed_look: bool = False
    """Somebody was told that it is not done any more, and nobody has read where it is since."""
    is_seen_undone: bool = False
    """It stood while somebody was told that it is not done."""
    has_crept: bool = False
    """It went elsewhere while its done bit was down, and nobody has read where it is since."""
    tried: Tried | None = None
    """The last target on its way that was not acknowledged."""
    facts: Facts | None = None
    limit_counts: int = 0
    """What stands in the register of a position that the drive compares its own with."""
    told_limit_counts: int | None = None
    """What its controller has written there; None: that is not known."""
    next_run: Run | None = None
    """Where it goes as soon as it has come where it goes."""
    stopped: Run | None = None
    """The motion on whose way it was stopped: so the side from which it came there is known (M6)."""
    trigger: int = 0
    """What stands in its trigger, where that acts only as it rises."""
    knows_rules: bool = False
    """The gateway was told what that holds, or its mode register."""
    held: Tried | None = None
    """The target that it was told, over being switched off and on, until something is written to it."""
    hush_ticks: int = 0
    """So long the line waits for a late frame of its drive."""
    unasked: int = 0
    """Reads that were answered at once meanwhile, and not sent."""
    read_counts: int | None = None
    """Where it was read last; None: never, or another zero counts since."""


class State(NamedTuple):
    """All of a world but its gateway."""

    axes: tuple[Axis, ...]
    beliefs: tuple[tuple[Belief, ...], ...]
    """By controller and axis."""
    asked: tuple[tuple[Asked, ...], ...]
    """By controller."""
    order: tuple[tuple[int, int], ...] = ()
    """Controller and number of each of these, in the order in which they came."""
    wire: Wire | None = None
    late: Wire | None = None
    is_up: bool = True
    is_starting: bool = True
    """The gateway may read where its axes stand."""
    table: int = 0
    is_wanted: bool = True
    is_gain_half: bool = False
    owed_stops: int = 0
    """Stops whose controllers have given up: they go out all the same."""
    given_up: tuple[tuple[int, int], ...] = ()
    """Controller and number of requests that the gateway may still have waiting, for nobody."""
    half: tuple[Any, ...] = ()
    """A request of which a part has come: its words in the menu, and since how many ticks."""
    come: int = 0
    """How many bytes of it have come."""
    split: tuple[int, bytes] | tuple[()] = ()
    """The unit id and the rest of a reply of which a part has come."""
    reply_come: int = 0
    """How many bytes of that reply have come, where replies are cut through."""
    gantry: Gantry | None = None
    """What the first trigger of its group has fixed."""
    owed: tuple[tuple[str, str], ...] = ()
    """Axis and event that is told with the next answer."""
    is_cut_off: bool = False
    """A silence has come into the middle of that reply."""
    is_misled: bool = False
    """A reply of another size has come for the frame on the wire, which may be that of another one."""
    before: bytes = b""
    """What the drive has answered last, where it may say that once more."""


@dataclass(frozen=True)
class Design:
    """What a world is made of."""

    name: str
    about: str
    plans: tuple[AxisPlan, ...]
    menu: tuple[str, ...]
    """What a controller may ask for."""
    answers: tuple[str, ...] = ("ack", "refuse", "obey")
    """What the drive may do with a frame."""
    happenings: tuple[str, ...] = ("arrive", "wait")
    targets: tuple[int, ...] = (-7003, 9007, 9019)
    distances: tuple[int, ...] = (4003, -4003)
    masks: tuple[tuple[int, int], ...] = ((0xFF00, 0x003B),)
    """What is kept of the low word of a target, and what is set of the rest of it."""
    controllers: tuple[ControllerPlan, ...] = (ControllerPlan("cnc", timeout_ms=PATIENCE_TICKS * TICK_MS),)
    groups: tuple[tuple[str, ...], ...] = ()
    is_serial: bool = True
    is_staged: bool = False
    has_record: bool = False
    is_twin: bool = False
    response_ticks: int = RESPONSE_TICKS
    """So long the gateway waits for an answer."""
    jog_is_jump: bool = False
    """Whoever sees an axis jogged, or just arrived, may doubt its reference: it cannot go so fast (M9)."""
    is_stream: bool = False
    """Its targets are setpoints of a stream."""
    refuses_reads: bool = False
    is_answered: bool = False
    """The drive answers before a tick has passed: silence is the business of other worlds."""
    is_in_position: bool = False
    """The done bit says only that the drive is near where it is told to be at the moment: on its way, too."""
    is_bytes: bool = False
    """It begins at bytes: real ports and decoders of Modbus/TCP (``tests.verify.wires``)."""
    on_the_way_counts: tuple[int, ...] = ON_THE_WAY_COUNTS
    """Where an axis is seen on its way, the first of them that lies there."""
    drop_ticks: int = DONE_DROP_TICKS
    """So long after it was told to go its done bit may still be that of the motion before."""
    edge: str = ""
    """Its trigger acts only as it rises: a ``register``, or a ``coil``; else each write acts."""
    is_up_at_start: bool = False
    """Such a trigger is up when the gateway starts, which does not know that."""
    is_buffered: bool = False
    """The drive keeps a target that comes while it goes to another one, and goes there afterwards."""
    is_rtu: bool = False
    """The same of RTU (``tests.verify.wires_rtu``)."""
    is_cut: bool = False
    """Of RTU, and requests leave while they arrive (``tests.verify.wires_cut``)."""
    retry_ms: float = 0.0
    """After so long a drive is tried again that left three requests unanswered; 0: it is always asked."""
    late_ticks: int = DRAIN_TICKS
    """So long after it was given up a reply may come."""
    is_prompt: bool = True
    """A drive that is told to go has left its place a tick later."""
    most_asked: int = 1
    """Requests of one controller that may be open."""
    horizon_ticks: int = HORIZON_TICKS
    depth: int = 0
    """To which it is walked unless it closes before; 0: until it closes."""
    checks_way_back: bool = True
    judges_proof: bool = False
    """A reading that proves a target without an answer makes it told (M7): nothing else forgets it."""
    judges_blocks: bool = True
    """It is known at any moment whether a target was lost: nothing passes 1:1, and is refused unjudged."""
    ways: tuple[tuple[Happening, ...], ...] = ()
    """Traces that are walked first, with each event in each state on them."""
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def step_counts(self) -> int:
        """Counts in one step of a target's register."""
        return int(self.plans[0].command[0].scale)

    @property
    def answers_before(self) -> bool:
        """Whether the drive may answer the request before last."""
        return not set(BEFORE).isdisjoint(self.answers)

    @property
    def beside_counts(self) -> float:
        """The hysteresis: nearer to a branch nobody can tell a direction by a measured position."""
        settings = self.plans[0].settings
        return settings.hysteresis * abs(settings.counts_per_unit) + 1e-6

    def packed(self, counts: int) -> bytes:
        """Return the words of a target."""
        return self.plans[0].command[0].pack(counts // self.step_counts)

    def unpacked(self, words: bytes) -> int:
        """Return the target that stands in words."""
        return int(COMMAND.unpack(words)) * self.step_counts

    def written(self, counts: int, pdu: bytes) -> int:
        """Return what stands in the register of a target once a frame is obeyed that writes there."""
        words = bytearray(self.packed(counts))
        at = 2 * (rules.written_at(pdu) - COMMAND.address)
        data = rules.masked(bytes(words[at : at + 2]), pdu) if pdu[0] == MASK else rules.words_written(pdu)
        words[at : at + len(data)] = data
        return self.unpacked(bytes(words))

    @property
    def is_done_doubtful(self) -> bool:
        """Whether a done bit may come before the axis does, or fall where it stands."""
        return self.is_in_position or not {"done", "undone", "arrive_undone", "blink"}.isdisjoint(
            self.happenings
        )


@dataclass
class Tally:
    """What was met on the way, over all states."""

    rows: set[str] = field(default_factory=set)
    events: set[str] = field(default_factory=set)
    refusals: set[int] = field(default_factory=set)
    cuts: set[str] = field(default_factory=set)
    """How requests and replies ended of which bytes had left while they arrived."""
    stop_ticks: int = 0
    """The longest that a stop had to wait."""
    _passed: "blake2b" = field(default_factory=blake2b)

    def note(self, *what: object) -> None:
        """Take note of what left, was answered or was told: of all of it, in its order, a digest is kept."""
        self._passed.update(repr(what).encode())

    @property
    def digest(self) -> str:
        """The same where the same has left, was answered and was told, in the same order."""
        return self._passed.hexdigest()


class KilledError(Exception):
    """The gateway is killed at this very instant."""


class Kept(NamedTuple):
    """A state of a world that can be put back."""

    state: State
    now_ns: int
    lines: tuple[Snapshot, ...]
    records: tuple[bytes, ...]


PAGE: Final = 4096
WRITTEN: Final = 1024
"""So much of each page of a record is used."""


class World:
    """A line, its drive and its controllers."""

    def __init__(self, design: Design) -> None:
        self.design = design
        self.tally = Tally()
        per_mm = design.plans[0].settings.counts_per_unit
        thermal = design.plans[0].thermal
        warm = () if thermal is None else (WORN.longer(thermal.alpha * WARMER_K),)
        for cross in design.plans[0].cross:  # a straight line: so much at the target of the other axis
            warm = (WORN.beside(design.targets[0] / per_mm * cross.corrections[1] / cross.positions[1]),)
        self.screws: tuple[Screw, ...] = tuple(
            screw._replace(counts_per_mm=per_mm) for screw in (*SCREWS, *warm)
        )
        self._dies_at = 0
        self.now_ns = START_NS
        self.told: list[Event] = []
        """What was told since the last event of the world began."""
        self.refusals: list[int] = []
        """Exceptions since then that were the gateway's own."""
        self.before: tuple[Said, ...] = ()
        """What was said of each axis then."""
        self._said: tuple[Said, ...] = ()
        """The same as the last event has left it; empty: that is not known."""
        ways: list[dict[str, int]] = [{}, {"remembered_paths": 0}] if design.is_twin else [{}]
        self.reading_age_ns = 0
        """How long the reply that was given last had been on its way."""
        self.sides = [
            self.side_of(each, self._tell if i == 0 else _tell_nobody) for i, each in enumerate(ways)
        ]
        for side in self.sides[1:]:
            side.lens.share(self.sides[0].lens)
        self._fresh = [side.lens.take(self.now_ns) for side in self.sides]
        self.records = Records()
        ports, axes = len(design.controllers), len(design.plans)
        up = int(design.is_up_at_start)
        beginning = tuple(Axis(facts=facts.first(plan), trigger=up) for plan in design.plans)
        is_dry = any(plan.compensation is CompensationMode.SHADOW for plan in design.plans)
        self.state = State(beginning, ((Belief(),) * axes,) * ports, ((),) * ports, is_wanted=not is_dry)
        self._attach()
        self._call("link_up", self.now_ns)
        self._collect()

    def side_of(self, ways: dict[str, int], tell: Callable[[Event], None]) -> Side:
        """Return a gateway with its ports and its link."""
        return Side(self.design, ways, tell)

    # --- keeping, putting back, comparing --------------------------------------------------------------

    def keep(self) -> Kept:
        """Return the state as it is now."""
        lines = tuple([side.lens.take(self.now_ns) for side in self.sides])
        return Kept(self.state, self.now_ns, lines, self._record_bytes())

    def restore(self, kept: Kept, *, is_live_known: bool = True) -> None:
        """Put a state back. ``is_live_known``: nothing has happened since another was kept or put back."""
        self.state, self.now_ns, self._said = kept.state, kept.now_ns, ()
        for side, snapshot in zip(self.sides, kept.lines, strict=True):
            side.lens.restore(snapshot, is_live_known=is_live_known)
        if kept.records:
            pages = iter(kept.records)
            for buffer in self.records.buffers.values():
                for at in range(0, len(buffer), PAGE):
                    buffer[at : at + WRITTEN] = next(pages)

    def key(self, kept: Kept) -> bytes:
        """Return what states that cannot be told apart have in common."""
        lens = self.sides[0].lens
        key = kept.lines[0].key + lens.token(kept.state).to_bytes(4, "big")
        for name in self.records.buffers if self.design.has_record else ():
            found = self.records.read(name)
            key += lens.token(None if found is None else found._replace(generation=0)).to_bytes(4, "big")
            if (
                found is not None and found.unacknowledged is not None
            ):  # how old that is decides what proves it
                ticks = (kept.now_ns - found.unacknowledged.state.at_ns) // TICK_NS
                key += min(ticks, self.design.drop_ticks + 1).to_bytes(1, "big", signed=True)
        return key

    def parts(self) -> dict[str, int]:
        """Return what each attribute of the state is worth in a comparison, the gateway's and the world's."""
        lens = self.sides[0].lens
        found = lens.parts(self.now_ns)
        for name, value in zip(State._fields, self.state, strict=True):
            if name == "axes":
                for number, axis in enumerate(self.state.axes):
                    found |= {f"axis {number}.{n}": lens.token(v) for n, v in axis._asdict().items()}
            else:
                found[f"world.{name}"] = lens.token(value)
        return found

    def _record_bytes(self) -> tuple[bytes, ...]:
        if not self.design.has_record:
            return ()
        return tuple(
            bytes(buffer[at : at + WRITTEN])
            for buffer in self.records.buffers.values()
            for at in range(0, len(buffer), PAGE)
        )

    def _attach(self) -> None:
        if self.design.has_record:
            for side in self.sides:
                self.records.attach(side.line)
                for axis in side.line.axes:
                    watch_stores(axis, self._may_store)

    def _may_store(self) -> bool:
        """Die before the store that was chosen (``_on_kill_at``)."""
        if self._dies_at:
            self._dies_at -= 1
            if not self._dies_at:
                raise KilledError
        return True

    # --- what can happen -------------------------------------------------------------------------------

    def happenings(self) -> list[Happening]:
        """Return every event that can happen now."""
        design, state = self.design, self.state
        found: list[Happening] = []
        for port in range(len(design.controllers)):
            if len(state.asked[port]) < design.most_asked:
                found += [("ask", port, *each) for each in self._requests()]
            elif "disconnect" in design.happenings:
                found.append(("disconnect", port))
        if state.wire is not None and not state.wire.is_obeyed:
            is_read = state.wire.pdu[0] == 3
            may_be = ("ack", "refuse", "vendor") if design.refuses_reads else ("ack",)
            found += [
                ("drive", each)
                for each in design.answers
                if each not in BEFORE and (not is_read or each in may_be)
            ]
            if state.before and self._is_another(state.wire, state.before):
                found += [("drive", each) for each in BEFORE if each in design.answers]
        if state.late is not None and "late" in design.happenings:
            found.append(("late",))
        # A drive that always answers does so before time passes, unless it has obeyed and says nothing.
        is_silent = state.wire is not None and state.wire.is_obeyed and not state.split
        waits = design.is_answered and state.wire is not None and not is_silent
        for number, axis in enumerate(state.axes):
            found += [
                (each, number)
                for each in design.happenings
                if _can(each, axis) and not (waits and each in TAKES_TIME)
            ]
        for each in design.happenings:
            if each in OF_WORLD and OF_WORLD[each](state) and not (waits and each in TAKES_TIME):
                found.append((each,))
        if "kill_at" in design.happenings:
            found += self._kills_within(found)
        return found

    def _kills_within(self, found: list[Happening]) -> list[Happening]:
        """Return kills in the middle of what can happen: before each store, and with what had left or not."""
        within = [each for each in found if each[0] in ("ask", "drive")]
        return [
            ("kill_at", number, is_obeyed, *each)
            for each in within
            for number in range(1, MOST_STORES + 1)
            for is_obeyed in (False, True)
        ]

    def _requests(self) -> Iterable[tuple[Any, ...]]:
        for name in self.design.menu:
            for axis in range(len(self.design.plans)):
                if name == "to" and self.state.axes[axis].next_run is not None:
                    continue  # a drive that keeps one target takes no third one
                if name in ("to", "to-all", "low", "high"):
                    yield from ((name, axis, i) for i in range(len(self.design.targets)))
                elif name == "mask":
                    yield from ((name, axis, i) for i in range(len(self.design.masks)))
                elif name == "both":
                    yield from ((name, axis, i) for i in range(len(self.design.targets)))
                elif name == "by":
                    yield from ((name, axis, i) for i in range(len(self.design.distances)))
                else:
                    yield (name, axis)

    def pdu(self, name: str, number: int = 0) -> bytes:
        """Return the PDU of a request of the menu; ``-all``: it is broadcast."""
        name = name.removesuffix("-all")
        if name == "to":
            return write(COMMAND, self.design.targets[number] // self.design.step_counts)
        if name == "by":
            return write(COMMAND, self.design.distances[number] // self.design.step_counts)
        if name in ("low", "high"):
            data = self.design.packed(self.design.targets[number])
            address = COMMAND.address + (name == "high")
            return b"\x06" + address.to_bytes(2, "big") + (data[2:] if name == "high" else data[:2])
        if name == "mask":
            keep, put = self.design.masks[number]
            head = bytes((MASK,)) + COMMAND.address.to_bytes(2, "big")
            return head + keep.to_bytes(2, "big") + put.to_bytes(2, "big")
        if name == "both":
            return bytes((BOTH,)) + read(ACTUAL)[1:] + self.pdu("to", number)[1:]
        if name in REGISTERS:
            return read(REGISTERS[name])
        if name == "alarms":
            return b"\x03" + ALARMS.to_bytes(2, "big") + b"\0\x01"
        if name == "other":
            return b"\x03" + OTHER.to_bytes(2, "big") + b"\0\x01"
        if self.design.edge == "coil" and name in ("run", "idle"):
            return rules.COIL_RUN_PDU if name == "run" else rules.COIL_IDLE_PDU
        if name == "limit":
            return write(LIMIT, LIMIT_COUNTS)
        if name == "limit-low":
            return b"\x06" + LIMIT.address.to_bytes(2, "big") + LIMIT.pack(LIMIT_COUNTS)[:2]
        if name == "status-wide":
            return b"\x03" + STATUS.to_bytes(2, "big") + b"\0\x02"
        if name == "status":
            return b"\x03" + STATUS.to_bytes(2, "big") + b"\0\x01"
        if name == "remap":
            return b"\x06" + REMAPPING.to_bytes(2, "big") + b"\0\x01"
        if name.startswith("mode-"):
            return b"\x06" + MODE.to_bytes(2, "big") + MODES[name].to_bytes(2, "big")
        return b"\x06" + TRIGGER.to_bytes(2, "big") + TRIGGERS[name].to_bytes(2, "big")

    # --- making it happen ------------------------------------------------------------------------------

    def happen(self, event: Happening) -> None:
        """Let an event happen. Raises BrokenRuleError."""
        before = self.before = self._said or said(self.sides[0].line)
        self._said = ()
        self.told.clear()
        self.refusals.clear()
        refused_before = refused(self.sides[0].line)
        getattr(self, "_on_" + event[0])(*event[1:])
        rules.judge_waiting(self)
        if not event[0].startswith("kill"):
            rules.judge_refusals(self, refused(self.sides[0].line) - refused_before)
        after = said(self.sides[0].line)
        facts.judge(self, before, after, self.told, is_restart=event[0].startswith("kill"))
        self._said = after

    def _call(self, name: str, *args: Any) -> None:
        for side in self.sides:
            getattr(side.line, name)(*args)

    def _on_ask(self, port: int, name: str, axis: int, number: int = 0) -> None:
        pdu = self.pdu(name, number)
        taken = {each.transaction_id for each in self.state.asked[port]}
        taken.update(number for owner, number in self.state.given_up if owner == port)
        if self.state.wire is not None and self.state.wire.owner == port:
            taken.add(self.state.wire.transaction_id)
        transaction_id = next(i for i in range(1, 99) if i not in taken)
        if self.design.controllers[port].serial:
            self._give_up(port)  # what it asked before is withdrawn, or is answered for nobody
        asked = list(self.state.asked)
        is_broadcast = name.endswith("-all")
        is_owed = self.state.axes[axis].hush_ticks > 0 and not is_broadcast
        request = Asked(pdu, transaction_id, axis=axis, is_broadcast=is_broadcast, is_owed=is_owed)
        asked[port] = (*asked[port], request)
        order = (*self.state.order, (port, transaction_id))
        self.state = self.state._replace(asked=tuple(asked), order=order)
        unit_id = BROADCAST_UNIT_ID if is_broadcast else self.design.plans[axis].unit_id
        for side in self.sides:
            side.request(port, transaction_id, unit_id, pdu, self.now_ns)
        self._collect()

    def _on_disconnect(self, port: int) -> None:
        self._give_up(port)
        for side in self.sides:
            side.gone(port, self.now_ns)
        self._collect()

    def _give_up(self, port: int) -> None:
        """A controller waits no longer for what it asked: what was not sent must never be."""
        for each in self.state.asked[port]:
            self._lose(port, each)
            if rules.is_stop(each.pdu) and not each.is_sent:
                self.state = self.state._replace(owed_stops=min(self.state.owed_stops + 1, 2))
        asked = list(self.state.asked)
        asked[port] = ()
        order = tuple(each for each in self.state.order if each[0] != port)
        self.state = self.state._replace(asked=tuple(asked), order=order)

    def _on_drive(self, what: str) -> None:
        wire = self.state.wire
        assert wire is not None
        if what == "obey":
            self.state = self.state._replace(wire=wire._replace(is_obeyed=True))
            self._obey(wire)
            return
        self.state = self.state._replace(wire=None)
        if what == "ack":
            reply = self._obey(wire)
        elif what == "refuse":
            reply = bytes((wire.pdu[0] | 0x80, EXCEPTION))
        elif what == "vendor":
            reply = bytes((VENDOR, EXCEPTION))
        elif what == "obey-refuse":
            self._obey(wire)
            reply = bytes((wire.pdu[0] | 0x80, EXCEPTION))
        elif what in BEFORE:
            if what == "before":
                self._obey(wire)
            reply = self.state.before
        else:  # garble: the form of a success that says something else
            reply = wire.pdu[:3] + b"\0\0" if wire.pdu[0] == 16 else wire.pdu[:3] + b"\xff\xff"
        self._answer(wire, reply)
        if wire.aim is not None or wire.pdu in rules.ODD_PDUS:
            self._on_wait()  # no controller says something else before the axis had the time to begin

    def _on_late(self) -> None:
        late = self.state.late
        assert late is not None
        self.state = self.state._replace(late=None)
        rules.go_on_hushing(self, facts.number_of(self, late.unit_id))
        reply = self.reply_to(late) if late.is_obeyed else self._obey(late)
        for side in self.sides:
            side.stray(late.unit_id, reply, self.now_ns)
        self._collect()

    @staticmethod
    def _is_another(wire: Wire, reply: bytes) -> bool:
        """Whether a reply has another function, or another size, than that to a frame."""
        size = 2 + 2 * (wire.pdu[3] << 8 | wire.pdu[4]) if wire.pdu[0] == 3 else 5
        return reply[0] != wire.pdu[0] or len(reply) != size

    def _answer(self, wire: Wire, reply: bytes) -> None:
        if self.design.answers_before:
            self.state = self.state._replace(before=reply)
        if wire.is_early and reply != wire.pdu:
            for side in self.sides:
                side.reply(wire.unit_id, reply, self.now_ns)
            rules.owe_early_stop(self, wire)
            rules.go_on_hushing(self, facts.number_of(self, wire.unit_id))
            facts.unanswered(self, wire, has_said_something=True)
            rules.note_silence(self, wire)
            self._collect()
            return
        for side in self.sides:
            side.reply(wire.unit_id, reply, self.now_ns)
        self.reading_age_ns = self.now_ns - wire.sent_ns
        self._collect(answered=wire, reply=reply)

    def _on_wait(self, _axis: int = 0) -> None:
        self.now_ns += TICK_NS
        state = self.state
        late = state.late
        if late is not None:
            late = late._replace(ticks_left=late.ticks_left - 1) if late.ticks_left > 1 else None
        axes = tuple(_older(axis, self.design) for axis in state.axes)
        asked = tuple(
            tuple(each._replace(ticks=min(each.ticks + 1, 20)) for each in waiting) for waiting in state.asked
        )
        beliefs = state.beliefs
        if "low" in self.design.menu:
            beliefs = tuple(
                tuple(b._replace(ticks=min(b.ticks + 1, OLD_TICKS)) for b in own) for own in state.beliefs
            )
        self.state = state._replace(late=late, axes=axes, asked=asked, beliefs=beliefs)
        rules.hush(self)
        wire = state.wire
        is_prepared = wire is not None and wire.owner < 0 and not rules.is_stop(wire.pdu)
        first = next(((p, t) for p, t in state.order if not rules.find(self, p, t).is_sent), None)
        for port, waiting in enumerate(asked):
            for each in waiting:
                if is_prepared and (port, each.transaction_id) == first:
                    continue
                if not each.is_sent and each.ticks > PATIENCE_TICKS and not rules.is_stop(each.pdu):
                    self._forget_request(port, each)
        self._call("tick", self.now_ns)
        self._collect()

    def _forget_request(self, port: int, request: Asked) -> None:
        self._lose(port, request)
        rules.end(self, port, request)
        given_up = (*self.state.given_up, (port, request.transaction_id))
        self.state = self.state._replace(given_up=given_up)

    def _set(self, number: int, axis: Axis) -> None:
        axes = list(self.state.axes)
        axes[number] = axis
        self.state = self.state._replace(axes=tuple(axes))

    def _on_arrive(self, number: int) -> None:
        self._arrive(number, is_done=True)

    def _on_arrive_undone(self, number: int) -> None:
        self._arrive(number, is_done=False)

    def _arrive(self, number: int, *, is_done: bool) -> None:
        self._on_wait()
        if self.state.axes[number].goes_counts is not None:
            self._rest(number, is_done=is_done)

    def _rest(self, number: int, *, is_done: bool) -> None:
        axis = self.state.axes[number]
        end = axis.goes_counts
        assert end is not None
        self._set(
            number,
            axis._replace(
                stands_counts=end, commanded_counts=end, goes_counts=None, is_done=is_done, ticks=0
            ),
        )

    def _on_done(self, number: int) -> None:
        self._set(number, self.state.axes[number]._replace(is_done=True, is_seen_undone=False))

    def _on_undone(self, number: int) -> None:
        self._set(number, self.state.axes[number]._replace(is_done=False))

    def _on_blink(self, number: int) -> None:
        """Done falls of an axis that stands: it moves a little, or the bit has flickered."""
        axis = self.state.axes[number]
        run = axis.run
        is_sure = run is not None and run.is_told and bool(run.seen & 2) and run.uncertainty < 2
        if run is not None:
            run = run._replace(seen=0, is_told=False, has_blinked=is_sure or run.has_blinked)
        was_done = axis.was_done or is_sure
        self._set(number, axis._replace(is_done=False, run=run, was_done=was_done))

    def _on_tremble(self, number: int) -> None:
        """An axis whose done bit fell stands beside its target a moment later."""
        self._on_wait()
        axis = self.state.axes[number]
        at = axis.stands_counts + TREMBLES_COUNTS
        self._set(number, axis._replace(stands_counts=at, commanded_counts=at, is_seen_undone=False))

    def _on_creep(self, number: int) -> None:
        """An axis whose done bit fell is elsewhere a moment later; somebody has seen the bit."""
        self._on_wait()
        axis = self.state.axes[number]
        at = JOGGED_COUNTS
        self._set(
            number,
            axis._replace(
                stands_counts=at,
                commanded_counts=at,
                is_done=True,
                is_seen_undone=False,
                ticks=0,
                run=None,
                has_crept=True,
            ),
        )

    def _on_jog(self, number: int) -> None:
        """Somebody moves the axis on the drive's own panel. Nobody sees it for as long as that takes."""
        for _ in range(UNSEEN_TICKS + 1):
            self._on_wait()
        self._put(number, JOGGED_COUNTS)

    def _on_nudge(self, number: int) -> None:
        """The same, by less than a correction may be long: its target given again may keep its words."""
        for _ in range(UNSEEN_TICKS + 1):
            self._on_wait()
        run = self.state.axes[number].run
        self._put(number, self.state.axes[number].stands_counts + NUDGED_COUNTS)
        if run is not None:
            run = run._replace(is_told=False, is_acked=False, seen=0, is_unsure=True, uncertainty=2)
            self._set(number, self.state.axes[number]._replace(run=run))

    def _put(self, number: int, at: int) -> None:
        axis = self.state.axes[number]._replace(stopped=None)
        self._set(
            number,
            axis._replace(
                stands_counts=at, goes_counts=None, commanded_counts=at, is_done=True, ticks=0, run=None
            ),
        )

    def _on_reboot(self, number: int) -> None:
        """The drive is switched off and on: it stands where it stood and counts from another zero.

        It holds its target as before, and whoever gives that again gives the same words (M4, decision 25).
        """
        for _ in range(REBOOT_TICKS):
            self._on_wait()
        axis = self.state.axes[number]
        run, tried = axis.run, axis.tried
        if run is not None and run.end_counts == axis.target_counts:
            tried = Tried(run.nominal_counts, run.end_counts, run.table, run.state, run.is_gain_half)
        held_counts, facts = axis.target_counts, axis.facts
        is_held = run is not None and run.is_held and run.end_counts == held_counts
        # After another target that was lost it is a different one: nobody knows which of both it holds.
        is_held &= run is None or axis.tried is None or axis.tried.nominal_counts == run.nominal_counts
        held = tried if is_held and self.design.judges_proof else axis.held
        self._set(
            number, Axis(target_counts=held_counts, is_homed=False, tried=tried, facts=facts, held=held)
        )

    def _on_alarm(self, number: int) -> None:
        """The drive gives up: it stands where it is."""
        axis = self.state.axes[number]
        run = (
            None
            if axis.run is None or axis.goes_counts is not None
            else axis.run._replace(is_told=False, is_acked=False)
        )
        self._set(number, axis._replace(is_alarmed=True, goes_counts=None, ticks=0, is_done=True, run=run))

    def _on_calm(self, number: int) -> None:
        self._set(number, self.state.axes[number]._replace(is_alarmed=False))

    def _on_homed(self, number: int) -> None:
        self._set(number, self.state.axes[number]._replace(is_homed=True, is_done=True))

    def _on_homed_bit(self, number: int) -> None:
        """The homed bit of a drive falls, or rises, by itself."""
        axis = self.state.axes[number]
        self._set(number, axis._replace(is_homed=not axis.is_homed))

    def _on_unplug(self) -> None:
        gantries.broken_off(self)
        self.state = self.state._replace(is_up=False, owed_stops=0, given_up=())
        rules.end_hush(self)  # the whole line is silent when it comes up
        self._forget_runs()
        wire = self.state.wire
        if wire is not None:
            self.state = self.state._replace(wire=None)
            facts.unanswered(self, wire, is_cut=True)
            rules.may_stay_unasked(self, facts.number_of(self, wire.unit_id))
        facts.link_lost(self, set() if wire is None else {wire.unit_id})
        self._call("link_down", self.now_ns)
        self._collect()
        for port in range(len(self.state.asked)):
            self._give_up(port)
        self.state = self.state._replace(late=None)

    def _on_plug(self) -> None:
        self._on_wait()
        self.state = self.state._replace(is_up=True, is_starting=True)
        facts.link_found(self)
        self._call("link_up", self.now_ns)
        self._collect()

    def _on_kill(self) -> None:
        self._restart(is_record_kept=True)

    def _on_kill_bare(self) -> None:
        self._restart(is_record_kept=False)

    def _on_kill_boot(self, *, is_whole: bool = True) -> None:
        """The machine is switched off and on: the record is of another boot, every axis has come to rest."""
        for number, axis in enumerate(self.state.axes):
            if axis.goes_counts is not None:
                self._rest(number, is_done=True)
        for buffer in self.records.buffers.values():
            buffer[HEADER.size : HEADER.size + BOOT.size] = bytes(BOOT.size)
        self._restart(is_record_kept=True, is_whole=is_whole)

    def _on_kill_torn(self) -> None:
        """The same, and what was written last is torn in the middle."""
        for buffer in self.records.buffers.values():
            at = max(SLOTS_AT, key=lambda at: int.from_bytes(buffer[at : at + 8], "little"))
            buffer[at + SLOT_SIZE // 2] ^= 0xFF
        self._on_kill_boot(is_whole=False)

    def _on_kill_half(self) -> None:
        """The record of the last axis is gone, those of the others are there."""
        *_, buffer = self.records.buffers.values()
        buffer[:] = bytes(len(buffer))
        self._restart(is_record_kept=True, is_whole=False)

    def _on_kill_at(self, number: int, is_obeyed: bool, *event: Any) -> None:
        """The gateway dies in the middle of an event, right before the store of that number.

        A frame that had left is carried out or not.
        """
        self._dies_at = number
        try:
            self.happen(event)
        except KilledError:
            for side in self.sides:
                side.forget_replies()  # whether an answer was still read makes no difference to iron
            frames, self.sides[0].link.sent = self.sides[0].link.sent, []
            self.sides[0].link.is_abandoned = False
            for unit_id, pdu in frames:
                self.state = self.state._replace(wire=rules.judge_frame(self, unit_id, pdu))
        self._dies_at = 0
        wire = self.state.wire
        if is_obeyed and wire is not None and not wire.is_obeyed:
            self._obey(wire)
        self.told.clear()  # what the dead one had told
        self._restart(is_record_kept=True)

    def _restart(self, *, is_record_kept: bool, is_whole: bool = True) -> None:
        """``is_whole``: every axis has the record that was written last (else none of a group counts)."""
        gantries.broken_off(self)
        wire = self.state.wire
        is_clean = (self.state.table, self.state.is_gain_half, self.state.is_wanted) == (0, False, True)
        rules.end_hush(self)
        for port in range(len(self.state.asked)):
            self._give_up(port)
        for side, fresh in zip(self.sides, self._fresh, strict=True):
            side.lens.restore(fresh, is_live_known=False)
        if not is_record_kept:
            for (
                buffer
            ) in self.records.buffers.values():  # the same ones: states that are put back write there
                for at in range(0, len(buffer), PAGE):
                    buffer[at : at + WRITTEN] = bytes(WRITTEN)
        self._attach()
        self.state = self.state._replace(
            wire=None, late=None, is_starting=True, is_up=True, owed_stops=0, given_up=(), owed=()
        )
        self.state = self.state._replace(table=0, is_wanted=True, is_gain_half=False)
        if self.design.groups:  # nobody remembers of the others what was lost on its way
            beliefs = tuple(tuple(b._replace(lost=b.lost & 3) for b in own) for own in self.state.beliefs)
            self.state = self.state._replace(beliefs=beliefs)
        self._forget_runs(is_restart=True, is_recalled=is_record_kept and is_clean and is_whole, wire=wire)
        self.now_ns += TICK_NS
        axes = tuple(_older(axis, self.design) for axis in self.state.axes)
        self.state = self.state._replace(axes=axes)
        facts.restarted(self, wire, has_record=self.design.has_record and is_record_kept)
        self._call("link_up", self.now_ns)
        self._collect()

    def _forget_runs(
        self, *, is_restart: bool = False, is_recalled: bool = False, wire: Wire | None = None
    ) -> None:
        """Nobody knows of the motions any more. ``is_recalled``: but from the records."""
        for number, was in enumerate(self.state.axes):
            stopped = was.stopped  # from its record, if that counts
            if stopped is not None:
                is_kept = is_recalled and wire is None and stopped.table == 0
                stopped = stopped._replace(is_recalled=True) if is_kept else None
            axis = was._replace(read_counts=None, stopped=stopped)
            self._set(number, axis)
            run = axis.run
            if run is not None:
                is_known = is_recalled and run.table == 0 and rules.is_of_record(self, number, wire)
                seen = run.seen if is_known and wire is None else 0
                run = run._replace(
                    is_told=False, is_acked=False, seen=0, is_restarted=run.is_restarted or is_restart,
                    kept_seen=seen, is_held=run.is_held and not is_restart,
                    is_set_out=run.is_set_out and (is_known or not is_restart),
                )  # fmt: skip
                aim = None if wire is None else wire.aim
                is_distance = aim is not None and aim.base is not None
                run = run._replace(is_recalled=is_known, is_open=is_known and (is_distance or run.is_open))
                tried = axis.tried if is_known or not is_restart else self._kept_tried(number)
                self._set(number, axis._replace(run=run, tried=tried))

    def _kept_tried(self, number: int) -> Tried | None:
        """Return what was tried last, where a record names that target; nothing proves another one."""
        found = self.records.read(self.design.plans[number].name) if self.design.has_record else None
        if found is None:
            return None
        ends = (found.corrected_counts, found.unacknowledged and found.unacknowledged.corrected_counts)
        tried = self.state.axes[number].tried
        return tried if tried is not None and tried.end_counts in ends else None

    def _on_table(self) -> None:
        number = 1 - self.state.table
        self.state = self.state._replace(table=number)
        table = self.screws[number].table()
        wanted = tuple(TableFor(plan.name, "", "", "") for plan in self.design.plans)
        self._command(SetTable(tables=wanted), [table] * len(wanted))

    def _on_temperature(self) -> None:
        """The sensor says that the screw is warm, or as cold as its table."""
        is_warm = self.state.table != WARM
        self.state = self.state._replace(table=WARM if is_warm else 0)
        plan = self.design.plans[0]
        assert plan.thermal is not None
        celsius = plan.thermal.reference + (WARMER_K if is_warm else 0.0)
        self._command(SetTemperature(axis=plan.name, celsius=celsius))
        self._on_wait()  # what counts follows the sensor by the clock

    def _on_gain(self) -> None:
        is_half = not self.state.is_gain_half
        self.state = self.state._replace(is_gain_half=is_half)
        share = 0.5 if is_half else 1.0
        self._command(SetGain(axes=(self.design.plans[0].name,), forward=share, backward=share))

    def _on_switch(self) -> None:
        self.state = self.state._replace(is_wanted=not self.state.is_wanted)
        axes = (self.design.plans[0].name,)
        self._command(Enable(axes=axes) if self.state.is_wanted else Disable(axes=axes))

    def _on_end_dry_run(self) -> None:
        try:
            self._command(EndDryRun(axes=(self.design.plans[0].name,)))
        except ControlError as error:
            rules.judge_dry_run(self, 0, str(error))
        else:
            self.state = self.state._replace(is_wanted=True)
            rules.judge_dry_run(self, 0, "")

    def _on_declare(self) -> None:
        facts.declared(self, 0)
        self._command(SetReference(axis=self.design.plans[0].name))

    def _command(self, command: Command, tables: Sequence[CorrectionTable] = ()) -> None:
        for side in self.sides:
            side.line.command(command, self.now_ns, tables)
        self._collect()

    # --- the drive -------------------------------------------------------------------------------------

    def reply_to(self, wire: Wire) -> bytes:
        """Return what the drive answers to a frame that it has obeyed."""
        pdu = wire.pdu
        if pdu[0] not in (3, BOTH):
            return pdu[:5] if pdu[0] == 16 else pdu
        number = facts.number_of(self, wire.unit_id)
        plan = self.design.plans[number]
        data = _registers(self.state.axes[number], plan, pdu[1] << 8 | pdu[2], pdu[3] << 8 | pdu[4])
        return bytes((pdu[0], len(data))) + data

    def _obey(self, wire: Wire) -> bytes:
        """Let the drive do what a frame says; return its answer."""
        pdu = wire.pdu
        number = facts.number_of(self, wire.unit_id)
        axis = self.state.axes[number]
        address = pdu[1] << 8 | pdu[2]
        if pdu[0] == 3:
            return self.reply_to(wire)
        if axis.held is not None and wire.aim is None:
            axis = axis._replace(held=None)
            self._set(number, axis)
        if pdu[0] == 5:
            self._act(number, int(pdu[3] == 0xFF), wire)
            return pdu
        if rules.writes_target(pdu):
            target = self.design.written(axis.target_counts, pdu)
            self._set(number, axis._replace(target_counts=target))
            if not self.design.is_staged:
                is_distance = axis.mode == 2
                self._set(number, self.state.axes[number]._replace(mode=1))
                self._go(number, target + is_distance * axis.commanded_counts, wire)
            return self.reply_to(wire)
        if pdu[0] == 16:
            counts = int(LIMIT.unpack(pdu[6:]))
            self._set(number, axis._replace(limit_counts=counts, told_limit_counts=None))
            return self.reply_to(wire)
        if address == TRIGGER:
            self._act(number, pdu[3] << 8 | pdu[4], wire)
            return pdu
        if address == MODE:
            self._set(number, axis._replace(mode=pdu[3] << 8 | pdu[4]))
            return pdu
        assert address == REMAPPING, pdu.hex(" ")
        return pdu

    def _act(self, number: int, value: int, wire: Wire) -> None:
        axis = self.state.axes[number]._replace(stopped=None)
        if self.design.edge:
            is_rising = value == RUN and not axis.trigger
            axis = axis._replace(trigger=int(value == RUN))
            self._set(number, axis)
            if not is_rising and value in (RUN, 0):
                return
        if value == RUN and axis.mode == 1:
            self._go(number, axis.target_counts, wire)
        elif value in (RUN, RUN_RELATIVE):
            self._set(number, axis._replace(mode=1))
            self._go(number, axis.commanded_counts + axis.target_counts, wire)
        elif value == STOP:
            run = axis.run
            is_known = axis.goes_counts is not None and run is not None and run.is_told
            if is_known and run is not None and not run.is_unsure and run.state == "active":
                axis = axis._replace(stopped=run)
            self._set(
                number,
                axis._replace(
                    goes_counts=None, commanded_counts=axis.stands_counts, is_done=True,
                    ticks=0, run=axis.run if axis.goes_counts is None else None,
                ),
            )  # fmt: skip
            axis = self.state.axes[number]
            if axis.run is not None:
                self._set(number, axis._replace(run=axis.run._replace(is_told=False, is_acked=False, seen=0)))
        elif value in (HOME, JOG, STORED, STRANGE):
            self._set(
                number,
                axis._replace(
                    stands_counts=0 if value == HOME else JOGGED_COUNTS, goes_counts=None,
                    commanded_counts=0 if value == HOME else JOGGED_COUNTS,
                    is_done=False, is_homed=axis.is_homed and value != HOME, ticks=0, run=None,
                    is_fresh=value == HOME and not wire.is_obeyed,
                ),
            )  # fmt: skip
        elif value == ZERO:
            self._set(number, axis._replace(stands_counts=0, goes_counts=None, commanded_counts=0, run=None))

    def _go(self, number: int, end: int, wire: Wire) -> None:
        axis = self.state.axes[number]
        if axis.stopped is not None:
            axis = axis._replace(stopped=None)
        if self.design.is_buffered and axis.goes_counts is not None:
            self._set(number, axis._replace(stands_counts=axis.goes_counts, goes_counts=None))
            assert wire.aim is not None
            aim = wire.aim._replace(from_counts=axis.goes_counts, arrived=axis.run)
            run = rules.judge_motion(self, number, end, wire._replace(aim=aim))
            self._set(number, axis._replace(next_run=run))
            return
        run = rules.judge_motion(self, number, end, wire)
        is_there = end == axis.stands_counts
        is_again = axis.run is not None and axis.run.nominal_counts == run.nominal_counts
        if axis.has_crept:  # its done bit says more than that it goes there
            run = run._replace(uncertainty=2)
        self._set(
            number,
            axis._replace(
                is_owed_look=axis.is_owed_look and is_again,
                goes_counts=None if is_there else end, commanded_counts=axis.stands_counts,
                is_done=axis.is_done or is_there, is_seen_undone=False, was_done=False,
                ticks=axis.ticks if end == axis.goes_counts else 0, run=run,
                is_fresh=False, is_lost_distance=False, is_known_moving=False, held=None,
            ),
        )  # fmt: skip

    # --- what the gateway did --------------------------------------------------------------------------

    def _tell(self, event: Event) -> None:
        self.tally.events.add(event.kind.name)
        self.tally.note(event.kind.name, event.axis)
        self.told.append(event)

    def _collect(self, answered: Wire | None = None, reply: bytes = b"") -> None:
        """Look at what left, and at what came back."""
        first = self.sides[0]
        for side in self.sides[1:]:
            rules.compare(first, side)
            side.forget()
        if answered is not None:
            rules.note_answer(self, answered, reply)
        if first.link.is_abandoned:
            first.link.is_abandoned = False
            self._give_reply_up()
        heard = [tuple(replies) for replies in first.replies]
        first.forget_replies()
        self.tally.note(heard, first.link.sent)
        for number, replies in enumerate(heard):
            for transaction_id, pdu in replies:
                rules.judge_reply(self, number, transaction_id, pdu, answered)
        if answered is not None:
            rules.judge_answered(self, answered)
        frames, first.link.sent = first.link.sent, []
        for unit_id, pdu in frames:
            if self.state.wire is not None:
                raise BrokenRuleError("two frames on the wire at once (W6)")
            stopping = stopping_of(self.sides[0].line) if rules.is_stop(pdu) else Stopping.NO
            wire = rules.judge_frame(self, unit_id, pdu, stopping)
            wire = wire._replace(sent_ns=self.now_ns, is_early=stopping is Stopping.EARLY)
            if unit_id == BROADCAST_UNIT_ID:
                facts.left(self, wire)
                self._obey(wire)
                rules.note_broadcast(self, wire)
                continue
            rules.judge_phase(self, wire)
            late = self.state.late
            if self.design.is_serial and (self.design.late_ticks == DRAIN_TICKS or not _is_done(late)):
                late = None
            self.state = self.state._replace(wire=wire, late=late)
            facts.left(self, wire)
        if not frames and answered is not None:
            self.state = self.state._replace(is_starting=False, owed_stops=0, given_up=())
        if len(self.sides) > 1 and self.is_quiet:
            self._compare_states()

    def _give_reply_up(self) -> None:
        """The gateway does not wait for a reply any longer; it may still come."""
        wire = self.state.wire
        if wire is not None:
            if self.now_ns - wire.sent_ns < self.design.response_ticks * TICK_NS:
                raise BrokenRuleError(f"given up before its time: {wire.pdu.hex(' ')} (W7)")
            rules.owe_early_stop(self, wire)
            facts.unanswered(self, wire)
            rules.note_silence(self, wire)
            rules.begin_to_hush(self, facts.number_of(self, wire.unit_id), DRAIN_TICKS)
            rules.forget_stop(self, facts.number_of(self, wire.unit_id))
            late = (
                wire._replace(ticks_left=self.design.late_ticks)
                if not self.state.split and "late" in self.design.happenings
                else None
            )
            self.state = self.state._replace(wire=None, late=late)

    def _compare_states(self) -> None:
        first, second = (side.lens.take(self.now_ns) for side in self.sides)
        if first.tokens != second.tokens:
            names = [
                type(self.sides[0].lens.objects[i]).__name__
                for i, (a, b) in enumerate(zip(first.tokens, second.tokens, strict=True))
                if a != b
            ]
            raise BrokenRuleError(f"fast and slow path leave different states behind (7): {', '.join(names)}")

    def said(self, number: int) -> Any:
        """Return what the gateway says of an axis."""
        return said_of(self.sides[0].line.axes[number])

    def passes_unchanged(self, number: int) -> bool:
        """Whether nothing of the positions of an axis is changed on the way, and its drive holds none."""
        return self.sides[0].line.axes[number].passes_unchanged

    def is_sending_unsure(self) -> bool:
        """Whether the target on the wire has an assumed branch."""
        return is_sending_unsure(self.sides[0].line)

    @property
    def tick_ns(self) -> int:
        """How long a tick is."""
        return TICK_NS

    def on_its_way(self) -> OnItsWay | None:
        """What is known of the request that is on the wire."""
        return on_its_way(self.sides[0].line)

    def is_resting(self) -> bool:
        """Whether the line is silent for a while, whatever waits."""
        return is_resting(self.sides[0].line)

    def _lose(self, port: int, request: Asked) -> None:
        rules.note_lost(self, port, request)
        if not request.is_sent:
            facts.never_sent(self, port, request, 0)

    @property
    def is_quiet(self) -> bool:
        """Whether nothing is asked and nothing is on the wire."""
        return self.state.wire is None and not any(self.state.asked)


def _is_done(late: Wire | None) -> bool:
    """Whether nothing but its reply is left of a frame: a drive does one after the other."""
    return late is not None and (late.is_obeyed or late.pdu[0] == 3)


def _tell_nobody(_event: Event) -> None:
    """The second of two sides says the same as the first."""


JOGGED_COUNTS: Final = 3001
NUDGED_COUNTS: Final = 300
ALARMS: Final = 0x0741
"""Where a drive may keep its alarm bit, apart from the others."""
OTHER: Final = 0x0740
"""A register that no map knows, and that only reads are of."""
STRANGE: Final = 999
"""A value of the trigger that no register map knows."""
REMAPPING: Final = 0x0900
"""Where a register stands that moves other registers about."""
TREMBLES_COUNTS: Final = 7
"""Beside its window, and nearer than a correction is long."""
REBOOT_TICKS: Final = 14
"""Longer than a homed bit counts, which is a second."""
REGISTERS: Final[dict[str, PositionField]] = {
    "read": ACTUAL,
    "back": COMMAND,
    "commanded": COMMANDED,
    "limit-back": LIMIT,
}
BEFORE: Final = ("before", "before-deaf")
"""Answers of a drive that says once more what it has said before: it has obeyed, or heard nothing."""
MODES: Final = {"mode-absolute": 1, "mode-distance": 2}
TRIGGERS: Final = {
    "run": RUN,
    "distance": RUN_RELATIVE,
    "stop": STOP,
    "home": HOME,
    "zero": ZERO,
    "jog-on": JOG,
    "stored": STORED,
    "strange": STRANGE,
    "idle": 0,
}
TAKES_TIME: Final = frozenset(
    {"wait", "arrive", "arrive_undone", "creep", "jog", "nudge", "reboot", "plug", "temperature"}
)
OF_AXIS: Final[dict[str, Callable[[Axis], bool]]] = {
    "arrive": lambda axis: axis.goes_counts is not None,
    "arrive_undone": lambda axis: axis.goes_counts is not None,
    "done": lambda axis: not axis.is_done and axis.is_homed,
    "undone": lambda axis: axis.is_done and axis.goes_counts is not None,
    "blink": lambda axis: axis.is_done and axis.goes_counts is None and axis.run is not None,
    "creep": lambda axis: axis.is_seen_undone and axis.goes_counts is None and not axis.is_done,
    "tremble": lambda axis: (
        axis.is_seen_undone
        and axis.goes_counts is None
        and axis.run is not None
        and axis.stands_counts == axis.run.end_counts
    ),
    "homed_bit": lambda axis: True,
    "nudge": lambda axis: (
        axis.goes_counts is None and axis.run is not None and axis.stands_counts == axis.run.end_counts
    ),
    "jog": lambda axis: axis.goes_counts is None and axis.stands_counts != JOGGED_COUNTS,
    "reboot": lambda axis: axis.is_homed,
    "alarm": lambda axis: not axis.is_alarmed,
    "calm": lambda axis: axis.is_alarmed,
    "homed": lambda axis: not axis.is_homed and axis.stands_counts == 0,
}
OF_WORLD: Final[dict[str, Callable[[State], bool]]] = {
    "wait": lambda state: True,
    "unplug": lambda state: state.is_up,
    "plug": lambda state: not state.is_up,
    "kill": lambda state: True,
    "kill_bare": lambda state: True,
    "kill_boot": lambda state: True,
    "kill_torn": lambda state: True,
    "kill_half": lambda state: True,
    "table": lambda state: True,
    "gain": lambda state: True,
    "temperature": lambda state: True,
    "switch": lambda state: True,
    "end_dry_run": lambda state: not state.is_wanted,
    "declare": lambda state: True,
}


def _can(name: str, axis: Axis) -> bool:
    return name in OF_AXIS and OF_AXIS[name](axis)


def _older(axis: Axis, design: Design) -> Axis:
    """Let a tick pass: a drive that has begun to move lets done fall, and is on its way if it is prompt."""
    if axis.goes_counts is None and axis.next_run is not None:
        run = axis.next_run
        return axis._replace(goes_counts=run.end_counts, run=run, next_run=None, ticks=0, is_fresh=False)
    if axis.goes_counts is None:
        return axis
    ticks = min(axis.ticks + 1, design.drop_ticks)
    is_late = ticks == design.drop_ticks and axis.ticks < design.drop_ticks
    stands = axis.stands_counts
    if design.is_prompt and not axis.ticks:
        low, high = min(stands, axis.goes_counts), max(stands, axis.goes_counts)
        stands = next((place for place in design.on_the_way_counts if low < place < high), stands)
    is_done = axis.is_done and (design.is_in_position or not is_late)
    return axis._replace(ticks=ticks, stands_counts=stands, commanded_counts=stands, is_done=is_done)


def _registers(axis: Axis, plan: AxisPlan, address: int, quantity: int) -> bytes:
    words: dict[int, bytes] = {}
    for place, counts in (
        (plan.command[0], axis.target_counts),
        (plan.actual[0] if plan.actual else ACTUAL, axis.stands_counts),
        (plan.commanded[0] if plan.commanded else COMMANDED, axis.commanded_counts),
        (LIMIT, axis.limit_counts),
    ):
        data = COMMAND.pack(round(counts / place.scale))
        words[place.address], words[place.address + 1] = data[:2], data[2:]
    is_moving = axis.goes_counts is not None
    words[MODE] = axis.mode.to_bytes(2, "big")
    status = (
        axis.is_alarmed << ALARM_BIT
        | axis.is_done << DONE_BIT
        | axis.is_homed << HOMED_BIT
        | is_moving << MOVING_BIT
    )
    words[STATUS] = status.to_bytes(2, "big")
    words[ALARMS] = (axis.is_alarmed << ALARM_BIT).to_bytes(2, "big")
    return b"".join(words.get(address + i, b"\0\0") for i in range(quantity))
