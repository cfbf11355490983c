"""Floods, half frames, lies, scans and a second writer, over plain TCP, from a host of their own."""

import contextlib
import resource
import select
import socket
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.attacks.conftest import Strike
from tests.attacks.controller import ADDRESS, PATIENCE_S, UNIT_ID
from tests.attacks.legitimate import Attack, Ground
from tests.support.processes import children

BYSTANDER = "127.0.0.1"
FLOOD = 500
PIPELINED = 10_000
PANEL_WAITS_S = 10
SLOW = 60
GROWTH_KIB = 4_096
READ = b"\x03" + ADDRESS.to_bytes(2, "big") + b"\x00\x02"
WRITE = b"\x10" + ADDRESS.to_bytes(2, "big") + b"\x00\x02\x04" + bytes(4)
ENDLESS = bytes.fromhex("0001 0000 00fe 01 10 0064 0079 f2")
"""The beginning of the longest request there is."""


def connected(ground: Ground, port: int | None = None, host: str = "") -> socket.socket:
    """Connect as the attacker, or from another host, to the port of the controller, or to another one."""
    host = host or ground.attacker
    port = port or ground.port
    return socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S, source_address=(host, 0))


def received(connection: socket.socket, size: int) -> bytes:
    found = b""
    while len(found) < size:
        piece = connection.recv(size - len(found))
        assert piece, f"closed after {found.hex()}"
        found += piece
    return found


def asked(connection: socket.socket, pdu: bytes, unit_id: int = UNIT_ID) -> bytes:
    """Ask for something; return the PDU of the answer."""
    connection.sendall(encode_mbap(7, unit_id, pdu))
    head = received(connection, 7)
    return received(connection, int.from_bytes(head[4:6], "big") - 1)


def with_panel(*keys: str) -> Callable[[Ground, str], str]:
    """Return what adds a controller ``panel`` beside the one that works."""

    def changed(ground: Ground, text: str) -> str:
        lines = ["[[line.xyz.controllers]]", 'name = "panel"', f'tcp = "127.0.0.1:{ground.free("panel")}"']
        return text.replace("[axis.x]", "\n".join([*lines, *keys, "", "[axis.x]"]))

    return changed


def as_fast_as_wanted(_ground: Ground, text: str) -> str:
    """Let connections come one after the other: of these attacks they are not the point."""
    return text.replace('name = "cnc"', 'name = "cnc"\nconnects_per_s = 1000000')


def flood(ground: Ground) -> str:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 2 * FLOOD)), hard))
    with contextlib.ExitStack() as stack:
        connections = []
        for _ in range(FLOOD):
            with contextlib.suppress(ConnectionResetError):
                connections.append(stack.enter_context(connected(ground)))
        # Whoever has a host of his own gets in all the same, and is served.
        bystander = stack.enter_context(connected(ground, host=BYSTANDER))
        assert asked(bystander, READ)[:2] == b"\x03\x04"
        poll = select.poll()
        for connection in connections:
            poll.register(connection, select.POLLIN)
        still_open = len(connections) - len(poll.poll(0))
    # 64 places: one is the controller's, one the newcomer's.
    assert still_open <= 62
    return f"at least {FLOOD - 62} of {FLOOD} closed at once; a newcomer from another host is served"


def half_frames(ground: Ground) -> str:
    began_s = time.monotonic()
    with contextlib.ExitStack() as stack:
        left = [stack.enter_context(connected(ground)) for _ in range(SLOW)]
        for connection in left:
            connection.sendall(ENDLESS)
        while left:
            assert time.monotonic() < began_s + 30.0
            ended, _, _ = select.select(left, (), (), 0.3)
            for connection in ended:
                with contextlib.suppress(ConnectionResetError):
                    assert connection.recv(300) == b""
                left.remove(connection)
            for connection in left:
                with contextlib.suppress(ConnectionError):
                    connection.sendall(b"\x00")
    return f"{SLOW} of {SLOW} closed, a byte every 0.3 s notwithstanding"


def pipelining(ground: Ground) -> str:
    assert ground.gateway is not None
    relay = children(ground.gateway.process)["gateway.relay"]
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    with connection:
        connection.settimeout(30.0)
        connection.bind((ground.attacker, 0))
        connection.connect(("127.0.0.1", ground.free("panel")))
        before_kib = resident_kib(relay)
        codes: Counter[int] = Counter()
        requests = b"".join(encode_mbap(n, UNIT_ID, READ) for n in range(PIPELINED))
        connection.sendall(requests)
        grown_kib = resident_kib(relay) - before_kib
        settled_s = time.monotonic() + PANEL_WAITS_S + 3.0
        answered: set[int] = set()
        # What waits for longer than its controller does is withdrawn, and has no reply (W5).
        with contextlib.suppress(TimeoutError):
            while len(answered) < PIPELINED:
                connection.settimeout(max(0.5, settled_s - time.monotonic()))
                head = received(connection, 7)
                reply = received(connection, int.from_bytes(head[4:6], "big") - 1)
                assert reply[:2] == b"\x03\x04" or reply == b"\x83\x06"
                number = int.from_bytes(head[:2], "big")
                assert number not in answered
                answered.add(number)
                codes[reply[0]] += 1
        connection.settimeout(PATIENCE_S)
        assert asked(connection, READ)[:2] == b"\x03\x04"
    assert grown_kib < GROWTH_KIB, f"{grown_kib} KiB"
    assert codes[0x83] > PIPELINED // 2
    return f"exception 6 to most of {PIPELINED}; less than {GROWTH_KIB // 1024} MiB of memory"


def resident_kib(pid: int) -> int:
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split(maxsplit=1)[0])


LIES = [
    "0001 0000 0000 01 03 0064 0002",
    "0001 0000 0001 01 03 0064 0002",
    "0001 0000 00ff 01 03 0064 0002" + "00" * 300,
    "0001 0000 ffff 01 10 0064 0002 04" + "00" * 4000,
    "0001 0001 0006 01 03 0064 0002",
    "ffff ffff ffff ff ff ffff ffff",
]


def lying_lengths(ground: Ground) -> str:
    for lie in LIES:
        with connected(ground) as connection:
            connection.sendall(bytes.fromhex(lie))
            connection.shutdown(socket.SHUT_WR)
            answer = b""
            with contextlib.suppress(ConnectionResetError):
                while piece := connection.recv(300):
                    answer += piece
            # Exception 3 where it may be a client that writes too many registers.
            assert answer == (bytes.fromhex("0001 0000 0003 01 83 03") if " 00ff " in lie else b"")
    return f"{len(LIES)} of {len(LIES)} dropped, 1 of them answered with exception 3"


def scan(ground: Ground) -> str:
    with connected(ground, ground.free("panel")) as connection:
        units = Counter(asked(connection, READ, unit_id)[:2] for unit_id in range(256))
        functions = Counter(asked(connection, bytes((f,)) + READ[1:])[:2] for f in range(1, 128) if f != 3)
        addresses = Counter(
            asked(connection, b"\x03" + address.to_bytes(2, "big") + b"\x00\x02")
            for address in range(0, 65_000, 1_000)
        )
    assert units == {b"\x03\x04": 1, b"\x83\x0a": 255}
    assert sum(functions.values()) == 126
    assert {code[1] for code in functions} == {1}
    assert addresses == {b"\x83\x02": 65}
    return "255 × exception 0x0A, 126 × 1, 65 × 2; none of it reached a drive"


def second_writer(ground: Ground) -> str:
    with connected(ground) as connection:
        replies = Counter(asked(connection, WRITE) for _ in range(100))
        assert replies == {b"\x90\x06": 100}
        assert asked(connection, READ)[:2] == b"\x03\x04"
    return "100 × exception 6; it may read"


def writing_monitor(ground: Ground) -> str:
    with connected(ground, ground.free("panel")) as connection:
        replies = Counter(asked(connection, WRITE) for _ in range(100))
    assert replies == {b"\x90\x01": 100}
    return "100 × exception 1"


ATTACKS = [
    Attack("connection flood, 500 at once", flood, "connection-refused"),
    Attack("half frames (slowloris), 60 connections", half_frames, "connection-closed"),
    Attack(
        "pipelining flood, 10 000 requests of a monitor that reads no replies",
        pipelining,
        "request-refused",
        with_panel('role = "monitor"', f"timeout_ms = {PANEL_WAITS_S * 1000}"),
    ),
    Attack(
        "oversize and lying lengths",
        lying_lengths,
        "connection-malformed",
        as_fast_as_wanted,
    ),
    Attack(
        "scans of unit ids, function codes and addresses",
        scan,
        "request-refused",
        with_panel('role = "monitor"', "unit_ids = [1]", "function_codes = [3]", 'readable = ["100-101"]'),
    ),
    Attack("a second writer", second_writer, "second-writer", as_fast_as_wanted),
    Attack(
        "a monitor that writes",
        writing_monitor,
        "request-refused",
        with_panel('role = "monitor"', "connects_per_s = 1000000"),
    ),
]


@pytest.mark.parametrize("attack", ATTACKS, ids=lambda attack: attack.name)
def test_an_attack_gets_nothing_and_the_controller_notices_nothing(attack: Attack, strike: Strike) -> None:
    strike(attack)
