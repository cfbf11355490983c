"""igus dryve D1: CANopen objects in function code 43, MEI type 13.

Source: igus, dryve D1 operating manual, chapter on Modbus TCP gateway, and igus's own example program. CiA
402 for the meaning of the objects; CiA 309-2 for the frame.

A request is 2B 0D, read or write (0, 1), two zero bytes, index, subindex, three zero bytes, the number of
data bytes, the data with its lowest byte first. The sources do not say how the drive answers for an object
that it does not have: here exception 02, and 03 for a wrong length. Not simulated: a set-point that waits for
the present one (each takes effect immediately), velocity mode (a target speed is recorded), short numbers of
the target, which published programs write and no source explains.
"""

from collections.abc import Sequence
from struct import unpack_from
from typing import Final

from gateway.simulator.drives.cia402 import (
    ACTUAL,
    CONTROL,
    METHOD,
    MODE,
    MODE_SHOWN,
    POSITION_MODE,
    STATUS,
    TARGET,
    Drive402,
)
from gateway.simulator.drives.motor_drive import Motor
from gateway.simulator.ledger import WriteRecord
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, check

MEI: Final = 0x0D
HEAD: Final = 12
READ: Final = 0
WRITE: Final = 1
SPEED: Final = 0x60FF
SIZES: Final = {
    **dict.fromkeys(((CONTROL, 0), (STATUS, 0)), 2),
    **dict.fromkeys(((MODE, 0), (MODE_SHOWN, 0), (METHOD, 0)), 1),
    **dict.fromkeys(
        ((index, 0) for index in (ACTUAL, TARGET, 0x607C, 0x6081, 0x6083, 0x6084, 0x609A, SPEED)), 4
    ),
    **dict.fromkeys(((0x6092, 1), (0x6092, 2), (0x6099, 1), (0x6099, 2)), 4),
}
WRITABLE: Final = SIZES.keys() - {(STATUS, 0), (MODE_SHOWN, 0), (ACTUAL, 0)}


class IgusDryveD1(Drive402):
    """A simulated dryve D1. Writes are recorded with the object's index as their address."""

    functions = frozenset({43})
    run_objects = frozenset({SPEED})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._handlers[43] = self._transfer
        self._objects = {key: bytes(size) for key, size in SIZES.items()}
        self._put(MODE, POSITION_MODE)

    def _transfer(self, pdu: bytes, now_s: float) -> bytes:
        check(len(pdu) >= HEAD and pdu[1] == MEI, ILLEGAL_VALUE)
        way, index, sub, size = pdu[2], *unpack_from(">HB", pdu, 5), pdu[11]
        check((index, sub) in SIZES, ILLEGAL_ADDRESS)
        check(way in (READ, WRITE) and len(pdu) == HEAD + (size if way == WRITE else 0), ILLEGAL_VALUE)
        check(size == SIZES[index, sub], ILLEGAL_VALUE)
        self.refresh(now_s)
        if way == READ:
            return pdu[:HEAD] + self._objects[index, sub]
        check((index, sub) in WRITABLE, ILLEGAL_ADDRESS)
        self.ledger.writes.append(WriteRecord(self.unit_id, 43, index, pdu[HEAD:], now_s))
        self._objects[index, sub] = pdu[HEAD:]
        self.objects_written([index], now_s)
        return pdu[: HEAD - 1] + b"\x00"

    def show(self) -> None:
        self._put(ACTUAL, self.motor.actual_counts)
        self._objects[MODE_SHOWN, 0] = self._objects[MODE, 0]
        self._put(STATUS, self.status())

    def number(self, index: int) -> int:
        return int.from_bytes(self._objects[index, 0], "little", signed=index in (TARGET, ACTUAL, MODE))

    def _put(self, index: int, value: int) -> None:
        size = SIZES[index, 0]
        self._objects[index, 0] = (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")
