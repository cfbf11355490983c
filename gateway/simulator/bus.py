"""Several simulated drives on one bus."""

from collections.abc import Iterable
from typing import Final

from gateway.simulator.errors import SimulatorError
from gateway.simulator.ledger import Ledger
from gateway.simulator.server import RegisterServer, ServedMotion

BROADCAST: Final = 0


class DriveBus:
    """Passes each request to the drive with its unit id; all drives share one ledger.

    Unit id 0 is a broadcast: all drives execute it, none answers, unless a drive has unit id 0.
    """

    def __init__(self, drives: Iterable[RegisterServer]) -> None:
        self.ledger = Ledger()
        self._drives: dict[int, RegisterServer] = {}
        for drive in drives:
            if drive.unit_id in self._drives:
                raise SimulatorError(f"two drives with unit id {drive.unit_id} on one bus")
            drive.ledger = self.ledger
            self._drives[drive.unit_id] = drive

    @property
    def drives(self) -> tuple[RegisterServer, ...]:
        """The drives in their given order."""
        return tuple(self._drives.values())

    def axis(self, name: str) -> ServedMotion:
        """Return an axis by its name.

        Raises:
            KeyError: no drive has it.
        """
        return {axis.name: axis for drive in self.drives for axis in drive.axes}[name]

    def has(self, unit_id: int) -> bool:
        """Whether any drive takes a request to this unit id."""
        return unit_id in self._drives or unit_id == BROADCAST

    def response_delay_s(self, unit_id: int, baudrate: int) -> float:
        """Return the response delay of the drive with this unit id; ``baudrate`` is 0 on TCP."""
        drive = self._drives.get(unit_id)
        return 0.0 if drive is None else drive.response_delay_s(baudrate)

    def bad_crc_reply(self, unit_id: int, function: int) -> bytes | None:
        """Return a drive's answer to a frame with a wrong CRC; None: no answer, as the standard requires."""
        drive = self._drives.get(unit_id)
        return None if drive is None else drive.bad_crc_reply(function)

    def answer(self, unit_id: int, pdu: bytes, now_s: float) -> bytes | None:
        """Execute a request.

        Returns None if no drive answers: for a broadcast, an unknown unit id, a request without a function
        code, or a drive that refuses without an exception.
        """
        if not pdu:
            return None
        drive = self._drives.get(unit_id)
        if drive is not None:
            return drive.answer(pdu, now_s)
        if unit_id == BROADCAST:
            for each in self.drives:
                each.answer(pdu, now_s)
        return None
