"""A relay that runs, a controller that moves its drives, and whoever hands it tables."""

import asyncio
import gc
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

from gateway.compensation.table import CorrectionTable, make_table
from gateway.compensation.units import Units
from gateway.exchange.commands import ClearTable, Disable, Enable, SetGain, SetLimits, SetTable, TableFor
from gateway.exchange.plan import AxisPlan
from gateway.ipc.client import ask
from gateway.ipc.messages import Done
from gateway.ipc.sealed_memory import seal
from gateway.modbus.mbap import encode_mbap
from gateway.recording.writer import Recorder
from gateway.relay.gateway import Relay
from gateway.state.plan import GatewayPlan, LinePlan
from gateway.state.tables import compiled
from tests.support.relay import TIMING, Bench, RawEnd, axis_plan, until_up

FLAT = [0.0, 100.0]


def table_of(*corrections: float, units: Units = Units.MM) -> CorrectionTable:
    return make_table(FLAT, list(corrections), list(corrections), units)


STEEPER = table_of(0.0, 0.2)
"""Adds 0.1 mm at 50 mm, where the table of the bench adds 0.05 mm."""


def answered(data: bytes) -> bytes:
    """Acknowledge FC16."""
    return data[:4] + bytes((0, 6)) + data[6:12]


def without_actual(**changes: Any) -> AxisPlan:
    """The axis of the bench with nothing to read: no frame is added."""
    return replace(axis_plan(), actual=(), **changes)


class Machine:
    """A relay with its controller's end; keeps what the drives were told, in counts by unit id."""

    def __init__(self, relay: Relay, near: RawEnd, told: list[tuple[int, int]]) -> None:
        self.relay = relay
        self.near = near
        self.told = told

    @property
    def socket(self) -> Path:
        assert self.relay.control_socket is not None
        return self.relay.control_socket

    async def move(self, counts: int, unit: int = 1) -> int:
        """Command a position; returns what the drive was told."""
        pdu = bytes.fromhex("10 0064 0002 04") + counts.to_bytes(4, "big", signed=True)
        self.near.write(encode_mbap(1, unit, pdu))
        await self.near.receives(encode_mbap(1, unit, pdu[:5]))
        found, position = self.told[-1]
        assert found == unit
        return position

    async def give(self, *tables: tuple[str, CorrectionTable | bytes], sha256: str = "f" * 64) -> Done:
        """Hand over tables in one message."""
        content = [table if isinstance(table, bytes) else compiled(table) for _, table in tables]
        return await self.give_descriptors(
            [axis for axis, _ in tables], [seal(data, "table") for data in content], sha256
        )

    async def give_descriptors(self, axes: list[str], descriptors: list[int], sha256: str = "f" * 64) -> Done:
        request = SetTable(tables=tuple(TableFor(axis, "new.tab", "centroid-3", sha256) for axis in axes))
        try:
            reply = await asyncio.to_thread(ask, self.socket, request, descriptors=descriptors)
        finally:
            for descriptor in descriptors:
                os.close(descriptor)
        assert isinstance(reply, Done)
        return reply

    async def say(self, request: ClearTable | SetGain | SetLimits | Disable | Enable) -> Done:
        reply = await asyncio.to_thread(ask, self.socket, request)
        assert isinstance(reply, Done)
        return reply


async def machine(
    bench: Bench,
    state: Path,
    *axes: AxisPlan,
    groups: tuple[tuple[str, ...], ...] = (),
    recorder: Recorder | None = None,
) -> Machine:
    told: list[tuple[int, int]] = []

    def script(data: bytes) -> bytes:
        told.append((data[6], int.from_bytes(data[13:17], "big", signed=True)))
        return answered(data)

    _, where = await bench.drive("tcp", script)
    link, _ = bench.controller_link("tcp")
    line = LinePlan("line", where, (link,), axes, TIMING, groups)
    relay = await bench.start(GatewayPlan("bench", (line,)), state=state, recorder=recorder)
    await until_up(relay)
    return Machine(relay, await bench.connect(relay.address("line", "cnc")), told)


def descriptors_open() -> int:
    gc.collect()  # what other tests left is none of ours
    return sum(1 for _ in Path("/proc/self/fd").iterdir())
