"""TCP: who is let in, what is said when listening fails, connections that come back."""

import asyncio
import contextlib
import socket
import struct
from collections.abc import Callable
from ipaddress import ip_network
from typing import TYPE_CHECKING

import pytest

from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.errors import RefusedError
from gateway.transport.limits import MAX_CONNECTIONS
from gateway.transport.loop import RelayLoop
from gateway.transport.tcp import Refusal, TcpChannel, TcpConnector, TcpListener, _AcceptedChannel
from tests.support.ports import free_port

if TYPE_CHECKING:
    from tests.transport.conftest import Eventually, Recorder

LOOPBACK = TcpEndpoint("127.0.0.1", 0)


def nobody(host: str, why: Refusal) -> None:
    raise AssertionError(f"{host} was refused: {why}")


def ignore(why: str) -> None:
    pass


async def connect(endpoint: TcpEndpoint) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(endpoint.host, endpoint.port)


class WatchedChannel(TcpChannel):
    """Shows the socket that it was given."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        super().connection_made(transport)
        self.socket = transport.get_extra_info("socket")


async def test_a_connection_sends_and_notices_that_its_peer_is_gone(make_recorder: "type[Recorder]") -> None:
    listener = TcpListener(LOOPBACK, (), make_recorder, nobody)
    await listener.open()
    where = listener.addresses[0]
    _, channel = await asyncio.get_running_loop().create_connection(
        lambda: WatchedChannel(make_recorder()), where.host, where.port
    )
    assert channel.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    assert channel.socket.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE)
    assert channel.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == 10_000  # ms
    channel.close()
    await channel.lost
    await listener.close()


def test_only_the_relay_s_loop_reads_a_connection(make_recorder: "type[Recorder]") -> None:
    """Python 3.11.2 (Debian 12) has a transport begin to read though it was paused as it was made."""
    faults: list[object] = []
    near, far = make_recorder(), make_recorder()

    async def main() -> None:
        loop = asyncio.get_running_loop()
        assert isinstance(loop, RelayLoop)
        loop.set_exception_handler(lambda _, context: faults.append(context))
        listener = TcpListener(LOOPBACK, (), lambda: far, nobody)
        await listener.open()
        where = listener.addresses[0]
        _, channel = await loop.create_connection(lambda: WatchedChannel(near), where.host, where.port)
        assert channel.socket.fileno() not in loop.selector.get_map()
        channel.close()
        await channel.lost
        await listener.close()

    with asyncio.Runner(loop_factory=RelayLoop) as runner:
        runner.run(main())
    assert faults == []


async def test_an_address_outside_allow_is_closed_and_counted(make_recorder: "type[Recorder]") -> None:
    far = make_recorder()
    refused: list[tuple[str, Refusal]] = []
    listener = TcpListener(
        LOOPBACK, [ip_network("10.0.0.0/8")], lambda: far, lambda host, why: refused.append((host, why))
    )
    await listener.open()
    reader, writer = await connect(listener.addresses[0])
    async with asyncio.timeout(30):
        with contextlib.suppress(ConnectionResetError):  # as good as an end
            assert await reader.read() == b""
    writer.close()
    assert refused == [("127.0.0.1", Refusal.NOT_ALLOWED)]
    assert listener.refused == 1
    assert far.opens == 0
    assert far.reasons == []
    await listener.close()


@pytest.mark.parametrize("networks", [["10.0.0.0/8"], []])
@pytest.mark.parametrize("make_loop", [RelayLoop, asyncio.new_event_loop])
def test_whoever_has_gone_before_he_is_accepted_costs_nothing_and_commands_nothing(
    make_recorder: "type[Recorder]",
    eventually: "Eventually",
    networks: list[str],
    make_loop: Callable[[], asyncio.AbstractEventLoop],
) -> None:
    """Such a connection has no peer any more, and what it sent can still be read."""
    faults: list[object] = []
    refused: list[str] = []
    far = make_recorder()

    async def main() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: faults.append(context))
        allow = [ip_network(network) for network in networks]
        listener = TcpListener(LOOPBACK, allow, lambda: far, lambda host, _: refused.append(host))
        await listener.open()
        where = listener.addresses[0]
        for _ in range(5):
            gone = socket.create_connection((where.host, where.port))
            gone.sendall(b"a command")
            gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            gone.close()
        await eventually(lambda: listener.accepted == 5 and not listener.peers)
        await listener.close()

    with asyncio.Runner(loop_factory=make_loop) as runner:
        runner.run(main())
    assert faults == []
    assert far.data == b""
    assert set(refused) <= {"127.0.0.1"}


async def test_an_address_inside_allow_is_let_in(make_recorder: "type[Recorder]") -> None:
    far = make_recorder()
    networks = [ip_network("10.0.0.0/8"), ip_network("127.0.0.0/8")]
    listener = TcpListener(LOOPBACK, networks, lambda: far, nobody)
    await listener.open()
    _, writer = await connect(listener.addresses[0])
    writer.write(b"hello")
    await far.until(lambda end: end.data == b"hello")
    assert len(listener.peers) == 1
    writer.close()
    await far.until(lambda end: len(end.reasons) == 1)
    await listener.close()


async def test_ipv6_is_served(make_recorder: "type[Recorder]") -> None:
    far = make_recorder()
    listener = TcpListener(TcpEndpoint("::1", 0), [ip_network("::1/128")], lambda: far, nobody)
    try:
        await listener.open()
    except RefusedError:
        pytest.skip("this machine has no IPv6")
    _, writer = await connect(listener.addresses[0])
    writer.write(b"six")
    await far.until(lambda end: end.data == b"six")
    writer.close()
    await listener.close()


async def test_all_ipv6_addresses_are_no_ipv4_addresses(make_recorder: "type[Recorder]") -> None:
    """So ``allow`` of one kind never lets the other kind in, and a port may have a listener of each."""
    port = free_port()  # of both kinds: no other test listens there with the other one
    listener = TcpListener(TcpEndpoint("::", port), (), make_recorder, nobody)
    try:
        await listener.open()
    except RefusedError:
        pytest.skip("this machine has no IPv6")
    with pytest.raises(ConnectionRefusedError):
        await connect(TcpEndpoint("127.0.0.1", port))
    other = TcpListener(TcpEndpoint("0.0.0.0", port), (), make_recorder, nobody)
    await other.open()
    for host in ("::1", "127.0.0.1"):
        _, writer = await connect(TcpEndpoint(host, port))
        writer.close()
    await listener.close()
    await other.close()


async def test_connections_are_limited(make_recorder: "type[Recorder]", eventually: "Eventually") -> None:
    refused: list[tuple[str, Refusal]] = []
    listener = TcpListener(LOOPBACK, (), make_recorder, lambda host, why: refused.append((host, why)))
    await listener.open()
    writers = [(await connect(listener.addresses[0]))[1] for _ in range(MAX_CONNECTIONS)]
    reader, extra = await connect(listener.addresses[0])
    await eventually(lambda: bool(refused))
    assert refused == [("127.0.0.1", Refusal.TOO_MANY)]
    assert Refusal.TOO_MANY.value == "too many connections at once (max_connections)"
    assert listener.refused == 1
    assert len(listener.peers) == MAX_CONNECTIONS
    for writer in [*writers, extra]:
        writer.close()
    del reader
    await listener.close()


async def test_who_was_accepted_while_the_listener_stopped_is_closed(make_recorder: "type[Recorder]") -> None:
    """The loop calls a protocol a turn after the system has handed a connection over."""
    receiver = make_recorder()
    listener = TcpListener(LOOPBACK, (), lambda: receiver, lambda host, why: None)
    await listener.open()
    with socket.create_server(("127.0.0.1", 0)) as handing_over:
        there = socket.create_connection(handing_over.getsockname())
        here, _ = handing_over.accept()
    here.setblocking(False)
    listener.stop_accepting()
    with there:
        channel = _AcceptedChannel(listener, receiver)
        await asyncio.get_running_loop().connect_accepted_socket(lambda: channel, here)
        assert await asyncio.get_running_loop().run_in_executor(None, there.recv, 1) == b""
    await listener.close()
    assert (listener.peers, listener.accepted, listener.refused) == ([], 0, 0)


@pytest.mark.parametrize("turns", range(5))
async def test_who_connected_just_before_a_stop_is_closed(
    make_recorder: "type[Recorder]", turns: int
) -> None:
    """At each turn of the loop between the system's taking the connection and the first byte."""
    listener = TcpListener(LOOPBACK, (), make_recorder, nobody)
    await listener.open()
    where = listener.addresses[0]
    with socket.create_connection((where.host, where.port), timeout=30) as there:
        for _ in range(turns):
            await asyncio.sleep(0)
        await listener.close()
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.get_running_loop().run_in_executor(None, there.recv, 1) == b""
    assert listener.peers == []


async def test_a_port_in_use_is_named_with_the_remedy(make_recorder: "type[Recorder]") -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        listener = TcpListener(TcpEndpoint("127.0.0.1", port), (), make_recorder, nobody)
        with pytest.raises(RefusedError, match=rf"127\.0\.0\.1:{port} is in use .* choose another port"):
            await listener.open()
        await listener.close()


async def test_an_address_of_another_machine_is_named(make_recorder: "type[Recorder]") -> None:
    listener = TcpListener(TcpEndpoint("192.0.2.1", 0), (), make_recorder, nobody)  # RFC 5737: nobody's
    with pytest.raises(RefusedError, match="is not an address of this machine"):
        await listener.open()


async def test_a_missing_peer_is_waited_for(
    make_recorder: "type[Recorder]", eventually: "Eventually"
) -> None:
    near, far = make_recorder(), make_recorder()
    with socket.create_server(("127.0.0.1", 0)) as other:
        endpoint = TcpEndpoint("127.0.0.1", other.getsockname()[1])
    failed = asyncio.Event()
    failures: list[str] = []

    def note(why: str) -> None:
        failures.append(why)
        failed.set()

    connector = TcpConnector(endpoint, near, note)
    await connector.open()
    async with asyncio.timeout(30):
        await failed.wait()
    assert str(endpoint) in failures[0]
    assert connector.failure == failures[0]
    listener = TcpListener(endpoint, (), lambda: far, nobody)
    await listener.open()
    await near.until(lambda end: end.opens == 1)
    await eventually(lambda: not connector.failure)
    assert len(failures) == 1
    await connector.close()
    await listener.close()


async def test_a_peer_that_restarts_is_found_again(make_recorder: "type[Recorder]") -> None:
    near, far = make_recorder(), make_recorder()
    listener = TcpListener(LOOPBACK, (), lambda: far, nobody)
    await listener.open()
    endpoint = listener.addresses[0]
    connector = TcpConnector(endpoint, near, ignore)
    await connector.open()
    await near.until(lambda end: end.opens == 1)
    await listener.close()
    await near.until(lambda end: len(end.reasons) == 1)
    listener = TcpListener(endpoint, (), lambda: far, nobody)
    await listener.open()
    await near.until(lambda end: end.opens == 2)
    near.write(b"again")
    await far.until(lambda end: end.data == b"again")
    assert connector.opens == 2
    await connector.close()
    await listener.close()


@pytest.mark.parametrize("ends", ["close", "abort"])
async def test_a_connection_whose_peer_takes_nothing_can_be_ended(
    make_recorder: "type[Recorder]", eventually: "Eventually", ends: str
) -> None:
    faults: list[object] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: faults.append(context))
    far = make_recorder()
    listener = TcpListener(LOOPBACK, [], lambda: far, nobody)
    await listener.open()
    where = listener.addresses[0]
    peer = socket.create_connection((where.host, where.port))
    await eventually(lambda: far.channel is not None)
    channel = next(iter(listener._channels))
    for _ in range(200):
        assert far.channel is not None
        far.channel.write(bytes(65536))
    getattr(channel, ends)()
    peer.close()
    await eventually(lambda: not listener.peers)
    await listener.close()
    assert faults == []
