"""Two drives on one beam, each with its own registers and motor, behind one line."""

from typing import Any

from gateway.exchange.commands import Disable, Enable, SetGain
from gateway.exchange.plan import AxisPlan
from gateway.exchange.status import axis_status
from gateway.modbus.pdu import BROADCAST_UNIT_ID
from tests.exchange.line_bench import ACTUAL, COMMAND, MOVE_MS, MS, Bench, Memory, axis_plan, read, write
from tests.exchange.staged_bench import HOMED_BIT, RUN_PDU, STATUS, STOP_PDU, StagedDrive, staged_plan
from tests.support.status_models import plain

STATUS_PDU = bytes.fromhex("03 005C 0001")


class Mover(Memory):
    """A drive that moves to each target as soon as it is written."""

    def __init__(self) -> None:
        super().__init__()
        self.moves: list[tuple[str, float]] = []
        self.words[STATUS] = 1 << HOMED_BIT

    def write(self, address: int, data: bytes) -> None:
        super().write(address, data)
        if COMMAND.address <= address < COMMAND.end:
            self.moves.append(("absolute", self.get(COMMAND)))
            self.put(ACTUAL, self.get(COMMAND))


class GantryBench(Bench):
    """The axes y1 and y2, on unit ids 1 and 2, of one group."""

    def __init__(self, *plans: AxisPlan, serial: bool = True, **changes: Any) -> None:
        plans = plans or tuple(staged_plan(name=f"y{unit}", unit_id=unit, **changes) for unit in (1, 2))
        is_staged = plans[0].motion.waits_for_trigger
        numbers = range(1, len(plans) + 1)
        self.drives: dict[int, Any] = {unit: StagedDrive() if is_staged else Mover() for unit in numbers}
        self.not_homed: set[int] = set()
        self.refuses: list[tuple[int, bytes, bytes | None]] = []
        """Frames that a drive answers so, once, and does not obey; None: it says nothing."""
        self.hides: list[tuple[int, bytes, bytes | None]] = []
        """The same of frames that it obeys all the same."""
        self.log: list[tuple[int, str]] = []
        """What came to each drive, in order."""
        names = [plan.name for plan in plans]
        super().__init__(*plans, serial=serial, groups=[names], link=None)
        self.log.clear()

    def serve(self) -> None:
        """Let the drives answer all requests that were sent."""
        while self.link.sent:
            unit_id, pdu = self.link.sent.pop(0)
            self.log.append((unit_id, pdu.hex(" ")))
            odd = [*self.refuses, *self.hides]
            found = next((each for each in odd if each[0] == unit_id and pdu.startswith(each[1])), None)
            if found is not None:
                if found in self.hides:
                    self.hides.remove(found)
                    self.drives[unit_id].answer(pdu)
                else:
                    self.refuses.remove(found)
                if found[2] is None:
                    self.wait(2_000)
                else:
                    self._pass(MS, unit_id, found[2])
                    self.line.reply(unit_id, found[2], self.now_ns)
                continue
            if unit_id == BROADCAST_UNIT_ID:
                for drive in self.drives.values():
                    drive.answer(pdu)
                self.wait(200)
                continue
            reply = self.drives[unit_id].answer(pdu)
            self._pass(MS, unit_id, reply)
            self.line.reply(unit_id, reply, self.now_ns)

    def to(self, unit_id: int, pdu: bytes) -> bytes:
        """Send a request to one of the drives, and return the answer."""
        self.send(pdu, unit_id=unit_id)
        self.serve()
        return self.port.take()

    def stage(self, unit_id: int, counts: float) -> None:
        assert self.to(unit_id, write(COMMAND, counts)) == write(COMMAND, counts)[:5]

    def stage_all(self, counts: float) -> None:
        for unit_id in self.drives:
            self.stage(unit_id, counts)

    def run(self, *unit_ids: int) -> list[float]:
        """Trigger some axes, in this order; return where the last moves of all ended."""
        for unit_id in unit_ids:
            assert self.to(unit_id, RUN_PDU) == RUN_PDU
        return self.ends()

    def start(self, unit_id: int, counts: float) -> list[float]:
        """Stage a target of one axis and run it; return where the last moves of all ended."""
        self.stage(unit_id, counts)
        return self.run(unit_id)

    def write(self, unit_id: int, counts: float) -> list[float]:
        """Write a target to one axis; return where the last moves of all ended."""
        self.to(unit_id, write(COMMAND, counts))
        return self.ends()

    def lose_target(self, unit_id: int, counts: float) -> None:
        """Write a target that its drive refuses."""
        self.refuses.append((unit_id, bytes.fromhex("10 06 06"), bytes.fromhex("90 04")))
        assert self.to(unit_id, write(COMMAND, counts)) == bytes.fromhex("90 04")

    def obeys_secretly(self, pdu: bytes, answer: bytes | None = None) -> None:
        """Let the first drive obey a frame, and answer it with ``answer`` (None: not at all)."""
        self.hides.append((1, pdu[:3], answer))
        self.send(pdu, unit_id=1)
        self.serve()

    def begin(self, counts: float) -> None:
        """Stage targets of all axes, and run the first."""
        self.stage_all(counts)
        self.run(1)

    def write_all(self, counts: float) -> list[float]:
        """Write a target to each axis; return where the last moves of all ended."""
        for unit_id in self.drives:
            self.write(unit_id, counts)
        return self.ends()

    def poll(self, *pdus: bytes) -> None:
        """Read the status of each axis, or send other reads to each."""
        for unit_id in self.drives:
            for pdu in pdus or (STATUS_PDU,):
                self.to(unit_id, pdu)

    def stop(self, unit_id: int) -> None:
        assert self.to(unit_id, STOP_PDU) == STOP_PDU

    def settle(self) -> None:
        """Let both axes arrive, and the controller read it."""
        for unit_id, drive in self.drives.items():
            if isinstance(drive, StagedDrive):
                drive.arrive()
                drive.set_bits(is_done=True, is_homed=unit_id not in self.not_homed)
            self.wait(MOVE_MS)
            self.to(unit_id, STATUS_PDU)
            self.to(unit_id, read(ACTUAL))

    def go(self, counts: float) -> list[float]:
        """Stage and run targets of both axes, and let them arrive; return where they are."""
        self.stage_all(counts)
        ends = self.run(*self.drives)
        self.settle()
        self.log.clear()
        return ends

    def ends(self) -> list[float]:
        """Return where the last move of each drive ended or will end, in counts."""
        return [drive.moves[-1][1] if drive.moves else 0 for drive in self.drives.values()]

    def counts_of_moves(self) -> list[int]:
        return [len(drive.moves) for drive in self.drives.values()]

    def switch(self, *, is_on: bool) -> None:
        self.line.command(Enable(axes=("y1",)) if is_on else Disable(axes=("y1",)), self.now_ns)

    def gain(self, share: float) -> None:
        self.line.command(SetGain(axes=("y1",), forward=share, backward=share), self.now_ns)

    def group(self, name: str = "y1") -> dict[str, Any]:
        """Return the group status of an axis."""
        axis = next(each for each in self.line.axes if each.plan.name == name)
        found: dict[str, Any] = plain(axis_status(axis, self.now_ns).group)
        return found

    def lose_homed_bit(self, unit_id: int) -> None:
        """Let the homed bit of a drive fall, for good."""
        self.not_homed.add(unit_id)
        self.drives[unit_id].set_bits(is_done=True, is_homed=False)


__all__ = ["ACTUAL", "COMMAND", "RUN_PDU", "STATUS", "axis_plan", "read", "staged_plan", "write"]
