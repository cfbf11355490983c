from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from itertools import pairwise

import pytest

from gateway.compensation.direction import Direction
from gateway.compensation.units import Units
from gateway.metrology.build import HomeReference, build_table
from gateway.metrology.cycle import Stop, bidirectional_cycle
from gateway.metrology.readings import Reading
from gateway.simulator.bus import DriveBus
from gateway.simulator.controller import AxisController, AxisWiring
from gateway.simulator.drive import DEFAULT_REGISTERS, SimulatedAxis, SimulatedDrive
from gateway.simulator.endpoints import TcpDriveServer
from gateway.simulator.errors import DriveRefusedError, MissedError
from gateway.simulator.gauge import Laser
from gateway.simulator.mechanics import Encoder, Flank, Mechanics
from gateway.simulator.screw import Screw
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.master import ModbusMaster

UP, DOWN = Direction.FORWARD, Direction.BACKWARD


class Bench:
    """An axis with 100 µm/m and 40 µm of lost motion, its controller, and a clock that runs 5 ms a look."""

    def __init__(self, home_flank: Flank = Flank.FORWARD) -> None:
        self.mechanics = Mechanics(
            Screw(progressive_um_per_m=100.0), Encoder(1000.0), backlash_mm=0.040, flank=home_flank
        )
        self.drive = SimulatedDrive(1, [SimulatedAxis("x", DEFAULT_REGISTERS, self.mechanics)])
        self.now_s = 0.0
        self.exits = AsyncExitStack()
        self.server = TcpDriveServer(DriveBus([self.drive]), self.clock)

    def clock(self) -> float:
        self.now_s += 0.005
        return self.now_s

    async def connect(self) -> AxisController:
        await self.server.start()
        endpoint = TcpEndpoint("127.0.0.1", self.server.port)
        self.master = await self.exits.enter_async_context(ModbusMaster(endpoint))
        registers = DEFAULT_REGISTERS
        wiring = AxisWiring(1, registers.command[0], registers.actual[0], registers.bits["done"], 1000.0)
        return AxisController(self.master, wiring, poll_s=0.0)


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    bench = Bench()
    yield bench
    await bench.exits.aclose()
    await bench.server.stop()


def test_a_cycle_overruns_both_ends_and_visits_every_target_twice() -> None:
    stops = list(bidirectional_cycle([10.0, 0.0, 5.0], overrun=1.0, cycles=2))
    assert [s.nominal for s in stops] == 2 * [-1.0, 0.0, 5.0, 10.0, 11.0, 10.0, 5.0, 0.0]
    assert [s.measure for s in stops] == 2 * [False, True, True, True, False, True, True, True]
    for before, after in pairwise(stops):
        assert after.direction is (UP if after.nominal > before.nominal else DOWN)


async def test_a_move_ends_when_the_axis_is_there_and_reads_back_exactly(bench: Bench) -> None:
    controller = await bench.connect()
    arrival = await controller.move(Stop(20.0, UP, measure=True))
    assert arrival.is_exact
    assert (arrival.commanded_counts, arrival.readback_counts) == (20_000, 20_000)
    # 20 mm at 100 mm/s and 2000 mm/s² take 0.25 s: 50 looks of 5 ms.
    assert arrival.polls == pytest.approx(50, abs=3)


async def test_a_measuring_cycle_becomes_the_table_that_corrects_the_screw(bench: Bench) -> None:
    controller = await bench.connect()
    laser = Laser(bench.mechanics)
    readings = [
        Reading(arrival.stop.nominal, arrival.stop.direction, laser.read_mm(bench.now_s))
        async for arrival in controller.run(bidirectional_cycle([0.0, 50.0, 100.0], overrun=1.0))
        if arrival.stop.measure
    ]
    table = build_table(readings, Units.MM, home=HomeReference(0.0, UP))
    # The nut is 0, 5 and 10 µm too far going forward, and 40 µm more going backward.
    assert list(table.forward) == pytest.approx([0.0, -0.005, -0.010])
    assert list(table.backward) == pytest.approx([-0.040, -0.045, -0.050])


async def test_what_the_drive_refuses_is_an_error_with_its_code(bench: Bench) -> None:
    controller = await bench.connect()
    with pytest.raises(DriveRefusedError, match="function 3 was refused with exception 3") as refused:
        await controller.read_registers(0, 126)
    assert refused.value.exception_code == 3


async def test_an_axis_that_never_arrives_is_given_up(bench: Bench) -> None:
    controller = await bench.connect()
    bench.mechanics.alarm = True
    impatient = AxisController(bench.master, controller.wiring, poll_s=0.0, move_timeout_s=0.0)
    with pytest.raises(MissedError, match="still moving"):
        await impatient.move(Stop(1.0, UP, measure=False))


def test_laser_noise_is_seeded_and_has_the_size_that_was_asked_for() -> None:
    mechanics = Mechanics(Screw(), Encoder(1000.0), start_mm=10.0)
    first, same, other = (Laser(mechanics, noise_um=0.5, seed=seed) for seed in (1, 1, 2))
    readings_um = [first.read_mm(0.0) * 1000 for _ in range(1000)]
    assert [same.read_mm(0.0) * 1000 for _ in range(1000)] == readings_um
    assert other.read_mm(0.0) * 1000 != readings_um[0]
    assert sum(abs(r) < 0.5 for r in readings_um) / 1000 == pytest.approx(0.683, abs=0.05)
    assert first.true_mm(0.0) == 0.0


def test_the_laser_reads_displacement_from_where_it_was_zeroed() -> None:
    mechanics = Mechanics(Screw(progressive_um_per_m=100.0), Encoder(1000.0))
    laser = Laser(mechanics)
    mechanics.command(100_000, 0.0)
    assert laser.read_mm(60.0) == pytest.approx(100.010)
    laser.zero(60.0)
    mechanics.command(50_000, 60.0)
    assert laser.read_mm(120.0) == pytest.approx(-50.005)
