"""The verdict of the time budget on a configuration: what is impossible, what is close, what is faster."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from enum import Enum
from typing import Final

import msgspec
from msgspec import Struct

from gateway.budget.line import ControllerBudget, ExchangeBudget, LineBudget, gateway_ns, line_budget
from gateway.budget.sequence import AS_MAPPED, Blocks, What, Why
from gateway.exchange.plan import AxisPlan, Role
from gateway.state.plan import LinePlan
from gateway.times import NS_PER_MS
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

# --- spans as displayed ------------------------------------------------------------------------------------


def ms(span_ns: int) -> str:
    """Write a span in milliseconds, with three digits but nothing below a microsecond.

    >>> ms(65_312_500), ms(1_750_000), ms(0), ms(112_458_333)
    ('65.3', '1.75', '0', '112')
    """
    span_ms = span_ns / NS_PER_MS
    if not span_ns:
        return "0"
    digits = 0 if span_ms >= 99.95 else 1 if span_ms >= 9.995 else 2 if span_ms >= 0.0995 else 3
    return f"{span_ms:.{digits}f}"


def sum_text(terms: Iterable[tuple[int, str]]) -> str:
    """Write the terms of a sum, without those that are 0.

    >>> sum_text([(46_979_167, "to the drive"), (0, "drive"), (9_166_667, "back")])
    '47.0 to the drive + 9.17 back'
    """
    return " + ".join(f"{ms(span_ns)} {what}" for span_ns, what in terms if span_ns)


# --- what makes a line faster ------------------------------------------------------------------------------
#
# The same arithmetic with one change. Drive side first.

FAST_BAUD: Final = 115_200
"""Nearly every drive with RS-485 supports it."""
LEAST_GAIN: Final = 0.05
"""Gain, as a share of the time, below which a change is not proposed."""


class Remedy(Struct, frozen=True):
    """One change, and its effect on the slowest exchange and on a round."""

    what: str
    now: ControllerBudget
    then: ControllerBudget

    @property
    def waited_before_ns(self) -> int:
        """The controller's waiting time for the slowest exchange, without the change."""
        return self.now.longest_ns(waited)

    @property
    def waited_ns(self) -> int:
        """The same with the change."""
        return self.then.longest_ns(waited)

    @property
    def round_before_ns(self) -> int:
        """Duration of a round without the change."""
        return self.now.round.total_ns

    @property
    def round_ns(self) -> int:
        """Duration of a round with the change."""
        return self.then.round.total_ns

    def is_worth_it(self, counted: Callable[[ExchangeBudget], int]) -> bool:
        """Whether the gain is worth proposing, for ``counted`` of an exchange or for a round.

        A faster controller may have to wait longer: its next request comes before the drives' wire has been
        silent. A change that makes anything slower is not proposed.
        """
        if self.waited_ns > self.waited_before_ns or self.round_ns > self.round_before_ns:
            return False
        gains = (
            (self.now.longest_ns(counted), self.then.longest_ns(counted)),
            (self.round_before_ns, self.round_ns),
        )
        return any(before - after > LEAST_GAIN * before for before, after in gains)


def waited(exchange: ExchangeBudget) -> int:
    """Return the controller's waiting time for an exchange, in ns."""
    return exchange.legs.waited_ns


def remedies(
    plan: LinePlan,
    index: int,
    blocks: Blocks = AS_MAPPED,
    counted: Callable[[ExchangeBudget], int] = waited,
) -> tuple[Remedy, ...]:
    """Return what would help controller ``index`` of a line: each change alone, then all together."""
    now = line_budget(plan, blocks).controllers[index]
    found = [
        Remedy(what, now, line_budget(changed, changed_blocks).controllers[index])
        for what, changed, changed_blocks in _changes(plan, index, blocks)
    ]
    return tuple(each for each in found if each.is_worth_it(counted))


def _changes(plan: LinePlan, index: int, blocks: Blocks) -> Iterator[tuple[str, LinePlan, Blocks]]:
    link = plan.controllers[index]
    all_of_it, changes = plan, 0
    if isinstance(plan.drives, SerialEndpoint) and plan.drives.baudrate < FAST_BAUD:
        drives = msgspec.structs.replace(plan.drives, baudrate=FAST_BAUD)
        yield f"drives at {FAST_BAUD} Bd", replace(plan, drives=drives), blocks
        all_of_it, changes = replace(all_of_it, drives=drives), changes + 1
    if isinstance(link.endpoint, SerialEndpoint) and link.endpoint.baudrate < FAST_BAUD:
        links = list(plan.controllers)
        links[index] = replace(link, endpoint=msgspec.structs.replace(link.endpoint, baudrate=FAST_BAUD))
        yield f"{link.plan.name} at {FAST_BAUD} Bd", replace(plan, controllers=tuple(links)), blocks
        all_of_it, changes = replace(all_of_it, controllers=tuple(links)), changes + 1
    if changes > 1:
        yield f"both at {FAST_BAUD} Bd", all_of_it, blocks
    if blocks != AS_MAPPED:
        yield "only the registers of the map", plan, AS_MAPPED


# --- what is impossible, and what is close -----------------------------------------------------------------

MASTER_TIMEOUTS: Final = (
    (50.0, "minimalmodbus and the W1P controllers of Leadshine EL7 drives, with default settings"),
)
"""Usual time-outs of masters in ms, and their owners."""

EACH: Final = 0.3
"""Proposed share of a time-out for the wait for a drive, and for the silence after it."""


class Grade(Enum):
    """Severity of a judgement."""

    IMPOSSIBLE = "impossible"
    """With any software: an error of ``check``."""
    CLOSE = "close"
    """A warning of ``check``."""
    NOTE = "note"
    """Useful before the wiring: only ``budget`` reports it."""


class Judgement(Struct, frozen=True):
    """One judgement on a key."""

    grade: Grade
    key: tuple[str | int, ...]
    found: str
    remedy: str


def judge(plan: LinePlan, blocks: Blocks = AS_MAPPED) -> tuple[Judgement, ...]:
    """Return all judgements on a line."""
    line = line_budget(plan, blocks)
    found = [each for controller in line.controllers for each in _timeouts(plan, controller, blocks)]
    found += (each for axis in plan.axes for each in _deadlines(line, axis))
    found += _starving(plan)
    found += _forwarding_judgements(plan, line)
    return tuple(found)


# --- time-outs of controllers ------------------------------------------------------------------------------


def _timeouts(plan: LinePlan, controller: ControllerBudget, blocks: Blocks) -> Iterator[Judgement]:
    """Yield the most severe judgement on a controller's time-out, for its worst exchange."""
    if not controller.exchanges:
        return
    key = ("line", plan.name, "controllers", controller.index, "timeout_ms")
    limit = controller.timeout_ns
    setting = f"timeout_ms = {limit / NS_PER_MS:g}"
    slowest = max(controller.exchanges, key=lambda each: each.least_ns)
    if slowest.least_ns > limit:
        found = f"{setting}, but {_reply_to(slowest)} comes {_waited(slowest)}"
        yield Judgement(Grade.IMPOSSIBLE, key, found, _faster(plan, controller, blocks))
        return
    slowest = max(controller.exchanges, key=_with_added)
    longest = max(controller.exchanges, key=_with_request)
    if slowest.with_added_ns > limit:
        with_own = f", with frames added by the gateway {ms(slowest.added_ns)} ms later"
        found = f"{setting}, and {_reply_to(slowest)} comes {_waited(slowest)}"
        found += with_own if slowest.added_ns else ""
        yield Judgement(Grade.CLOSE, key, found, _faster(plan, controller, blocks, _with_added))
    elif longest.legs.total_ns > limit:
        found = (
            f"{setting}, and {_exchange(longest)} takes {ms(longest.legs.total_ns)} ms with its "
            "request: too long for a controller that starts its timeout at the first byte it sends"
        )
        yield Judgement(Grade.CLOSE, key, found, _faster(plan, controller, blocks, _with_request))
    else:
        yield from _master_timeouts(plan, controller, blocks)


def _master_timeouts(plan: LinePlan, controller: ControllerBudget, blocks: Blocks) -> Iterator[Judgement]:
    """Yield the masters whose time-out is exceeded only with the gateway."""
    slowest = controller.slowest
    if slowest is None or not controller.wire.is_serial:
        return
    for timeout_ms, whose in MASTER_TIMEOUTS:
        if slowest.direct.waited_ns <= timeout_ms * NS_PER_MS < slowest.legs.waited_ns:
            yield Judgement(
                Grade.NOTE,
                ("line", plan.name, "controllers", controller.index, "timeout_ms"),
                f"{_reply_to(slowest)} comes {_waited(slowest)}, without the gateway "
                f"{ms(slowest.direct.waited_ns)} ms; some masters give up after {timeout_ms:g} ms ({whose})",
                _faster(plan, controller, blocks),
            )


def _with_added(exchange: ExchangeBudget) -> int:
    return exchange.with_added_ns


def _with_request(exchange: ExchangeBudget) -> int:
    return exchange.legs.total_ns


def _exchange(exchange: ExchangeBudget) -> str:
    step = exchange.step
    return f"{step.what.value} of axis {step.axis}" if step.axis else step.what.value


def _reply_to(exchange: ExchangeBudget) -> str:
    return f"the reply to {_exchange(exchange)}"


def _waited(exchange: ExchangeBudget) -> str:
    """Return the arrival time of a reply in words, with the terms of the sum."""
    legs = exchange.legs
    terms = (
        (legs.request_tail_ns, "silence after the request"),
        (legs.gateway_ns, "gateway"),
        (legs.gap_ns, "silence since the exchange before"),
        (legs.request_out_ns, "to the drive"),
        (legs.drive_ns, "drive"),
        (legs.reply_in_ns, "from the drive"),
        (legs.reply_tail_ns, "silence after the reply"),
        (legs.silence_ns, "silence"),
        (legs.reply_out_ns, "to the controller"),
    )
    return f"{ms(legs.waited_ns)} ms after its request ({sum_text(terms)})"


def _faster(
    plan: LinePlan,
    controller: ControllerBudget,
    blocks: Blocks,
    counted: Callable[[ExchangeBudget], int] = waited,
) -> str:
    """Return what to change, its effect on ``counted``, and the present value."""
    ways = []
    for each in remedies(plan, controller.index, blocks, counted):
        before_ns, after_ns = each.now.longest_ns(counted), each.then.longest_ns(counted)
        if after_ns < before_ns:
            ways.append(f"{each.what}: from {ms(before_ns)} to {ms(after_ns)} ms")
    if plan.timing.gap_ms and any(each.legs.gap_ns for each in controller.exchanges):
        ways.append("gap_ms no longer than the drives need, or a controller that pauses as long")
    counted_ns, worst_ns = controller.longest_ns(counted), controller.longest_ns(_with_added)
    need_ms = max(counted_ns, worst_ns) // NS_PER_MS + 1
    whose = ", with frames added by the gateway," if worst_ns > counted_ns else ""
    ways.append(f"let the controller wait longer than {need_ms} ms{whose or ','} if it can")
    return "; ".join((*ways[:-1], f"or {ways[-1]}"))


# --- deadlines of axes -------------------------------------------------------------------------------------


def _deadlines(line: LineBudget, axis: AxisPlan) -> Iterator[Judgement]:
    """Yield whether a target or trigger can be sent before it is late, and arrive before it is stale."""
    if not axis.deadline_ms:
        return
    key, limit = ("axis", axis.name, "deadline_ms"), axis.deadline_ms * NS_PER_MS
    setting = f"deadline_ms = {axis.deadline_ms:g}"
    own_ns = gateway_ns(axis)
    rewriting_ns = sum(
        each.hold_ns for each in line.added if (each.added.axis, each.added.why) == (axis.name, Why.REWRITE)
    )
    before_ns = own_ns + rewriting_ns
    if before_ns > limit:
        terms = sum_text(((own_ns, "gateway (budget_us)"), (rewriting_ns, "target again for its trigger")))
        what = "a trigger" if rewriting_ns else "a target"
        found = f"{setting}, but {what} of this axis may be sent {ms(before_ns)} ms after it came ({terms})"
        remedy = f"allow more than {before_ns // NS_PER_MS + 1} ms, or make the drives' side faster"
        yield Judgement(Grade.IMPOSSIBLE, key, found, remedy)
        return
    there_ns, terms_there = _there(line, axis, own_ns)
    if there_ns > limit:
        found = f"{setting}, and the drive has the whole target {ms(there_ns)} ms "
        found += f"after the gateway ({terms_there})"
        remedy = "a target that is in time when it is sent is too old when it arrives: allow more, "
        remedy += "or make the drives' side faster"
        yield Judgement(Grade.CLOSE, key, found, remedy)


def _there(line: LineBudget, axis: AxisPlan, own_ns: int) -> tuple[int, str]:
    """Return when the last byte of a target is at the drive, counted from its last byte at the gateway."""
    gap_ns, out_ns = max(
        (
            (exchange.legs.gap_ns, exchange.legs.request_out_ns)
            for controller in line.controllers
            for exchange in controller.exchanges
            if (exchange.step.axis, exchange.step.what) == (axis.name, What.TARGET)
        ),
        key=sum,
        default=(0, 0),
    )
    terms = ((own_ns, "gateway"), (gap_ns, "silence since the exchange before"), (out_ns, "to the drive"))
    return own_ns + gap_ns + out_ns, sum_text(terms)


# --- a silent drive ----------------------------------------------------------------------------------------


def _starving(plan: LinePlan) -> Iterator[Judgement]:
    """Yield the motion controllers for which a silent drive delays all others (W6, W7, W11).

    The gateway waits for a drive as long as the requesting controller does, at least ``response_timeout_ms``.
    Then motion frames of another controller wait for ``drain_ms`` of silence. Modbus TCP needs no such
    silence. After the third time-out the drive counts as dead. From then on it costs the others an occasional
    trial, without the silence.
    """
    is_rtu = not isinstance(plan.drives, TcpEndpoint) or plan.drives.rtu
    if not is_rtu or len({axis.unit_id for axis in plan.axes}) < 2:
        return
    timing = plan.timing
    drain_ms = timing.drain_ms or timing.response_timeout_ms
    for index, link in enumerate(plan.controllers):
        others = [other.plan for other in plan.controllers if other is not link]
        if link.plan.role is not Role.MOTION:
            continue
        asks = max(others, key=lambda other: other.timeout_ms, default=None)
        wait_ms, whose = timing.response_timeout_ms, "response_timeout_ms"
        if asks is not None and asks.timeout_ms > wait_ms:
            wait_ms, whose = asks.timeout_ms, f"timeout_ms of {asks.name}"
        if wait_ms + drain_ms < link.plan.timeout_ms:
            continue
        limit_ms = link.plan.timeout_ms
        yield Judgement(
            Grade.CLOSE,
            ("line", plan.name, "controllers", index, "timeout_ms"),
            f"timeout_ms = {limit_ms:g}, and a silent drive keeps writes to others waiting for "
            f"{wait_ms + drain_ms:g} ms ({wait_ms:g} {whose} + {drain_ms:g} drain_ms), "
            + ("three times" if timing.backs_off else "for each request to it"),
            "this controller then gives up on drives that would answer: set response_timeout_ms and "
            f"drain_ms to what the drives need, together below {limit_ms:g} (as in {EACH * limit_ms:g} "
            "each), and timeout_ms of the other controllers no longer than response_timeout_ms",
        )


# --- cut-through -------------------------------------------------------------------------------------------


def _forwarding_judgements(plan: LinePlan, line: LineBudget) -> Iterator[Judgement]:
    """Yield why a line with cut-through must not use it, or gains nothing (W12)."""
    if not plan.cut_through:
        return
    key = ("line", plan.name, "cut_through")
    careless = [axis.name for axis in plan.axes if not axis.checks_crc]
    if careless:
        yield Judgement(
            Grade.IMPOSSIBLE,
            key,
            f"cut_through = true, and the drive of axis {careless[0]} executes or answers frames with a "
            "wrong CRC (checks_crc = false)",
            "a bad frame is sent before the error is found, and only its CRC stops the drive: write "
            "cut_through = false",
        )
        return
    forwardings = [exchange.forwarding for each in line.controllers for exchange in each.exchanges]
    if not any(forwarding.saves_ns for forwarding in forwardings if forwarding is not None):
        yield Judgement(
            Grade.CLOSE,
            key,
            "cut_through = true, but no frame of a round would gain as much as a character",
            "remove it; pitch-gateway budget shows what each frame would gain",
        )


def of_grade(judgements: Sequence[Judgement], *grades: Grade) -> tuple[Judgement, ...]:
    """Return the judgements of these grades."""
    return tuple(each for each in judgements if each.grade in grades)
