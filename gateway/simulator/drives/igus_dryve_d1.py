"""igus dryve D1: CANopen objects in function code 43, MEI type 13.

Source: igus, dryve D1 operating manual, chapter on Modbus TCP gateway, and igus's own example program. CiA
402 for the meaning of the objects; CiA 309-2 for the frame.

A request is 2B 0D, read or write (0, 1), two zero bytes, index, subindex, three zero bytes, the number of
data bytes, the data with its lowest byte first. What the drive answers to an object that it does not have is
not in the sources: here exception 02, and 03 for a wrong length. Not simulated: a set-point that waits for
the one under way (every one is taken at once), velocity mode (a target speed is noted), short numbers of the
target, which published programs write and of which no source says what they mean.
"""

from collections.abc import Sequence
from struct import unpack_from
from typing import Final

from gateway.simulator.drives.device_control import RELATIVE, DeviceControl, Order402
from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of
from gateway.simulator.ledger import WriteRecord
from gateway.simulator.server import ILLEGAL_ADDRESS, ILLEGAL_VALUE, check

MEI: Final = 0x0D
HEAD: Final = 12
READ: Final = 0
WRITE: Final = 1
CONTROL: Final = 0x6040
STATUS: Final = 0x6041
MODE: Final = 0x6060
MODE_SHOWN: Final = 0x6061
ACTUAL: Final = 0x6064
TARGET: Final = 0x607A
SPEED: Final = 0x60FF
POSITION_MODE: Final = 1
SPEED_MODE: Final = 3
HOME_MODE: Final = 6
SIZES: Final = {
    **dict.fromkeys(((CONTROL, 0), (STATUS, 0)), 2),
    **dict.fromkeys(((MODE, 0), (MODE_SHOWN, 0), (0x6098, 0)), 1),
    **dict.fromkeys(
        ((index, 0) for index in (ACTUAL, TARGET, 0x607C, 0x6081, 0x6083, 0x6084, 0x609A, SPEED)), 4
    ),
    **dict.fromkeys(((0x6092, 1), (0x6092, 2), (0x6099, 1), (0x6099, 2)), 4),
}
WRITABLE: Final = SIZES.keys() - {(STATUS, 0), (MODE_SHOWN, 0), (ACTUAL, 0)}


class IgusDryveD1(MotorDrive):
    """See the module. Writes are recorded with the object's index as their address."""

    functions = frozenset({43})

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self._handlers[43] = self._transfer
        self._control = DeviceControl(steps=True)
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
        if index == CONTROL:
            self._command(self._get(CONTROL), now_s)
        if index == SPEED and self._get(MODE) == SPEED_MODE and self._control.is_enabled:
            self.motor.other()
        self.show()
        return pdu[: HEAD - 1] + b"\x00"

    def show(self) -> None:
        """See :class:`MotorDrive`."""
        motor, control = self.motor, self._control
        self._put(ACTUAL, motor.actual_counts)
        self._objects[MODE_SHOWN, 0] = self._objects[MODE, 0]
        is_home = self._get(MODE) == HOME_MODE
        state = bits_of(
            b3=motor.has_alarm,
            b9=True,
            b10=motor.is_done,
            b12=motor.is_homed and motor.is_done if is_home else control.has_acknowledged,
        )
        self._put(STATUS, control.state.value | state)

    def _get(self, index: int) -> int:
        return int.from_bytes(self._objects[index, 0], "little", signed=index in (TARGET, ACTUAL, MODE))

    def _put(self, index: int, value: int) -> None:
        size = SIZES[index, 0]
        self._objects[index, 0] = (value & ((1 << 8 * size) - 1)).to_bytes(size, "little")

    def _command(self, word: int, now_s: float) -> None:
        match self._control.write(word):
            case Order402.FAULT_RESET:
                self.motor.mechanics.alarm = False
            case Order402.STOP:
                self.motor.stop(now_s)
            case Order402.START:
                self._start(word, now_s)

    def _start(self, word: int, now_s: float) -> None:
        mode = self._get(MODE)
        if mode == HOME_MODE:
            self.motor.home(now_s)
        elif mode != POSITION_MODE:
            self.motor.other()
        elif word & RELATIVE:
            self.motor.relative(self._get(TARGET), Basis.COMMANDED, now_s)
        else:
            self.motor.absolute(self._get(TARGET), now_s)
