"""A temperature on the serial bus of the drives, read through the gateway's own address for monitors."""

import asyncio
from dataclasses import replace

from gateway.catalogue.entry import EventEntry, Severity
from gateway.compensation.settings import ThermalSettings
from gateway.config.axis_model import AxisSection
from gateway.config.sections import Sections
from gateway.exchange.plan import Role
from gateway.ipc.messages import Reply, Request
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.supervisor.temperatures import Temperatures
from tests.support.relay import Bench, axis_plan, eventually, until_up
from tests.support.status_models import plain

TARGET = bytes.fromhex("10 0064 0002 04")


class Bus:
    """A drive on unit 1, a sensor with tenths of a degree on unit 9."""

    def __init__(self) -> None:
        self.tenths = 300
        self.told: list[int] = []

    def __call__(self, data: bytes) -> bytes | None:
        if data[0] == 9:
            assert data[1:6] == bytes.fromhex("04 0007 0001")
            return encode_rtu(9, bytes((4, 2)) + self.tenths.to_bytes(2, "big", signed=True))
        if data[1] == 16:
            self.told.append(int.from_bytes(data[7:11], "big", signed=True))
            return encode_rtu(data[0], data[1:6])
        return encode_rtu(data[0], bytes((data[1], 4)) + bytes(4))


async def test_a_sensor_beside_the_drives_is_heard_and_the_axis_follows(bench: Bench) -> None:
    bus = Bus()
    _, where = await bench.drive("rtu", bus)
    links = (
        bench.controller_link("tcp")[0],
        bench.controller_link("tcp", "hmi", Role.MONITOR, timeout_ms=1000.0)[0],
    )
    warm = replace(axis_plan(), thermal=ThermalSettings(1e-4))
    relay = await bench.relay(where, links, (warm,))
    await until_up(relay)
    source = {"unit_id": 9, "address": 7, "function": 4, "scale": 0.1, "every_s": 0.5}
    raw = {
        "line": "line",
        "unit_id": 1,
        "units": "mm",
        "counts_per_unit": 1000.0,
        "referenced": "absolute",
        "thermal": {"alpha": 1e-4, "source": {"modbus": str(relay.address("line", "hmi")), **source}},
    }
    loop = asyncio.get_running_loop()

    def ask(request: Request) -> Reply:  # as over the socket: from another thread, answered by the loop
        async def answered() -> Reply:
            return relay.answer(request)

        return asyncio.run_coroutine_threadsafe(answered(), loop).result(5.0)

    said: list[str] = []

    def say(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        said.append(f"{event.name}: {fields['detail']}")

    temperatures = Temperatures(ask, say)
    running = asyncio.create_task(temperatures.run())
    temperatures.follow(Sections(axes={"x": AxisSection.model_validate(raw)}))

    def celsius() -> object:
        return plain(relay.status().axes["x"])["terms"]["thermal"]["celsius"]

    try:
        await eventually(lambda: celsius() == 30.0)
        controller = await bench.connect(relay.address("line", "cnc"))
        controller.write(encode_mbap(1, 1, TARGET + (50_000).to_bytes(4, "big")))
        await controller.until(lambda end: len(end.data) >= 12)
        # 50 µm of the table less 1e-4 × 10 K × 50 mm.
        assert bus.told == [50_000]
        bus.tenths = 30_000
        await eventually(lambda: bool(said))
        assert said[0].startswith("temperature-wrong: axis x: 3000 °C is no temperature within 40 K")
        assert celsius() == 30.0
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
