"""A real HTTP service on real sockets, and a client that says exactly what a test wants said."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from gateway.catalogue.entry import EventEntry, Severity
from gateway.clock import now_utc
from gateway.compensation.settings import AxisSettings
from gateway.compensation.table import CorrectionTable
from gateway.config.http_model import HttpSection
from gateway.ipc.address import SUPERVISOR_SOCKET_NAME
from gateway.state.folder import write_whole
from gateway.state.tables import compiled, digest_of, table_path
from gateway.status.model import GatewayStatus, Model
from gateway.supervisor.acknowledged import AlarmAcknowledgement
from gateway.supervisor.broadcast import Broadcast
from gateway.supervisor.http.answers import LOCAL, TCP, Limits
from gateway.supervisor.http.documents import Window
from gateway.supervisor.http.service import HttpService
from gateway.supervisor.model import whole_model
from gateway.supervisor.outcome import ReloadOutcome
from gateway.supervisor.past import Noted
from gateway.transport.listener import HandshakesAtOnce
from tests.support.ports import free_port
from tests.support.status_models import model_of, plain, relay_model_of, supervisor_of

PATIENCE_S = 20.0
EVENTS = "GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n"
STATUS = "GET /status HTTP/1.1\r\nHost: localhost\r\n\r\n"
BOUNDS_US = [5, 10, 100, 1000]
TOOK: dict[str, Any] = {"p50": 8.0, "p99": 90.0, "p999": 99.0, "max": 120.0, "max_minute": 60.0}
CERTIFICATE = {
    "key": "certificate",
    "file": "/etc/page.pem",
    "subject": "CN=mill",
    "ends": "2001-09-09T01:46:40+00:00",
    "days_left": 300,
}
CONTROLLER: dict[str, Any] = {"name": "cnc", "role": "motion", "connections": ["a", "b"], "gateway_us": TOOK}
LINE = {
    "state": "up",
    "exchanges": 7,
    "timeouts": 1,
    "refused": 2,
    "crc_errors": 3,
    "malformed": 0,
    "wire_s": 1.5,
    "added_frames_s": 0.25,
    "gateway_us": {**TOOK, "below": [1, 4, 6, 7, 7]},
    "drives": {"address": "127.0.0.1:502", "opens": 1},
    "controllers": [CONTROLLER],
}
ANSWERS: dict[str, Any] = {"answered_s": 0.1}
PLC: dict[str, Any] = {
    "name": "plc",
    "role": "motion",
    "address": "/dev/ttyS1",
    "state": "up",
    "failure": "",
    "whole": 0,
    "damaged": 12,
    "minute": {"whole": 0, "damaged": 12},
    "gateway_us": TOOK,
}
SICK: dict[str, Any] = {
    "minute": {"exchanges": 500, "damaged": 3},
    "unit_ids": {
        "axes": {"x": 1},
        "heard": [1, 17],
        "strangers": [17],
        "asked_by": {"cnc": [1, 17]},
        "drives": {"1": {"silent_s": 12.5, "timeouts_in_a_row": 12, "damaged": 3}, "17": ANSWERS},
    },
    "controllers": [CONTROLLER, PLC],
}
"""A line whose drive is silent and whose second controller nobody understands."""
AXIS = {
    "compensation": "active",
    "units": "mm",
    "direction": "forward",
    "gain": {"forward": 1.0, "backward": 0.5},
    "travel": [0.0, 100.0],
    "correction": 0.05,
    "nominal_setpoint": 50.0,
    "corrected_setpoint": 50.05,
    "nominal_actual": 49.0,
    "table": {
        "file": "x.tab",
        "format": "centroid-3",
        "sha256": "ab",
        "status": "active",
        "loaded_at": "2001-09-09T01:46:40.250+00:00",
    },
    "latency": {"gateway_us": {**TOOK, "below": [0, 2, 3, 3, 4]}, "budget_us": 1000.0, "budget_overruns": 5},
}
TERMS: dict[str, Any] = {
    "correction": -0.0175,
    "thermal": {
        "state": "following",
        "celsius": 30.5,
        "age_s": 1.25,
        "difference": 10.0,
        "correction": -0.0575,
    },
    "cross": {"state": "following", "axes": ["y"], "correction": 0.04},
}
"""Of an axis with ``thermal`` and ``cross``."""
WELL = {
    "configuration": {"file": "gateway.toml"},
    "tables_folder": {"folder": "tables"},
    "state_folder": {"folder": "state"},
    "http": {"problem": None, "certificates": [CERTIFICATE]},
    "mqtt": {"problem": None},
}


def snapshot(
    line: dict[str, Any] | None = None, axis: dict[str, Any] | None = None, **gateway: Any
) -> dict[str, Any]:
    """What a relay with one line and one axis says."""
    return {
        "gateway": {
            "name": "mill-1",
            "version": "0.1.0",
            "compiled": False,
            "uptime_s": 12.5,
            "relay": "up",
            "snapshot_age_s": 0.0,
            "latency_bounds_us": BOUNDS_US,
            "scheduling": {"cpus": [0]},
            **gateway,
        },
        "lines": {"xyz": {**LINE, **(line or {})}},
        "axes": {"x": {**AXIS, **(axis or {})}},
    }


def model(
    seen: dict[str, Any] | None = None,
    *,
    is_relay_up: bool = True,
    age_s: float | None = 0.1,
    supervisor: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """The whole model, as the supervisor makes it of a snapshot."""
    return plain(
        whole_model(
            "mill-1",
            relay_model_of(snapshot() if seen is None else seen),
            is_relay_up=is_relay_up,
            snapshot_age_s=age_s,
            tables={},
            supervisor=supervisor_of({**WELL, **(supervisor or {})}),
        )
    )


def with_terms(**changes: Any) -> dict[str, Any]:
    """A whole model with terms, of which some differ."""
    return model(snapshot(axis={"terms": {**TERMS, **changes}}))


def large_model() -> Model:
    """A model of more bytes than all buffers on the way hold."""
    return Model(gateway=GatewayStatus(name="a" * 30_000_000))


@dataclass
class Answer:
    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def data(self) -> Any:
        assert self.headers["content-type"] == "application/json"
        return json.loads(self.body)


class Line:
    """One connection to the service."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    async def say(self, data: bytes | str) -> None:
        self.writer.write(data.encode() if isinstance(data, str) else data)
        with contextlib.suppress(ConnectionError):
            await self.writer.drain()

    async def hear(self, *, has_body: bool = True) -> Answer:
        async with asyncio.timeout(PATIENCE_S):
            head = (await self.reader.readuntil(b"\r\n\r\n")).decode().split("\r\n")
            headers = {
                name.lower(): value.strip() for name, _, value in (line.partition(":") for line in head[1:-2])
            }
            length = int(headers.get("content-length", "0"))
            body = await self.reader.readexactly(length) if has_body else b""
        return Answer(int(head[0].split()[1]), headers, body)

    async def until(self, *parts: bytes) -> bytes:
        """Read up to and with some bytes, one after the other."""
        async with asyncio.timeout(PATIENCE_S):
            return b"".join([await self.reader.readuntil(part) for part in parts])

    async def rest(self) -> bytes:
        """Read until the service closes."""
        data = b""
        async with asyncio.timeout(PATIENCE_S):
            with contextlib.suppress(ConnectionError):
                while part := await self.reader.read(65536):
                    data += part
        return data

    def close(self) -> None:
        self.writer.transport.abort()


@dataclass
class Served:
    """A service that runs, with everything it said."""

    service: HttpService
    broadcast: Broadcast
    port: int
    state: Path
    said: list[tuple[str, dict[str, object]]] = field(default_factory=list)
    reloads: int = 0
    lines: list[Line] = field(default_factory=list)

    def connections(self) -> int:
        """How many connections the system has that lead to the port: their other ends, of this process."""
        rows = Path("/proc/net/tcp").read_text().splitlines()[1:]
        ends = [row.split()[1:4] for row in rows]
        return sum(here == f"0100007F:{self.port:04X}" and state == "01" for here, _, state in ends)

    @property
    def local(self) -> Path:
        return self.state / SUPERVISOR_SOCKET_NAME

    async def connect(self, *, is_local: bool = False) -> Line:
        if is_local:
            line = Line(*await asyncio.open_unix_connection(str(self.local), limit=2**24))
        else:
            line = Line(*await asyncio.open_connection("127.0.0.1", self.port, limit=2**24))
        self.lines.append(line)
        return line

    async def says(self, data: bytes | str, *, is_local: bool = False) -> Line:
        """Return a connection on which something was said."""
        line = await self.connect(is_local=is_local)
        await line.say(data)
        return line

    async def ask(
        self, target: str, method: str = "GET", *more: str, is_local: bool = False, host: str = "localhost"
    ) -> Answer:
        head = (f"{method} {target} HTTP/1.1", f"Host: {host}", *more, "", "")
        line = await self.says("\r\n".join(head), is_local=is_local)
        answer = await line.hear(has_body=method != "HEAD")
        line.close()
        return answer


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - nobody is told
            await asyncio.sleep(0.001)


@contextlib.asynccontextmanager
async def serving(
    state: Path,
    *,
    broadcast: Broadcast | None = None,
    tcp: Limits = TCP,
    local: Limits = LOCAL,
    handshakes: HandshakesAtOnce = HandshakesAtOnce(),  # noqa: B008
    settings: AxisSettings | None = None,
    outcome: ReloadOutcome | None = None,
    now: Callable[[], datetime] = now_utc,
    acknowledge: Callable[[str, str, str, str, str], AlarmAcknowledgement | None] = lambda *_: None,
    history: Callable[[str, float], Awaitable[Sequence[Noted] | None]] | None = None,
    newest: dict[str, Any] | None = None,
) -> AsyncIterator[Served]:
    """A service that is open on both of its listeners; ``newest`` is the model that it shows first."""
    broadcast = Broadcast() if broadcast is None else broadcast
    port = free_port()

    async def reload(_who: Mapping[str, object]) -> ReloadOutcome:
        served.reloads += 1
        return outcome or ReloadOutcome()

    def say(event: EventEntry, severity: Severity | None = None, **fields: object) -> None:
        served.said.append((event.name, fields))

    window = Window(broadcast, state, lambda axis: settings, reload, say, acknowledge=acknowledge)
    if history is not None:
        window = replace(window, history=history)
    service = HttpService(window, tcp, local, handshakes, now=now)
    served = Served(service, broadcast, port, state)
    service.configure(HttpSection(listen=f"127.0.0.1:{port}"), "mill-1", Path())
    running = asyncio.create_task(service.run())
    try:
        await until(lambda: running.done() or (bool(served.said) and served.local.exists()))
        if newest is not None:
            broadcast.publish(model_of(newest))
        yield served
    finally:
        for line in served.lines:
            line.close()
        running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await running


def keep_table(state: Path, table: CorrectionTable) -> str:
    """Keep a compiled table where the relay's tables are; returns its digest."""
    data = compiled(table)
    digest = digest_of(data)
    path = table_path(state, digest)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, data)
    return digest
