"""The bench of a fleet: what its machines say on the wire, and the arithmetic of its text."""

import asyncio
from collections.abc import Sequence

import pytest

from bench.fleet import DEFAULT, TUNED, Figures, Tuning, kind_of, text
from bench.fleet_plant import Drives, frames

WRITE = bytes.fromhex("0001 0000 000b 02 10 0064 0002 04 00000e74")
"""To unit 2: position 3700 at address 100, as Modbus Application Protocol V1.1b3, 6.12, has it."""
READ = bytes.fromhex("0002 0000 0006 02 03 0064 0002")
"""The same position back (6.3)."""


class Wire(asyncio.Transport):
    """What was written."""

    def __init__(self) -> None:
        super().__init__()
        self.written: list[bytes] = []

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self.written.append(bytes(data))


def test_a_frame_that_comes_in_parts_is_taken_when_it_is_whole() -> None:
    buffer = bytearray(WRITE + READ[:7])
    assert frames(buffer) == [WRITE]
    assert frames(buffer) == []
    buffer += READ[7:]
    assert frames(buffer) == [READ]
    assert buffer == b""


def test_a_drive_echoes_a_position_and_reads_it_back() -> None:
    drives, wire = Drives(), Wire()
    drives.connection_made(wire)
    drives.data_received(WRITE + READ)
    assert wire.written == [
        bytes.fromhex("0001 0000 0006 02 10 0064 0002"),
        bytes.fromhex("0002 0000 0007 02 03 04 00000e74"),
    ]


@pytest.mark.parametrize(
    ("rest", "kind"),
    [
        (["info"], "info"),
        (["axis", "a1-1"], "axis/AXIS"),
        (["axis", "a1-1", "table"], "axis/AXIS/table"),
        (["line", "line1"], "line/LINE"),
    ],
)
def test_a_topic_is_counted_without_its_names(rest: Sequence[str], kind: str) -> None:
    assert kind_of(rest) == kind


def figures(tuning: Tuning, messages: float) -> Figures:
    return Figures(
        tuning,
        gateways=4,
        messages=messages,
        payload_bytes=0.0,
        bytes=messages * 1000.0,
        topics=[("axis/AXIS", messages, 1250.0)],
        cores={"relays": 0.06, "supervisors": 0.04, "broker": 0.002, "Prometheus": 0.004},
        memory={
            "relays": 4 * 2**20 * 20.0,
            "supervisors": 4 * 2**20 * 40.0,
            "broker": 0.0,
            "Prometheus": 0.0,
        },
        up=4,
        series=1000,
        samples=200.0,
        page_bytes=23_000.0,
        page_s=0.01,
        machines={"p50_ms": 1.0, "p99_ms": 2.0, "late": 0.0, "refused": 0.0, "exchanges_per_s": 40.0},
    )


def test_the_text_multiplies_what_one_gateway_takes() -> None:
    found = text(
        [figures(DEFAULT, 32.0), figures(TUNED, 2.0)],
        {10.0: [0.21, 0.31, 0.34, 2.5]},
        [("kernel", "Linux 6")],
    ).splitlines()
    plant, fleet = (found.index(f"## {count} gateways, by arithmetic") for count in ("200", "10,000"))
    # 32 messages of 4 gateways are 8 of one: 1600 of 200, and 80 000 of 10 000.
    assert "| messages a second | 1,600 | 100 |" in found[plant:fleet]
    assert "| messages a second | 80,000 | 5,000 |" in found[fleet:]
    # 32 000 bytes a second of 4 are 8000 of one: 1.6 MB of 200.
    assert "| MB a second | 1.60 | 0.10 |" in found[plant:fleet]
    assert "| series | 50,000 | 50,000 |" in found[plant:fleet]
    # 60 MiB of one: 12 000 MiB of 200 are 11.7 GiB. A tenth of a core of 4: 5 cores of 200.
    assert "| GiB of the gateways | 11.7 | 11.7 |" in found[plant:fleet]
    assert "| cores of the gateways | 5.0 | 5.0 |" in found[plant:fleet]
    assert "| 10.0 s | 0.2 s | 0.3 s | 2.5 s | 2.5 s | 2 of 4 |" in found
    assert "- kernel: Linux 6" in found
