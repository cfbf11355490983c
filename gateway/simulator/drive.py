"""A drive of no particular make: it has the registers that a configuration gives it.

It moves as soon as a position is written. Vendor codes 0x41, 0x64 and 0x65 are echoed.
"""

from collections.abc import Sequence
from typing import Final

from gateway.simulator.axis import SimulatedAxis
from gateway.simulator.image import RegisterImage
from gateway.simulator.ledger import Ledger
from gateway.simulator.server import MAX_READ_REGISTERS, MAX_WRITE_REGISTERS, RegisterServer

__all__ = ["MAX_READ_REGISTERS", "MAX_WRITE_REGISTERS", "SimulatedDrive"]

STANDARD_FUNCTIONS: Final = frozenset({1, 2, 3, 4, 5, 6, 7, 8, 15, 16, 22, 23})
VENDOR_FUNCTIONS: Final = (0x41, 0x64, 0x65)


class SimulatedDrive(RegisterServer):
    """One unit on a bus, with the axes that it drives.

    ``max_registers`` is the most that it takes in one frame; ``without`` lists function codes that it does
    not know although others do.
    """

    def __init__(
        self,
        unit_id: int,
        axes: Sequence[SimulatedAxis] = (),
        *,
        image: RegisterImage | None = None,
        max_registers: int = MAX_READ_REGISTERS,
        without: Sequence[int] = (),
        ledger: Ledger | None = None,
    ) -> None:
        super().__init__(unit_id, image)
        self.axes: tuple[SimulatedAxis, ...] = tuple(axes)
        self.ledger = ledger if ledger is not None else self.ledger
        self.max_read = min(MAX_READ_REGISTERS, max_registers)
        self.max_write = min(MAX_WRITE_REGISTERS, max_registers)
        self.functions = STANDARD_FUNCTIONS.union(VENDOR_FUNCTIONS).difference(without)
        self._handlers.update(dict.fromkeys(VENDOR_FUNCTIONS, _echo))
        for axis in self.axes:
            axis.initialise(self.image)

    def answer(self, pdu: bytes, now_s: float) -> bytes:
        """See :class:`RegisterServer`: it never stays silent."""
        reply = super().answer(pdu, now_s)
        assert reply is not None
        return reply

    def refresh(self, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        for axis in self.axes:
            axis.refresh(self.image, now_s)

    def write_words(self, address: int, data: bytes, now_s: float) -> None:
        """See :class:`RegisterServer`."""
        self.image.store_words(address, data)
        for axis in self.axes:
            axis.written(self.image, address, len(data) // 2, now_s)


def _echo(pdu: bytes, _now_s: float) -> bytes:
    return pdu
