"""Peers that vanish, in a network of their own: a program of ``test_vanished_peers.py`` that says what came.

A rule of the routing drops all that the port of the peer sends, so it acknowledges nothing any more, as a
controller whose power went. One that has started again has no socket any more, and resets what it is asked.
"""

import asyncio
import json
import socket
import subprocess
import sys
from typing import Final

from gateway.clock import boot_ns
from gateway.transport.connections import Closing
from gateway.transport.endpoints import TcpEndpoint
from gateway.transport.limits import ConnectionLimits
from gateway.transport.loop import RelayLoop
from gateway.transport.tcp import Refusal, TcpListener
from tests.transport.conftest import Recorder

TCP_REPAIR: Final = 19
RETRY_S: Final = 0.1
PATIENCE_NS: Final = 2_000_000_000


def ip(command: str) -> None:
    subprocess.run(["ip", *command.split()], check=True)


def drop_all_from(port: int) -> None:
    """Let nothing leave from a port any more; the addresses of this machine are looked up after that."""
    ip(f"rule add pref 10 ipproto tcp sport {port} blackhole")


async def vanishes(how: str) -> dict[str, object]:
    receivers: list[Recorder] = []
    refused: list[str] = []
    closed: list[Closing] = []

    def receiver() -> Recorder:
        receivers.append(Recorder())
        return receivers[-1]

    def note(_host: str, why: Refusal) -> None:
        refused.append(why.name)

    listener = TcpListener(
        TcpEndpoint("127.0.0.1", 0),
        (),
        receiver,
        note,
        limits=ConnectionLimits(max_connections=1),
        on_closed=lambda _host, why: closed.append(why),
        acknowledged_within_ns=PATIENCE_NS,
    )
    await listener.open()
    where = listener.addresses[0].host, listener.addresses[0].port
    peer = socket.create_connection(where)
    while not (receivers and receivers[0].opens):  # noqa: ASYNC110 - accepted in another turn of the loop
        await asyncio.sleep(0)
    if how == "restarted":
        peer.setsockopt(socket.IPPROTO_TCP, TCP_REPAIR, 1)
        peer.close()
    elif how != "there":
        drop_all_from(peer.getsockname()[1])
    if how == "owed":
        receivers[0].write(b"a reply that is never acknowledged")
    began_ns = boot_ns()
    await asyncio.sleep(1.2)
    served = False
    while not served and boot_ns() - began_ns < 8_000_000_000:
        reader, writer = await asyncio.open_connection(*where)
        try:
            async with asyncio.timeout(RETRY_S):
                await reader.read()  # who is refused is closed at once
        except TimeoutError:
            served = True
        except ConnectionResetError:
            pass
        if not served:
            writer.close()
            await asyncio.sleep(RETRY_S)
    took_s = (boot_ns() - began_ns) / 1e9
    await listener.close()
    return {
        "served": served,
        "took_s": round(took_s, 2),
        "closed": [why.name for why in closed],
        "reason": receivers[0].reasons[0],
        "refused": sorted(set(refused)),
    }


def main() -> None:
    for command in ("link set lo up", "rule add pref 100 lookup local", "rule del pref 0"):
        ip(command)
    with asyncio.Runner(loop_factory=RelayLoop) as runner:
        sys.stdout.write(json.dumps(runner.run(vanishes(sys.argv[1]))))


if __name__ == "__main__":
    main()
