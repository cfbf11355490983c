"""A drive that waits for a trigger, on the bench. It records its writes and its moves."""

from dataclasses import replace
from typing import Any

from gateway.drives.motion import Action, ModePlan, MotionPlan, Operation, TriggerPlan
from gateway.exchange.plan import AxisPlan
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.exchange.line_bench import ACTUAL, COMMAND, MOVE_MS, Bench, Memory, axis_plan, read, write

TRIGGER = 0x050E
MODE = 0x0700
STATUS = 0x005C
DONE_BIT, HOMED_BIT, MOVING_BIT, ALARM_BIT = 4, 8, 5, 6
COMMANDED = PositionField(0x0522, RegisterType.INT32, WordOrder.LOW_FIRST)

RUN, RUN_RELATIVE, STOP, HOME, ZERO, STORED, JOG = 1, 2, 1000, 100, 101, 200, 300
RUN_PDU = bytes.fromhex("06 050E 0001")
RUN_RELATIVE_PDU = bytes.fromhex("06 050E 0002")
STOP_PDU = bytes.fromhex("06 050E 03E8")
HOME_PDU = bytes.fromhex("06 050E 0064")
ZERO_PDU = bytes.fromhex("06 050E 0065")
STORED_PDU = bytes.fromhex("06 050E 00C8")
JOG_PDU = bytes.fromhex("06 050E 012C")

DEEDS = {
    RUN: Operation(Action.ABSOLUTE),
    RUN_RELATIVE: Operation(Action.RELATIVE_TO_COMMANDED),
    STOP: Operation(Action.STOP),
    HOME: Operation(Action.HOME),
    ZERO: Operation(Action.SET_POSITION),
    STORED: Operation(Action.STORED),
    JOG: Operation(Action.OTHER_MOTION),
    0: Operation(Action.IGNORE),
}
STAGED = MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, deeds=DEEDS),))
ONLY_ABSOLUTE = MotionPlan(
    is_staged=True,
    triggers=(TriggerPlan(TRIGGER, deeds={v: d for v, d in DEEDS.items() if v != RUN_RELATIVE}),),
)
"""The same drive where nothing but an absolute position can be meant."""
BITS = {
    "done": BitField(STATUS, DONE_BIT),
    "homed": BitField(STATUS, HOMED_BIT),
    "moving": BitField(STATUS, MOVING_BIT),
    "alarm": BitField(STATUS, ALARM_BIT),
}


def relative_by(base: Action, **changes: object) -> MotionPlan:
    """Return the motion of a drive that counts its distances from another base."""
    deeds = {**STAGED.triggers[0].deeds, 2: Operation(base)}
    return MotionPlan(is_staged=True, triggers=(TriggerPlan(TRIGGER, deeds=deeds),), **changes)  # type: ignore[arg-type]


def sticky(**changes: Any) -> MotionPlan:
    """Return the motion of a staged drive with a mode register; its trigger only starts the move."""
    mode = ModePlan(MODE, actions={1: Action.ABSOLUTE, 2: Action.RELATIVE, 3: Action.OTHER_MOTION})
    triggers = (TriggerPlan(TRIGGER, deeds={**DEEDS, RUN: Operation(Action.START)}),)
    return replace(STAGED, modes=(mode,), triggers=triggers, **changes)


def staged_plan(**changes: Any) -> AxisPlan:
    """The axis of ``line_bench`` with a drive that waits for its trigger."""
    plan = {"motion": STAGED, "bits": BITS, "commanded": (COMMANDED,)} | changes
    return axis_plan(**plan)


class StagedDrive(Memory):
    """Plain memory with a motor: the trigger starts a move. It records its moves."""

    def __init__(self) -> None:
        super().__init__()
        self.moves: list[tuple[str, float]] = []
        """Kind of each move, and where it ended or was to end, in counts."""
        self.is_running = False
        self.write(STATUS, (1 << HOMED_BIT | 1 << DONE_BIT).to_bytes(2, "big"))

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        for word in range(len(data) // 2):
            if address + word == TRIGGER:
                self.act(int.from_bytes(data[2 * word : 2 * word + 2], "big"))

    def act(self, value: int) -> None:
        """Execute the content of the trigger register."""
        target = self.get(COMMAND)
        if value == RUN_RELATIVE or (value == RUN and self.words.get(MODE) == 2):
            self.go("relative", self.get(COMMANDED) + target)
        elif value == RUN:
            self.go("absolute", target)
        elif value == STOP:
            self.moves.append(("stop", self.get(ACTUAL)))
            self.put(COMMANDED, self.get(ACTUAL))
            self.set_bits(is_done=True)
        elif value == ZERO:
            self.moves.append(("zero", 0))
            self.put(ACTUAL, 0)
            self.put(COMMANDED, 0)
        elif value in (HOME, STORED, JOG):
            self.moves.append(({HOME: "home", STORED: "stored", JOG: "jog"}[value], 0))
            self.set_bits(is_done=False)

    def go(self, kind: str, counts: float) -> None:
        """Start a move to a position."""
        self.moves.append((kind, counts))
        self.put(COMMANDED, counts)
        self.set_bits(is_done=False)

    def arrive(self, standing_error: int = 0) -> None:
        """End the move."""
        self.put(ACTUAL, self.get(COMMANDED) + standing_error)
        self.set_bits(is_done=True)

    def pass_by(self, counts: int) -> None:
        """Be at a position on the way."""
        self.put(ACTUAL, counts)

    def stand_at(self, counts: int) -> None:
        """Report done at a position that no controller commanded through the gateway."""
        for place in (ACTUAL, COMMANDED):
            self.put(place, counts)
        self.set_bits(is_done=True)

    def set_bits(self, *, is_done: bool, is_homed: bool = True, is_alarmed: bool = False) -> None:
        """Set the bits of the status word."""
        self.is_running = not is_done
        word = is_done << DONE_BIT | is_homed << HOMED_BIT | (not is_done) << MOVING_BIT
        super().write(STATUS, (word | is_alarmed << ALARM_BIT).to_bytes(2, "big"))


class StagedBench(Bench):
    """A line with one controller and drives that wait for a trigger."""

    def __init__(self, *plans: AxisPlan, **others: Any) -> None:
        self.drive = StagedDrive()
        super().__init__(*(plans or (staged_plan(),)), memory=self.drive, **others)

    def stage(self, counts: float) -> None:
        """Write a target, and check that it is acknowledged as the controller wrote it."""
        assert self.ask(write(COMMAND, counts)) == write(COMMAND, counts)[:5]

    def trigger(self, pdu: bytes = RUN_PDU) -> tuple[str, float]:
        """Run the target, and check that the trigger is acknowledged; return the last move of the drive."""
        assert self.ask(pdu) == pdu
        return self.drive.moves[-1] if self.drive.moves else ("", 0)

    def run(self, counts: float, pdu: bytes = RUN_PDU) -> tuple[str, float]:
        """Write a target and run it; return the last move of the drive."""
        self.stage(counts)
        return self.trigger(pdu)

    def poll(self) -> int:
        """Read the status word as the controller does."""
        return int.from_bytes(self.ask(bytes.fromhex("03 005C 0001"))[2:], "big")

    def settle(self, *, is_polled: bool = True) -> None:
        """Let the axis arrive, and the controller read it."""
        self.drive.arrive()
        self.wait(MOVE_MS)
        if is_polled:
            self.poll()
            self.ask(read(ACTUAL))

    def go_to(self, *counts: float) -> tuple[str, float]:
        """Stage, trigger, arrive, at each position; return the last move of the drive."""
        for each in counts:
            move = self.run(each)
            self.settle()
        return move

    def refused(self, pdu: bytes) -> int:
        """Send a request that must be refused and not reach the drive; return the exception code."""
        before = list(self.drive.moves)
        reply = self.ask(pdu)
        assert reply[0] == pdu[0] | 0x80
        assert self.drive.moves == before
        return reply[1]

    def writes(self) -> list[str]:
        """Return the writes to the drive since the last call, the oldest first."""
        found = [pdu.hex(" ") for pdu in self.seen if pdu[0] in (5, 6, 15, 16, 22, 23)]
        self.seen.clear()
        return found


__all__ = ["ACTUAL", "COMMAND", "read", "write"]
