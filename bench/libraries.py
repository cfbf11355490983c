"""What some libraries take beside what could stand in their place: ``python -m bench.libraries``.

Prints what ``docs/libraries.md`` quotes in round figures. Each figure is the best of several rounds: what is
between them is the machine's.
"""

import json
import subprocess
import sys
from collections.abc import Callable
from timeit import Timer
from typing import Final

import msgspec
import numpy as np
from prometheus_client import CollectorRegistry, Histogram

from gateway.compensation.curve import Curve
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.exchange.latency import BUCKETS, bucket_of
from gateway.modbus.crc import crc16

ROUNDS: Final = 15
FRAME: Final = bytes.fromhex("01 10 06 06 00 02 04 00 01 86 A0")
"""A write of one 32-bit position, without its check sum."""
RELAY: Final = "import gateway.relay.__main__, gateway.relay.run"
SUPERVISOR: Final = "import gateway.supervisor.__main__, gateway.supervisor.supervisor"
STARTS: Final = {
    "nothing": "pass",
    "msgspec": "import msgspec",
    "pydantic, one model": "from pydantic import BaseModel\nclass Model(BaseModel):\n    key: int",
    "structlog": "import structlog",
    "typer and rich": "import typer, rich.table",
    "starlette and uvicorn": "import starlette.applications, uvicorn.protocols.http.h11_impl",
    "cryptography, certificates": "from cryptography import x509",
    "matplotlib, drawing without a screen": "import matplotlib.figure",
    "pymodbus, client and server": "import pymodbus.client, pymodbus.server",
    "the relay": RELAY,
    "the relay and structlog": f"{RELAY}, structlog",
    "the supervisor": SUPERVISOR,
    "the supervisor and structlog": f"{SUPERVISOR}, structlog",
}
"""What a process loads for it."""
_TABLE: Final = [0] * 256
for _byte in range(256):
    _value = _byte
    for _ in range(8):
        _value = _value >> 1 ^ (0xA001 if _value & 1 else 0)
    _TABLE[_byte] = _value


def crc_by_table(data: bytes) -> int:
    """Return the check sum as a program without a library would work it out."""
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _TABLE[(value ^ byte) & 0xFF]
    return value


def status() -> dict[str, object]:
    """Return something of the size and shape of the status of a mill with three axes."""
    axis = {f"key_{number}": [number * 1.25, number, None, "active"][number % 4] for number in range(60)}
    lines = {f"line_{number}": {f"counter_{key}": key * 1000 for key in range(40)} for number in range(3)}
    return {"axes": dict.fromkeys("xyz", axis), "lines": lines}


def best_us(call: Callable[[], object]) -> float:
    """Return the microseconds of one call in the best round."""
    timer = Timer(call)
    number, _ = timer.autorange()
    return min(timer.repeat(ROUNDS, number)) / number * 1e6


def start(code: str) -> tuple[float, float]:
    """Return milliseconds of a processor and MiB of a Python that runs ``code`` and ends."""
    # Not ru_maxrss, which a process takes over from the one that started it.
    program = f"{code}\nimport time\nprint(time.process_time(), end=' ')\n"
    program += "print(open('/proc/self/status').read().split('VmHWM:')[1].split()[0])"
    rounds = []
    for _ in range(ROUNDS):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        spent_s, size_kib = done.stdout.split()
        rounds.append((float(spent_s) * 1e3, float(size_kib) / 1024))
    return min(spent for spent, _ in rounds), min(size for _, size in rounds)


def main() -> None:
    """Measure and print."""
    model = status()
    encoded = msgspec.json.encode(model)
    assert crc16(FRAME) == crc_by_table(FRAME)
    assert json.loads(encoded) == model
    points = [float(x) for x in range(1000)]
    curve = Curve(make_table(points, [0.001 * x for x in points], [0.0] * 1000, Units.MM))
    array = np.array(points)
    counts = [0] * BUCKETS
    histogram = Histogram("span", "", registry=CollectorRegistry(), buckets=[2.0**n for n in range(20)])

    def count() -> None:
        counts[bucket_of(33_333)] += 1

    rows: list[tuple[str, Callable[[], object]]] = [
        (f"check sum of {len(FRAME)} bytes, fastcrc", lambda: crc16(FRAME)),
        (f"check sum of {len(FRAME)} bytes, 256-entry table in Python", lambda: crc_by_table(FRAME)),
        (f"status of {len(encoded)} bytes to JSON, msgspec", lambda: msgspec.json.encode(model)),
        (f"status of {len(encoded)} bytes to JSON, json", lambda: json.dumps(model)),
        ("and back, msgspec", lambda: msgspec.json.decode(encoded)),
        ("and back, json", lambda: json.loads(encoded)),
        ("a number between 1 000 points, ours", lambda: curve.forward(333.3)),
        ("a number between 1 000 points, numpy, lists", lambda: np.interp(333.3, points, points)),
        ("a number between 1 000 points, numpy, arrays", lambda: np.interp(333.3, array, array)),
        ("a time into a histogram, ours", count),
        ("a time into a histogram, prometheus-client", lambda: histogram.observe(33_333)),
    ]
    print("| what | µs |\n| --- | ---: |")
    for name, call in rows:
        print(f"| {name} | {best_us(call):.3g} |")
    print("\n| a Python that loads | processor ms | MiB |\n| --- | ---: | ---: |")
    for name, code in STARTS.items():
        spent_ms, size_mib = start(code)
        print(f"| {name} | {spent_ms:.0f} | {size_mib:.1f} |")


if __name__ == "__main__":
    main()
