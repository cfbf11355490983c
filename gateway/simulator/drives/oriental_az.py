"""Oriental Motor AZ series (AZD-KD, AZD-CD, AZ mini).

Source: Oriental Motor HM-60262 (AZ series function manual): direct data operation, remote input and output,
operation types of page 59; the preset of the sister series.

Simulated: direct data operation with every trigger, absolute and relative moves (pushes among them), stored
data, all inputs at their default addresses, preset, the transmission wait of 3 ms, slave errors. Continuous
operation (7, 16 to 18) and wrap operation (8 to 15) are recorded and do not turn the motor; values that are
no listed type are refused with 04. Not simulated: indirect references, the data destination of 0x0068, other
orders of words and bytes, SSTART's position in a chain of data (it runs No. 0).
"""

from collections.abc import Mapping, Sequence
from typing import Final

from gateway.simulator.drives.motor_drive import Basis, Motor, MotorDrive, bits_of, signed
from gateway.simulator.server import EXECUTION_FAILED, ModbusExceptionError

DATA: Final = 0x0058
TYPE: Final = 0x005A
POSITION: Final = 0x005C
TRIGGER: Final = 0x0066
FIELDS: Final = {-7: 0x0058, -6: 0x005A, -5: 0x005C, -4: 0x005E, -3: 0x0060, -2: 0x0062, -1: 0x0064}
"""Trigger value -> the field of direct data whose writing starts the motion."""
ALL_DATA: Final = 1
INPUT: Final = 0x007D
OUTPUT: Final = 0x007F
ALARM: Final = 0x0080
COMMANDED: Final = 0x00C6
ACTUAL: Final = 0x00CC
ACTUAL_MIRROR: Final = 0x0120
COMMANDED_MIRROR: Final = 0x0122
HOME_END: Final = 0x0178
PRESET: Final = 0x018A
PRESET_POSITION: Final = 0x038C
STORED_TYPE: Final = 0x1800
DATA_STRIDE: Final = 64

NUMBER: Final = 0x0007
"""M0 to M2: the number of the stored data that START runs."""
START: Final = 1 << 3
ZHOME: Final = 1 << 4
STOP: Final = 1 << 5
FREE: Final = 1 << 6
ALARM_RESET: Final = 1 << 7
D_SEL: Final = 0x0700
"""Each input runs one stored data number: No. 0 to 2."""
SSTART: Final = 1 << 11
JOGS: Final = 0x3000
TURNS: Final = 0xC000
"""FW-POS and RV-POS: for as long as they are on."""

RELATIVE: Final[Mapping[int, Basis]] = {
    2: Basis.COMMANDED,
    3: Basis.ACTUAL,
    21: Basis.COMMANDED,
    22: Basis.ACTUAL,
}
CONTINUOUS: Final = frozenset({7, 16, 17, 18})
WRAPS: Final = frozenset(range(8, 16))

WAIT_S: Final = 0.003


class OrientalAz(MotorDrive):
    """A simulated AZ series driver.

    With ``is_busy`` every write is a slave error, as while the drive saves its memory. With
    ``suppresses_slave_errors`` such a refusal looks like a success.
    """

    functions = frozenset({3, 6, 8, 16})
    absolute: frozenset[int] = frozenset({1, 20})
    relative = RELATIVE
    turning = CONTINUOUS | WRAPS

    def __init__(self, unit_id: int, motors: Sequence[Motor]) -> None:
        super().__init__(unit_id, motors)
        self.is_busy = False
        self.suppresses_slave_errors = False

    def answer(self, pdu: bytes, now_s: float) -> bytes | None:
        reply = super().answer(pdu, now_s)
        if self.suppresses_slave_errors and reply == bytes((pdu[0] | 0x80, EXECUTION_FAILED)):
            return pdu[:5]
        return reply

    def response_delay_s(self, baudrate: int) -> float:
        """Return the transmission wait time (default 3.0 ms)."""
        return WAIT_S

    def before_write(self, address: int, count: int, now_s: float) -> None:
        if self.is_busy:
            raise ModbusExceptionError(EXECUTION_FAILED)

    def show(self) -> None:
        motor = self.motor
        for address in (COMMANDED, COMMANDED_MIRROR, ACTUAL, ACTUAL_MIRROR):
            self.put32(address, motor.actual_counts)
        self.put32(ALARM, int(motor.has_alarm))
        self.show_outputs()

    def show_outputs(self) -> None:
        """Write the state to this series' registers."""
        motor = self.motor
        state = bits_of(
            b5=motor.is_done and self.is_excited,
            b7=motor.has_alarm,
            b8=self.is_busy,
            b13=motor.is_moving,
            b14=motor.is_done,
        )
        self.image.set_word(OUTPUT, state)
        self.image.set_word(HOME_END, int(motor.is_homed))

    @property
    def is_excited(self) -> bool:
        """Whether the motor is energised."""
        return not self.image.word(INPUT) & FREE

    def written(self, before: dict[int, int], now_s: float) -> None:
        """Handle written registers.

        Data are stored before the drive refuses to run them: an exception proves nothing.
        """
        if PRESET + 1 in before and self.image.word(PRESET + 1):
            self.motor.set_position(self.get32(PRESET_POSITION), now_s)
        if INPUT in before:
            self.inputs(self.image.word(INPUT), before[INPUT], now_s)
        trigger = self.trigger()
        if TRIGGER + 1 in before and trigger == ALL_DATA:
            self.consume_trigger(before)
        elif TRIGGER + 1 in before and trigger and trigger not in FIELDS:
            self.unheard_of(TRIGGER + 1, self.image.word(TRIGGER + 1))
            return
        elif trigger not in FIELDS or not {FIELDS[trigger], FIELDS[trigger] + 1} & before.keys():
            return
        self.run(self.get32(TYPE), self.get32(POSITION), now_s)

    def trigger(self) -> int:
        """Return the trigger in force."""
        return self.get32(TRIGGER)

    def consume_trigger(self, before: dict[int, int]) -> None:
        """Clear a trigger that was executed."""
        self.put32(TRIGGER, 0)

    def inputs(self, word: int, before: int, now_s: float) -> None:
        """Handle changed inputs of the driver."""
        risen = word & ~before
        if risen & ALARM_RESET:
            self.motor.mechanics.alarm = False
        if risen & (STOP | FREE):
            self.motor.stop(now_s)
        elif risen & START:
            self.run_stored(word & NUMBER, now_s)
        elif risen & ZHOME:
            self.check_ready()
            self.motor.home(now_s)
        elif risen & D_SEL:
            self.run_stored((risen & D_SEL).bit_length() - 9, now_s)
        elif risen & SSTART:
            self.run_stored(0, now_s)
        elif risen & (JOGS | TURNS):
            self.check_ready()
            self.motor.other()
        elif before & ~word & TURNS:
            self.motor.stop(now_s)

    def run_stored(self, number: int, now_s: float) -> None:
        """Start the stored operation of this number."""
        address = STORED_TYPE + DATA_STRIDE * number
        self.run(self.get32(address), self.get32(address + 2), now_s)

    def check_ready(self) -> None:
        """Refuse to move without motor current, with an alarm, or while STOP is on."""
        if not self.is_excited or self.motor.has_alarm or self.image.word(INPUT) & STOP:
            raise ModbusExceptionError(EXECUTION_FAILED)

    def run(self, operation_type: int, position: int, now_s: float) -> None:
        """Start an operation."""
        self.check_ready()
        if operation_type in self.absolute:
            self.motor.absolute(position, now_s)
        elif operation_type in self.relative:
            self.motor.relative(position, self.relative[operation_type], now_s)
        elif operation_type in self.turning:
            self.motor.other()
        else:
            self.unheard_of(TYPE + 1, operation_type)
            raise ModbusExceptionError(EXECUTION_FAILED)


def trigger_of_low_word(word: int) -> int:
    """Return the trigger from the lower half of its register pair.

    >>> trigger_of_low_word(0xFFFB)
    -5
    """
    return signed(word, 16)
