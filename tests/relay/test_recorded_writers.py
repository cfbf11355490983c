"""Who moves an axis is in a recording, so that its replay decides as it was decided."""

import asyncio
from pathlib import Path

import msgspec
import pytest

from gateway.exchange.plan import ControllerPlan
from gateway.exchange.rights import Rights
from gateway.modbus.mbap import encode_mbap
from gateway.recording import traffic
from gateway.recording.writer import Recorder
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.transport.endpoints import TcpEndpoint
from tests.support.commands import typed
from tests.support.config import axis, gateway_toml, line
from tests.support.recordings import HEADER, entries_of, replayed
from tests.support.relay import QUICK, Bench, axis_plan, until_up

LOOPBACK = TcpEndpoint("127.0.0.1", 0)
WRITE = bytes.fromhex("10 0064 0002 04 0000 0000")
CONFIG = gateway_toml(line(1, {"cnc": 1502, "panel": 1503}), axis(compensation="on"))


def echo(data: bytes) -> bytes:
    return data[:4] + bytes((0, 6)) + data[6:12]


async def test_two_hosts_on_one_listener_are_two_writers_in_a_replay(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    _, where = await bench.drive("tcp", echo)
    rights = Rights(function_codes=frozenset({16}))
    link = ControllerLink(ControllerPlan("cnc", rights=rights), LOOPBACK)
    plan = GatewayPlan("bench", (LinePlan("line", where, (link,), (axis_plan(),), QUICK),))
    relay = await bench.start(plan, recorder=Recorder(path, HEADER))
    await until_up(relay)
    place = relay.address("line", "cnc")
    answers = []
    for host in ("127.0.0.1", "127.0.0.9", "127.0.0.1"):
        reader, writer = await asyncio.open_connection(place.host, place.port, local_addr=(host, 0))
        for pdu in (WRITE, bytes.fromhex("03 0064 0002")):
            writer.write(encode_mbap(1, 1, pdu))
            head = await reader.readexactly(7)
            answers.append((await reader.readexactly(int.from_bytes(head[4:6], "big") - 1)).hex())
        bench.stack.callback(writer.close)
    await relay.stop()
    assert answers == ["1000640002", "8301", "9006", "8301", "1000640002", "8301"]
    entries = entries_of(path)
    peers = {entry.peer for entry in entries if isinstance(entry, traffic.Request)}
    assert peers == {"127.0.0.1", "127.0.0.9"}
    assert replayed(plan, entries).different == 0
    # It is the host that makes the difference.
    nameless = [
        msgspec.structs.replace(entry, peer="") if isinstance(entry, traffic.Request) else entry
        for entry in entries
    ]
    assert replayed(plan, nameless).different >= 1


def recording(path: Path, number: int) -> Path:
    """Write what a release recorded that knew no writers: two controllers moved the axis by turns."""
    entries: list[traffic.Entry] = [
        traffic.Header(number, "0.0.1", "2026-01-01T00:00:00+00:00", "gateway.toml", CONFIG),
        traffic.Up("xyz", 1_000_000),
    ]
    for port, name in enumerate(("cnc", "panel", "cnc"), start=1):
        pdu = WRITE[:-1] + bytes((port,))
        entries += [
            traffic.Request("xyz", port * 10_000_000, port, name, 7, 1, pdu.hex()),
            traffic.Sent("xyz", 1, pdu.hex()),
            traffic.Reply("xyz", port * 10_000_000 + 1_000_000, 1, WRITE[:5].hex()),
            traffic.Answered("xyz", port, 7, 1, WRITE[:5].hex()),
        ]
    entries.append(traffic.End(len(entries) - 1))
    path.write_bytes(b"".join(map(traffic.encode, entries)).replace(b',"peer":""', b""))
    return path


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [
        (traffic.WITHOUT_PEERS, 0, "7 inputs, 6 outputs: all as recorded"),
        (traffic.FORMAT, 1, "differ"),
        (
            4,
            1,
            (
                "a recording of format 4, made by release 0.0.1: replay it with that release; "
                "this one replays formats 1 to 3"
            ),
        ),
    ],
)
def test_older_recordings_play_as_recorded(tmp_path: Path, number: int, code: int, said: str) -> None:
    done = typed("replay", str(recording(tmp_path / "old.jsonl", number)))
    assert said in done.stdout + done.stderr
    assert done.returncode == code
