"""A simulated motion controller: moves an axis over Modbus, reads it back, runs measuring cycles.

It has no corrections: every position here is nominal.
"""

import asyncio
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from typing import Final

from gateway.metrology.cycle import Stop
from gateway.modbus.registers import BitField, PositionField
from gateway.simulator.errors import DriveRefusedError, MissedError
from gateway.transport.master import ModbusMaster, NoReplyError

READ_HOLDING: Final = 3
WRITE_REGISTERS: Final = 16
EXCEPTION_FLAG: Final = 0x80


@dataclass(frozen=True, slots=True)
class AxisWiring:
    """Access to one axis: unit id, registers and the scale of its counts."""

    unit_id: int
    command: PositionField
    actual: PositionField
    done: BitField
    counts_per_unit: float
    zero_counts: float = 0.0

    def counts(self, nominal: float) -> int:
        """Return the whole counts of a nominal position."""
        return round(self.zero_counts + self.counts_per_unit * nominal)

    def nominal(self, counts: float) -> float:
        """Return the nominal position of counts."""
        return (counts - self.zero_counts) / self.counts_per_unit


@dataclass(frozen=True, slots=True)
class Arrival:
    """A stop as the controller saw it: the commanded counts and the counts read back."""

    stop: Stop
    commanded_counts: int
    readback_counts: float
    polls: int

    @property
    def is_exact(self) -> bool:
        """Whether the axis reads back exactly the commanded counts."""
        return self.readback_counts == self.commanded_counts


class AxisController:
    """Moves one axis through a Modbus master."""

    def __init__(
        self,
        master: ModbusMaster,
        wiring: AxisWiring,
        *,
        poll_s: float = 0.001,
        dwell_s: float = 0.0,
        move_timeout_s: float = 30.0,
    ) -> None:
        self.wiring = wiring
        self._master = master
        self._poll_s = poll_s
        self._dwell_s = dwell_s
        self._move_timeout_s = move_timeout_s

    async def write_registers(self, address: int, data: bytes) -> None:
        """Write registers with FC16.

        Raises:
            DriveRefusedError: the drive or the gateway refused.
            MissedError: no reply came.
        """
        head = bytes((WRITE_REGISTERS,)) + address.to_bytes(2) + (len(data) // 2).to_bytes(2)
        await self._exchange(head + bytes((len(data),)) + data)

    async def read_registers(self, address: int, count: int) -> bytes:
        """Read registers with FC03; errors as for :meth:`write_registers`."""
        reply = await self._exchange(bytes((READ_HOLDING,)) + address.to_bytes(2) + count.to_bytes(2))
        return reply[2:]

    async def command(self, counts: int) -> None:
        """Write a target position."""
        field = self.wiring.command
        raw = counts / field.scale
        packed = field.pack(raw if field.type.is_float else round(raw))
        await self.write_registers(field.address, packed)

    async def actual(self) -> float:
        """Read the actual position, in counts."""
        field = self.wiring.actual
        return field.unpack(await self.read_registers(field.address, field.words)) * field.scale

    async def is_done(self) -> bool:
        """Read the done bit."""
        done = self.wiring.done
        return done.is_set(int.from_bytes(await self.read_registers(done.address, 1)))

    async def wait_until_done(self) -> int:
        """Poll the done bit; return the number of polls.

        Raises:
            MissedError: the axis did not arrive within the move time-out.
        """
        loop = asyncio.get_running_loop()
        give_up_s = loop.time() + self._move_timeout_s
        polls = 1
        while not await self.is_done():
            if loop.time() > give_up_s:
                raise MissedError(f"the axis is still moving after {self._move_timeout_s:g} s")
            await asyncio.sleep(self._poll_s)
            polls += 1
        return polls

    async def move(self, stop: Stop) -> Arrival:
        """Command a stop, wait until the axis has arrived, dwell, and read the position back."""
        counts = self.wiring.counts(stop.nominal)
        await self.command(counts)
        polls = await self.wait_until_done()
        if self._dwell_s:
            await asyncio.sleep(self._dwell_s)
        return Arrival(stop, counts, await self.actual(), polls)

    async def run(self, stops: Iterator[Stop]) -> AsyncIterator[Arrival]:
        """Move from stop to stop; the axis is at standstill while the caller handles an arrival."""
        for stop in stops:
            yield await self.move(stop)

    async def _exchange(self, pdu: bytes) -> bytes:
        try:
            reply = await self._master.exchange(self.wiring.unit_id, pdu)
        except NoReplyError as error:
            raise MissedError(f"unit {self.wiring.unit_id}, function {pdu[0]}: {error}") from None
        if reply[0] & EXCEPTION_FLAG:
            raise DriveRefusedError(pdu[0], reply[1])
        return reply
