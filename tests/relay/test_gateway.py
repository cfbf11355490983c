"""A relay from its start to its end: starting says what is wrong, stopping leaves nothing half done."""

import asyncio
import socket
import threading
import time

import pytest

from gateway.catalogue.entry import Severity
from gateway.exchange.plan import ControllerPlan
from gateway.ipc.log import LogEntry
from gateway.ipc.log_thread import LogThread
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.relay import gateway as relay_module
from gateway.relay.errors import StartError
from gateway.relay.gateway import Relay
from gateway.relay.run import noting
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.exchange.staged_bench import STOP_PDU, staged_plan
from tests.support.relay import TIMING, Bench, eventually, first_controller, line_status

READ = bytes.fromhex("03 0010 0001")
REPLY = bytes.fromhex("03 02 0007")
NOWHERE = TcpEndpoint("127.0.0.1", 1)


def plan_of(*lines: LinePlan) -> GatewayPlan:
    return GatewayPlan("test", lines)


def line_plan(drives: TcpEndpoint | SerialEndpoint, *controllers: ControllerLink) -> LinePlan:
    from gateway.exchange.plan import LineTiming

    return LinePlan("xyz", drives, controllers, (), LineTiming())


async def test_every_port_that_cannot_be_opened_is_named_with_its_key(bench: Bench) -> None:
    cable = bench.cable()
    taken, _ = open_port(SerialEndpoint(cable.near))
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        relay = Relay(
            plan_of(
                line_plan(
                    SerialEndpoint("/dev/null"),
                    ControllerLink(ControllerPlan("hmi"), TcpEndpoint("127.0.0.1", 0)),
                    ControllerLink(ControllerPlan("cnc"), TcpEndpoint("127.0.0.1", port)),
                    ControllerLink(ControllerPlan("plc", serial=True), SerialEndpoint(cable.near)),
                )
            )
        )
        with pytest.raises(StartError) as caught:
            await relay.start()
    taken.close()
    tcp, serial, drives = caught.value.problems
    assert tcp.startswith(f"line.xyz.controllers[2].tcp (cnc): 127.0.0.1:{port} is in use by another program")
    assert serial.startswith(f"line.xyz.controllers[3].rtu (plc): {cable.near} is in use by another program")
    assert drives == "line.xyz.drives.rtu: /dev/null is not a serial port"


async def test_nothing_stays_open_after_a_start_that_failed() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        free = socket.create_server(("127.0.0.1", 0))
        free_port = free.getsockname()[1]
        free.close()
        relay = Relay(
            plan_of(
                line_plan(
                    NOWHERE,
                    ControllerLink(ControllerPlan("a"), TcpEndpoint("127.0.0.1", free_port)),
                    ControllerLink(ControllerPlan("b"), TcpEndpoint("127.0.0.1", other.getsockname()[1])),
                )
            )
        )
        with pytest.raises(StartError):
            await relay.start()
    again = Relay(
        plan_of(line_plan(NOWHERE, ControllerLink(ControllerPlan("a"), TcpEndpoint("127.0.0.1", free_port))))
    )
    await again.start()
    await again.stop()


async def test_absent_drives_and_adapters_are_no_start_error(bench: Bench) -> None:
    relay = Relay(
        plan_of(
            line_plan(
                SerialEndpoint("/dev/ttyNONE0"),
                ControllerLink(ControllerPlan("plc", serial=True), SerialEndpoint("/dev/ttyNONE1")),
            )
        ),
        bench.notes.append,
    )
    await relay.start()
    await relay.stop()
    details = {note.event: note.fields["detail"] for note in bench.notes}
    assert str(details["drives-not-reached"]).startswith("/dev/ttyNONE0 is not there")
    assert str(details["port-not-open"]).startswith("/dev/ttyNONE1 is not there")


@pytest.mark.parametrize("controller", ["tcp", "rtu"])
async def test_the_exchange_on_the_wire_is_finished_before_the_stop(bench: Bench, controller: str) -> None:
    near, far, relay = await bench.raw_pair(controller, "rtu")
    near.write(encode_mbap(5, 1, READ) if controller == "tcp" else encode_rtu(1, READ))
    await far.until(lambda end: end.data == encode_rtu(1, READ))
    stopping = asyncio.create_task(relay.stop())
    await asyncio.sleep(0)
    assert not stopping.done()
    far.write(encode_rtu(1, REPLY))
    await near.receives(encode_mbap(5, 1, REPLY) if controller == "tcp" else encode_rtu(1, REPLY))
    async with asyncio.timeout(30):
        await stopping
    assert far.data == encode_rtu(1, READ)


async def test_a_stop_waits_for_a_silent_drive_no_longer_than_its_time_out(bench: Bench) -> None:
    near, far, relay = await bench.raw_pair("tcp", "rtu", timeout_ms=200.0)
    near.write(encode_mbap(5, 1, READ))
    await far.until(lambda end: bool(end.data))
    async with asyncio.timeout(2):  # the time-out is 0.2 s; without one it would wait for good
        await relay.stop()


async def test_no_connection_is_accepted_any_more_after_a_stop(bench: Bench) -> None:
    near, _, relay = await bench.raw_pair("tcp", "tcp")
    where = relay.address("line", "cnc")
    await relay.stop()
    await near.until(lambda end: end.closes == 1)
    with pytest.raises(ConnectionRefusedError):
        await asyncio.open_connection(where.host, where.port)


async def test_who_is_not_allowed_is_closed_counted_and_noted(bench: Bench) -> None:
    link = ControllerLink(ControllerPlan("hmi"), TcpEndpoint("127.0.0.1", 0), allow=("192.0.2.0/24",))
    relay = await bench.relay(NOWHERE, (link,))
    stranger = await bench.connect(relay.address("line", "hmi"))
    await stranger.until(lambda end: end.closes == 1)
    controllers = line_status(relay)["controllers"]
    assert isinstance(controllers, list)
    assert controllers[0]["refused_connections"] >= 1
    await relay.stop()
    assert any(note.event == "connection-refused" for note in bench.notes)


async def test_more_connections_than_a_listener_takes_have_a_reason_of_their_own(bench: Bench) -> None:
    link = ControllerLink(ControllerPlan("hmi"), TcpEndpoint("127.0.0.1", 0))
    relay = await bench.relay(NOWHERE, (link,))
    where = relay.address("line", "hmi")
    ends = [await asyncio.open_connection(where.host, where.port) for _ in range(64 + 10)]
    await eventually(lambda: first_controller(relay)["refused_connections"] == 10)
    for _, writer in ends:
        writer.close()
    await relay.stop()
    details = [note.fields["detail"] for note in bench.notes if note.event == "connection-refused"]
    assert details == ["127.0.0.1: too many connections at once (max_connections)"]


async def test_a_second_relay_may_have_the_ports_of_the_first_once_it_stopped(bench: Bench) -> None:
    near, far = bench.cable(), bench.cable()
    plan = plan_of(
        line_plan(
            SerialEndpoint(near.near),
            ControllerLink(ControllerPlan("plc", serial=True), SerialEndpoint(far.near)),
        )
    )
    for _ in range(3):
        relay = Relay(plan)
        await relay.start()
        await relay.stop()
    for device in (near.near, far.near):
        port, _ = open_port(SerialEndpoint(device))
        port.close()


# === what a start makes of its records is written at once ================================================

PATIENCE_S = 30.0


async def test_what_a_start_restores_is_written_without_waiting_for_the_next_waking() -> None:
    written: list[str] = []
    is_written = threading.Event()

    def write(entry: LogEntry) -> None:
        written.append(entry.event)
        if entry.event == "restored":
            is_written.set()

    with LogThread(write) as log:
        entry = noting(log)
        entry(LogEntry(Severity.INFO, "line-up", {}, 0.0))
        entry(LogEntry(Severity.INFO, "restored", {}, 0.0))
        assert is_written.wait(PATIENCE_S)
        assert written == ["line-up", "restored"]


# === it ends although a stop waits for a line that is down ===============================================


async def test_stop_of_the_gateway_with_a_stop_that_waits_for_a_lost_link(bench: Bench) -> None:
    """The stop of a controller with ``timeout_ms = 5000``."""
    link, _ = bench.controller_link("tcp", timeout_ms=5000.0)
    relay = await bench.relay(TcpEndpoint("127.0.0.1", 9), (link,), (staged_plan(),), timing=TIMING)
    cnc = await bench.connect(relay.address("line", "cnc"))
    cnc.write(encode_mbap(1, 1, STOP_PDU))
    await asyncio.sleep(0.1)
    began_s = time.monotonic()
    await relay.stop()
    assert time.monotonic() - began_s < 4.0


# === high marks of the last minute grow old by themselves ================================================


async def test_each_line_begins_a_new_slot_unwatched(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(relay_module, "TICK_EVERY_S", 0.01)
    names = ("a", "b", "c")
    plans = []
    for name in names:
        _, where = await bench.drive("tcp", lambda data: data[:5] + b"\x05" + data[6:7] + REPLY)
        plans.append(LinePlan(name, where, (bench.controller_link("tcp")[0],), (), TIMING))
    relay = await bench.start(GatewayPlan("bench", tuple(plans)))
    await eventually(lambda: all(line.is_up for line in relay._lines))
    for name in names:
        near = await bench.connect(relay.address(name, "cnc"))
        near.write(encode_mbap(1, 1, READ))
        await near.receives(encode_mbap(1, 1, REPLY))
    for line in relay._lines:
        [measured] = line._exchange.meter.measured.values()
        mark = measured.high
        await eventually(lambda mark=mark: mark.ever_ns > 0 and mark.slot_ns == 0)  # type: ignore[misc]
        assert mark.minute_ns == mark.ever_ns  # it still is of the last minute
