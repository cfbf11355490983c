"""What one controller may send within its role: its rights, looked up by the head of a request.

The head of a request names the registers that it touches. A verdict belongs to a unit id and a head; it is
found once and cached, like the fast paths.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gateway.exchange.access import (
    ACCESS,
    HEAD_BYTES,
    MONITOR_FUNCTIONS,
    READ_DEVICE_IDENTIFICATION,
    only_reads,
)
from gateway.exchange.rights import UNLIMITED, RegisterSpan, Rights
from gateway.limits import TokenBucket
from gateway.modbus.pdu import (
    BROADCAST_UNIT_ID,
    MEI_CANOPEN_GENERAL_REFERENCE,
    ExceptionCode,
    FunctionCode,
)
from gateway.times import NS_PER_S

REMEMBERED: Final = 4096
"""Number of request heads whose verdict is remembered; a controller uses a few dozen."""
BURST_NS: Final = NS_PER_S
"""Burst after a pause: the requests allowed in this time may come together."""

_READS_BITS: Final = frozenset({FunctionCode.READ_COILS, FunctionCode.READ_DISCRETE_INPUTS})
_READS_REGISTERS: Final = frozenset(
    {FunctionCode.READ_HOLDING_REGISTERS, FunctionCode.READ_INPUT_REGISTERS, 0x17}
)
_OBJECT: Final = bytes((FunctionCode.ENCAPSULATED_INTERFACE_TRANSPORT, MEI_CANOPEN_GENERAL_REFERENCE))
"""Beginning of requests that read or write one object. Where they are allowed, the index of the object is
their address."""
_ADDRESSED: Final = frozenset({0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F, 0x10, 0x16, 0x17})
"""Function codes whose requests name the addresses that they touch."""
_WITHOUT_ADDRESSES: Final = frozenset({0x07, 0x0B, 0x0C, 0x11})
"""Function codes that touch no address: exception status, event counter and log, server id."""


class Denial(NamedTuple):
    """Why a request is not allowed."""

    code: int
    """Exception code; 0x0A is silence for a serial controller (W7)."""
    key: str
    """The configuration key that forbids it."""
    detail: str
    """What is not allowed."""


class Gate:
    """The rights of one controller, over all its connections.

    Args:
        rights: the part of its role's rights that it has.
        axis_unit_ids: the unit ids that a broadcast certainly reaches; None: 0 is a unit id like others.
    """

    def __init__(self, rights: Rights, axis_unit_ids: frozenset[int] | None = None) -> None:
        self._rights = rights
        self._axis_unit_ids = axis_unit_ids
        self._verdicts: dict[int, dict[bytes, tuple[int, Denial | None]]] = {}
        self._verdicts_left = REMEMBERED
        self._rate: TokenBucket | None = None
        if rights.requests_per_s:
            self._rate = TokenBucket(int(NS_PER_S / rights.requests_per_s), BURST_NS)

    def denial(self, unit_id: int, pdu: bytes, *, is_odd: bool = False) -> Denial | None:
        """Return why a request is not allowed; None: it is.

        ``is_odd``: its length does not fit its function code, so it counts as a write. That depends only on
        unit id, head and length, so the verdict can be cached.
        """
        head = pdu[: HEAD_BYTES[pdu[0]]]
        verdicts = self._verdicts.get(unit_id)
        if verdicts is not None and head in verdicts:
            size, denial = verdicts[head]
            if size == len(pdu):
                return denial
        return self._judge_and_cache(unit_id, pdu, head, is_odd=is_odd)

    def is_too_often(self, now_ns: int) -> bool:
        """Count a request; return whether it exceeds ``requests_per_s``."""
        return self._rate is not None and not self._rate.takes(now_ns)

    @property
    def too_often(self) -> Denial:
        """The refusal of a request that exceeds the rate."""
        detail = f"more than {self._rights.requests_per_s:g} requests in a second"
        return Denial(ExceptionCode.SERVER_DEVICE_BUSY, "requests_per_s", detail)

    def _judge_and_cache(self, unit_id: int, pdu: bytes, head: bytes, *, is_odd: bool) -> Denial | None:
        denial = self._judge(unit_id, pdu, is_odd=is_odd)
        if head:
            if not self._verdicts_left:
                self._verdicts.clear()
                self._verdicts_left = REMEMBERED
            self._verdicts_left -= 1
            self._verdicts.setdefault(unit_id, {})[head] = (len(pdu), denial)
        return denial

    def _judge(self, unit_id: int, pdu: bytes, *, is_odd: bool) -> Denial | None:
        rights, function = self._rights, pdu[0]
        if rights.function_codes and function not in rights.function_codes:
            return Denial(ExceptionCode.ILLEGAL_FUNCTION, "function_codes", f"function code {function}")
        if rights.unit_ids and not self._may_reach(unit_id):
            detail = f"unit id {unit_id}"
            if unit_id == BROADCAST_UNIT_ID and self._axis_unit_ids is not None:
                detail = "a broadcast, which reaches every unit id"
            return Denial(ExceptionCode.GATEWAY_PATH_UNAVAILABLE, "unit_ids", detail)
        if rights.is_read_only and (is_odd or not only_reads(pdu)):
            return Denial(ExceptionCode.ILLEGAL_FUNCTION, "read_only", "a request that may write")
        if rights.readable or rights.writable:
            return self._judge_addresses(pdu, is_odd=is_odd)
        return None

    def _may_reach(self, unit_id: int) -> bool:
        allowed = self._rights.unit_ids
        if unit_id != BROADCAST_UNIT_ID or self._axis_unit_ids is None:
            return unit_id in allowed
        return unit_id in allowed and self._axis_unit_ids <= allowed

    def _judge_addresses(self, pdu: bytes, *, is_odd: bool) -> Denial | None:
        rights, function = self._rights, pdu[0]
        if not is_odd and (function in _WITHOUT_ADDRESSES or pdu[:2] == READ_DEVICE_IDENTIFICATION):
            return None
        is_object = pdu[:2] == _OBJECT and function in rights.function_codes
        if function not in _ADDRESSED and not is_object:
            is_read = function in MONITOR_FUNCTIONS and not is_odd
            if function in rights.function_codes or (is_read and not rights.readable):
                return None
            detail = f"function code {function}, whose addresses are unknown; name it there"
            return Denial(ExceptionCode.ILLEGAL_FUNCTION, "function_codes", detail)
        touched = _touched(pdu)
        if touched is None:
            key = "writable" if rights.writable else "readable"
            detail = "a request that contradicts itself: its addresses are unknown"
            return Denial(ExceptionCode.ILLEGAL_DATA_ADDRESS, key, detail)
        read, written = touched
        if read is not None and rights.readable and not _is_inside(read, rights.readable):
            return Denial(ExceptionCode.ILLEGAL_DATA_ADDRESS, "readable", f"reading {_shown(read)}")
        if written is not None and rights.writable and not _is_inside(written, rights.writable):
            return Denial(ExceptionCode.ILLEGAL_DATA_ADDRESS, "writable", f"writing {_shown(written)}")
        return None


UNSEEN: Final = Gate(UNLIMITED)
"""The gate of a connection that has not sent a request yet."""


def _touched(pdu: bytes) -> tuple[RegisterSpan | None, RegisterSpan | None] | None:
    """Return what a request reads and what it writes; None: it contradicts itself."""
    function, size = pdu[0], len(pdu)
    if function in _READS_BITS:
        return (_span(_u16(pdu, 1), _u16(pdu, 3)), None) if size == 5 else None
    if function == FunctionCode.WRITE_SINGLE_COIL:
        return (None, _span(_u16(pdu, 1), 1)) if size == 5 else None
    if function == FunctionCode.WRITE_MULTIPLE_COILS:
        is_whole = size > 6 and pdu[5] == size - 6 == (_u16(pdu, 3) + 7) // 8
        return (None, _span(_u16(pdu, 1), _u16(pdu, 3))) if is_whole else None
    access = ACCESS[function](pdu)
    if access is None or not access.is_consistent:
        return None
    if access.is_mei:
        written = _span(access.write_address, 1) if access.write_quantity else None
        return (None if written else _span(access.read_address, 1)), written
    read = _span(access.read_address, access.read_quantity) if function in _READS_REGISTERS else None
    return read, _span(access.write_address, access.write_quantity) if access.write_quantity else None


def _span(address: int, quantity: int) -> RegisterSpan:
    return RegisterSpan(address, address + max(quantity, 1) - 1)


def _is_inside(span: RegisterSpan, allowed: Sequence[RegisterSpan]) -> bool:
    return any(each.first <= span.first and span.last <= each.last for each in allowed)


def _shown(span: RegisterSpan) -> str:
    first = f"0x{span.first:04X}"
    return f"address {first}" if span.first == span.last else f"addresses {first} to 0x{span.last:04X}"


def _u16(pdu: bytes, offset: int) -> int:
    return pdu[offset] << 8 | pdu[offset + 1]
