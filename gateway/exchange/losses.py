"""Requests that were lost on the way, and replies to the gateway's own frames."""

from typing import Final, NamedTuple

from gateway.exchange import parts
from gateway.exchange.added_frames import Purpose, learn, note_restaged
from gateway.exchange.answering import fail
from gateway.exchange.axis import AxisExchange
from gateway.exchange.counters import LineCounters
from gateway.exchange.dispatch import Units, access_of
from gateway.exchange.effects import block
from gateway.exchange.events import EventKind
from gateway.exchange.known import Known
from gateway.exchange.life import Exchange
from gateway.exchange.meaning import meanings
from gateway.modbus.pdu import ExceptionCode, is_exception
from gateway.times import NS_PER_S

RESTAGED_EVERY_NS: Final = 60 * NS_PER_S
"""How often restaging is reported; all of it is counted."""


class Unsent(NamedTuple):
    """A request that never reached the drive."""

    unit_id: int
    pdu: bytes
    arrived_ns: int


def note_learned(exchange: Exchange, reply: bytes, counters: LineCounters, now_ns: int) -> int | None:
    """Take note of the reply to a frame of the gateway's own.

    Returns:
        The exception code with which the request that it was for is refused; None when it can go on.
    """
    frame = exchange.added
    assert frame is not None
    exchange.known = exchange.known or Known()
    if frame.purpose is not Purpose.RESTAGE:
        counters.added_reads += 1
        if frame.purpose is Purpose.LOOK:
            exchange.excused_ns += now_ns - exchange.sent_ns
        learn(frame, reply, exchange.known, exchange.sent_ns)
        return None
    assert frame.rendering is not None
    if frame.is_acknowledged(reply):
        counters.restaged += 1
        note_restaged(frame)
        _tell_restaged(frame.axis, counters.restaged, now_ns)
        return None
    code = reply[1] if len(reply) == 2 and is_exception(reply) else ExceptionCode.SERVER_DEVICE_FAILURE
    frame.rendering.shadow.tear()
    frame.axis.motion.block(code)
    frame.axis.tell(EventKind.AXIS_BLOCKED, "the drive refused the staged target when it was written anew")
    return code


def _tell_restaged(axis: AxisExchange, count: int, now_ns: int) -> None:
    """Report restaging now and then: where an axis goes to and fro, every second move needs it."""
    told_ns = axis.motion.told_restaged_ns
    if told_ns is None or now_ns - told_ns >= RESTAGED_EVERY_NS:
        axis.motion.told_restaged_ns = now_ns
        detail = f"a staged target was written anew for its trigger; {count} on this line since the start"
        axis.tell(EventKind.RESTAGED, detail)


def lose(exchange: Exchange, code: int, now_ns: int) -> None:
    """Take note of an exchange whose reply never came."""
    frame = exchange.added
    if frame is None:
        for rewriting in exchange.rewritings:
            fail(rewriting, code, now_ns, is_refusal=False)
    elif frame.rendering is not None:
        frame.rendering.shadow.tear()
        frame.axis.motion.block(code)
        frame.axis.tell(EventKind.AXIS_BLOCKED, "nobody knows whether the staged target was written anew")


def lose_of_axis(units: Units, axis: AxisExchange, lost: Unsent, code: int) -> None:
    """Note for one axis that a request never reached its drive, as :func:`note_unsent` does for all."""
    access = access_of(lost.pdu)
    for unit in units.reached(lost.unit_id):
        if access is not None and access.write_quantity:
            for hit in unit.written(access.write_address, access.write_quantity).fields:
                if hit.place.axis is axis:
                    parts.note_lost(hit, lost.pdu, access, lost.arrived_ns)
        if unit.has_rules:
            for meaning in meanings(unit, lost.pdu, access):
                if meaning.axis is axis:
                    block(meaning, code)


def note_unsent(units: Units, exchange: Exchange, code: int) -> None:
    """Note that a request never reached the drive: what it wrote is lost, and torn from the rest (M3)."""
    access = access_of(exchange.pdu)
    for unit in units.reached(exchange.unit_id):
        if access is not None and access.write_quantity:
            parts.note_unsent(unit, exchange.pdu, access, exchange.arrived_ns)
        if unit.has_rules:
            for meaning in meanings(unit, exchange.pdu, access):
                block(meaning, code)
