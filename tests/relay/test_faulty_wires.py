"""Ports and links over wires with faults: whatever happens to the bytes, no reply is invented or mixed up."""

import pytest

from gateway.exchange.line import LineExchange
from gateway.exchange.plan import ControllerPlan, LineTiming
from gateway.modbus.mbap import MbapCounters, MbapDecoder, encode_mbap
from gateway.modbus.rtu import RtuReplyDecoder, RtuRequestDecoder, encode_rtu
from gateway.relay.alarm import LineAlarm
from gateway.relay.controller_port import MbapControllerPort
from gateway.relay.drive_link import MbapDriveLink, RtuDriveLink
from gateway.relay.pulse import Beats
from gateway.transport import memory
from gateway.transport.memory import NO_FAULTS, Faults
from tests.support.relay import RawEnd

REQUESTS = 20
NO_RESPONSE = bytes([0x83, 0x0B])


class NumberingDrive:
    """Answers a read of register N with the value N, and keeps what it was asked."""

    def __init__(self) -> None:
        self._decoder = RtuRequestDecoder()
        self.asked: list[int] = []

    def __call__(self, data: bytes) -> bytes:
        replies = b""
        for unit_id, pdu in self._decoder.feed(data, 0):
            self.asked.append(int.from_bytes(pdu[1:3], "big"))
            replies += encode_rtu(unit_id, bytes([3, 2]) + pdu[1:3])
        return replies


def ignore(event: object) -> None:
    pass


async def run(
    drive_side: tuple[RtuDriveLink | MbapDriveLink, RawEnd, Faults, Faults],
    near_faults: Faults,
    timeout_ms: float,
) -> bytes:
    """Send numbered reads over the given wires, one after the other; return the replies."""
    link, far, to_drive, from_drive = drive_side
    near = RawEnd()
    timing = LineTiming(response_timeout_ms=timeout_ms, drain_ms=5.0)
    line = LineExchange((), timing, link, ignore)
    alarm = LineAlarm(line, lambda: 0)
    link.attach(line)
    plan = ControllerPlan("cnc", timeout_ms=timeout_ms)
    port = MbapControllerPort(plan, line, MbapCounters(), ignore, beats=Beats())
    memory.connect(link, far, to_drive, from_drive)
    memory.connect(port, near, NO_FAULTS, near_faults)
    for number in range(REQUESTS):
        count = len(near.data)
        near.write(encode_mbap(number, 1, bytes([3, 0, number, 0, 1])))
        await near.until(lambda end, count=count: len(end.data) >= count + 9)  # type: ignore[misc]
    alarm.close()
    link.close()
    return near.data


@pytest.mark.parametrize("seed", range(3))
async def test_splits_and_glue_change_nothing(seed: int) -> None:
    drive = NumberingDrive()
    split = Faults(seed=seed, split=0.7)
    link = RtuDriveLink(0, RtuReplyDecoder())
    data = await run((link, RawEnd(drive), split, Faults(split=1.0)), split, 2000.0)
    assert data == b"".join(encode_mbap(n, 1, bytes([3, 2, 0, n])) for n in range(REQUESTS))
    assert drive.asked == list(range(REQUESTS))


@pytest.mark.parametrize("seed", range(3))
async def test_no_damage_makes_a_reply_answer_another_request(seed: int) -> None:
    drive = NumberingDrive()
    bad = Faults(seed=seed, drop=0.01, garble=0.01, split=0.3)
    link = RtuDriveLink(0, RtuReplyDecoder())
    data = await run((link, RawEnd(drive), NO_FAULTS, bad), NO_FAULTS, 150.0)
    replies = MbapDecoder().feed(data)
    assert [number for number, _, _ in replies] == list(range(REQUESTS))
    silent = [number for number, _, pdu in replies if pdu == NO_RESPONSE]
    assert 0 < len(silent) < REQUESTS
    assert all(pdu == bytes([3, 2, 0, number]) for number, _, pdu in replies if number not in silent)
    assert drive.asked == list(range(REQUESTS))  # nothing was sent twice


async def test_a_reply_that_comes_an_exchange_too_late_is_never_taken() -> None:
    """By the transaction id; on a serial line only silence tells (a reply looks like the next one's)."""

    def drive(data: bytes) -> bytes:
        return data[:5] + bytes([5]) + data[6:7] + bytes([3, 2]) + data[8:10]

    late = Faults(delay_writes=1)
    data = await run((MbapDriveLink(0), RawEnd(drive), NO_FAULTS, late), NO_FAULTS, 15.0)
    assert data == b"".join(encode_mbap(number, 1, NO_RESPONSE) for number in range(REQUESTS))
