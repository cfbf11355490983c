"""A script of reloads and commands to running processes: socket, MQTT and HTTP, and what comes of each.

Nothing of the program is imported: it is the one that ``python -m`` finds. What depends on the moment (times,
ports, folders, figures of the machine) is written as ``*``.
"""

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from tests.support.mosquitto import Broker

PATIENCE_S: Final = 30.0
PROGRAM: Final = "from gateway.cli.main import main; main()"
TOPICS: Final = "pitch-gateway/same"
CONFIGURATION: Final = """
[gateway]
name = "same"
tables = "tables"

[http]
listen = "127.0.0.1:{http}"

[mqtt]
host = "127.0.0.1"
port = {mqtt}
discovery = "homeassistant"
commands = true
interval_s = 0.1

[line.xy]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.xy.controllers]]
name = "cnc"
tcp = "127.0.0.1:{cnc}"
silent_after_s = 0

[axis.x]
line = "xy"
unit_id = 1
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 200.0]
referenced = "absolute"
table = "x.tab"
compensation = "on"
budget_us = 1000000.0
registers.command = [{{ address = 100, type = "int32" }}]
registers.actual = [{{ address = 200, type = "int32" }}]

[axis.y]
line = "xy"
unit_id = 2
units = "mm"
counts_per_unit = 1000.0
travel = [0.0, 200.0]
referenced = "drive-bit"
table = "y.tab"
compensation = "shadow"
budget_us = 1000000.0
registers.bits.homed = {{ address = 300, bit = 0 }}
registers.command = [{{ address = 100, type = "int32" }}]
registers.actual = [{{ address = 200, type = "int32" }}]
"""
TABLE: Final = """CNC10 TAB FILE VERSION 3
AXIS {axis}
UNITS MILLIMETER
INTERVAL 100.0
ENTRIES 3
0.0 0.0 0.0
100.0 0.01 -0.02
200.0 {last} -0.01
"""
TAKEN: Final = ("table-handed-over", "table-activated")
"""What both processes say of a table that is taken."""
BAD_TABLE: Final = "CNC10 TAB FILE VERSION 3\nAXIS X\nUNITS MILLIMETER\nINTERVAL none\n"
MOMENT: Final = re.compile(
    r"(_ns|_us|_ms|_s|seconds|_at|since|until|time|timestamp|age|pid|uptime|digest|compiled|generation|boot|"
    r"version|bytes|cpu|rate|load|percent|worst|p\d+|histogram|latency|garbage|memory|heartbeat|number|max|"
    r"max_minute|computed|minute|budget_overruns|longest|published)$"
)
"""Keys whose values depend on the moment or on the machine."""
VARIES: Final = re.compile(
    r"seconds|bytes|time|memory|cpu|ratio|latency|process|python|garbage|age|loop|budget"
)
"""Names of metrics whose values do."""


class CommandsError(Exception):
    """The program does not come up as the script needs it."""


def script() -> Iterator[str]:
    """Yield what each step gave, one line each. Raises CommandsError."""
    with TemporaryDirectory(prefix="same-") as folder:
        desk = Desk(Path(folder))
        yield from desk.said("check --compile --json gateway.toml")
        with desk.running():
            yield from _steps(desk)
        yield from desk.logs()


def _steps(desk: "Desk") -> Iterator[str]:
    yield from desk.moves("at the start")
    for command in (
        "disable gateway.toml x --json",
        "enable gateway.toml x --json",
        "enable gateway.toml nobody --json",
        "enable gateway.toml y --json",
        "reference gateway.toml y --yes --json",
        "reference gateway.toml x --yes --json",
        "reload gateway.toml --json",
    ):
        yield from desk.said(command)
        yield from desk.moves(command)
    desk.changed(lambda: desk.write_table("X", "0.05"), *TAKEN)
    yield from desk.said("reload gateway.toml --json")
    yield from desk.moves("another table")
    desk.changed(lambda: (desk.folder / "tables" / "x.tab").write_text(BAD_TABLE), "table-rejected")
    yield from desk.said("reload gateway.toml --json")
    yield from desk.moves("a bad table is not taken")
    desk.changed(lambda: desk.write_table("X", "0.02"), "table-mended", *TAKEN)
    yield from desk.said("reload gateway.toml --json")
    for command, asked in (
        ("disable", {"axes": ["x"]}),
        ("enable", {"axes": ["x"]}),
        ("gain", {"axes": ["x"], "forward": 1.0, "backward": 0.5}),
        ("gain", {"axes": ["x"], "forward": 7}),
        ("gain", {"axes": "all", "forward": 1.0, "backward": 1.0}),
        ("disable", {"axes": ["nobody"]}),
        ("reload", {}),
        ("unknown", {}),
    ):
        yield from desk.commanded(command, asked)
        yield from desk.moves(f"after {command} {asked}")
    desk.settle()
    for path in ("/healthz", "/status", "/nothing", "/metrics"):
        yield from desk.fetched(path)
    yield from desk.said("status gateway.toml --json")
    yield from desk.retained()


class Desk:
    """A folder with a configuration, drives and a broker, and the program that runs there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "tables").mkdir()
        for axis in "XY":
            self.write_table(axis, "0.02")
        self._to_drives: list[str] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._serve, daemon=True).start()
        self._broker = Broker(folder)
        self._ports = {name: _free_port() for name in ("http", "cnc")}
        self._ports |= {"drives": self._server.getsockname()[1], "mqtt": self._broker.port}
        (folder / "gateway.toml").write_text(CONFIGURATION.format(**self._ports))
        self._controller: socket.socket | None = None
        self._client: Client | None = None
        self._events: list[dict[str, Any]] = []
        self._retained: dict[str, str] = {}
        self._said: dict[str, str] = {}
        self._number = 0
        self._target = 1000
        self._answered = 0
        """Requests of the controller that a drive has answered."""

    def changed(self, change: Callable[[], object], *events: str) -> None:
        """Change a table, and let the program find it of its own accord: a command would race with that.

        Returns when each of ``events`` has come: a late event of an earlier change does not count.
        """
        before = len(self._events)
        change()
        self._wait(
            lambda: {each["event"] for each in self._events[before:]}.issuperset(events),
            f"{' and '.join(events)}",
        )

    def write_table(self, axis: str, last: str) -> None:
        """Write the table of an axis."""
        (self.folder / "tables" / f"{axis.lower()}.tab").write_text(TABLE.format(axis=axis, last=last))

    @contextlib.contextmanager
    def running(self) -> Iterator[None]:
        """Run broker, relay and supervisor until the block ends."""
        self._broker.start()
        with contextlib.ExitStack() as exits:
            exits.callback(self._broker.stop)
            self._listen()
            assert self._client is not None
            exits.callback(self._client.loop_stop)
            for command in ("relay", "supervise"):
                out = exits.enter_context((self.folder / f"{command}.log").open("wb"))
                process = subprocess.Popen(
                    [sys.executable, "-P", "-c", PROGRAM, command, "gateway.toml", "--log-format", "json"],
                    cwd=self.folder, stdout=out, stderr=out,
                )  # fmt: skip
                exits.callback(_stopped, process)
            self._wait(lambda: b'"line-up"' in (self.folder / "relay.log").read_bytes(), "the line")
            self._wait(lambda: self._status_of("/healthz") == 200, "the page")
            self._wait(lambda: f"{TOPICS}/info" in self._retained, "MQTT")
            self._controller = exits.enter_context(
                socket.create_connection(("127.0.0.1", self._ports["cnc"]), timeout=PATIENCE_S)
            )
            yield

    def said(self, command: str) -> Iterator[str]:
        """Run a command of the program; yield what it printed."""
        done = subprocess.run(
            [sys.executable, "-P", "-c", PROGRAM, *command.split()],
            cwd=self.folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        yield f"$ {command}"
        yield from self._plain(done.stdout)
        yield from self._plain(done.stderr)
        yield f"exit code {done.returncode}"

    def printed(self, command: str) -> list[Any]:
        """Run a command of the program; return the JSON that it printed: whole, or line by line."""
        done = subprocess.run(
            [sys.executable, "-P", "-c", PROGRAM, *command.split()],
            cwd=self.folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if not done.stdout:
            raise CommandsError(f"{command}: {done.stderr}")
        return _documents(done.stdout)

    def text(self, path: str) -> str:
        """Return a document of the page."""
        with urllib.request.urlopen(self._url(path), timeout=PATIENCE_S) as reply:
            return str(reply.read().decode())

    def documents(self, path: str) -> list[Any]:
        """Return the JSON of a document of the page."""
        return _documents(self.text(path))

    def topics(self) -> dict[str, Any]:
        """Return what came by MQTT, by topic: the last one of each, and all events as a list."""
        said = {topic: _documents(text) for topic, text in [*self._said.items(), *self._retained.items()]}
        return {**said, f"{TOPICS}/event": list(self._events)}

    def moves(self, what: str) -> Iterator[str]:
        """Command each axis to a new target and read it back: replies, and what reached the drives."""
        yield f"moves: {what}"
        self._target += 7_000
        self._to_drives.clear()
        for unit_id in (1, 2):
            for pdu in (
                b"\x10\x00\x64\x00\x02\x04" + (self._target % 190_000).to_bytes(4, "big"),
                bytes.fromhex("03 00 64 00 02"),
                bytes.fromhex("03 00 c8 00 02"),
                bytes.fromhex("06 01 f4 00 2a"),
            ):
                yield f"{unit_id} {pdu.hex(' ')} = {self._asked(unit_id, pdu).hex(' ')}"
        yield from (f"to the drives {each}" for each in self._to_drives)

    def commanded(self, command: str, asked: dict[str, Any]) -> Iterator[str]:
        """Command something over MQTT; yield the event that answers it."""
        self._number += 1
        payload = json.dumps({**asked, "id": self._number})
        yield f"published {command} {payload}"
        assert self._client is not None
        self._client.publish(f"{TOPICS}/command/{command}", payload, qos=1)
        deadline = time.monotonic() + (PATIENCE_S if command != "unknown" else 1.0)
        while time.monotonic() < deadline:
            answers = [each for each in list(self._events) if each.get("id") == self._number]
            if answers:
                yield from self._plain(json.dumps(answers[0]))
                return
            time.sleep(0.02)
        yield "no answer"

    def retained(self) -> Iterator[str]:
        """Yield what stands at the broker, by topic."""
        for topic, text in sorted(self._retained.items()):
            yield topic
            yield from self._plain(text)

    def _listen(self) -> None:
        client = self._client = Client(CallbackAPIVersion.VERSION2)

        def came(_client: Client, _data: object, message: MQTTMessage) -> None:
            text = message.payload.decode()
            if message.topic == f"{TOPICS}/event":
                self._events.append(json.loads(text))
            elif "/axis/" not in message.topic.removesuffix("/table") and "/line/" not in message.topic:
                self._retained[message.topic] = text
            else:
                self._said[message.topic] = text

        client.on_message = came
        client.connect("127.0.0.1", self._ports["mqtt"])
        client.subscribe("#", qos=1)
        client.loop_start()

    def settle(self) -> None:
        """Wait until the supervisor has looked at the relay after the last request."""
        self._wait(self._has_seen_all, "a metric that says how many requests were answered")

    def _has_seen_all(self) -> bool:
        found = re.search(
            r"^pitch_gateway_line_exchanges_total\{.*\} (\d+)", self.text("/metrics"), re.MULTILINE
        )
        return found is not None and int(found[1]) >= self._answered

    def fetched(self, path: str) -> Iterator[str]:
        """Fetch a document of the page."""
        yield f"GET {path}"
        try:
            with urllib.request.urlopen(self._url(path), timeout=PATIENCE_S) as reply:
                yield str(reply.status)
                text = reply.read().decode()
        except urllib.error.HTTPError as error:
            yield str(error.code)
            text = error.read().decode()
        yield from (_metrics(text) if path == "/metrics" else self._plain(text))

    def logs(self) -> Iterator[str]:
        """Yield what both processes have logged."""
        for name in ("relay", "supervise"):
            for line in (self.folder / f"{name}.log").read_text().splitlines():
                yield from (f"{name} {each}" for each in self._plain(line))

    def _plain(self, text: str) -> Iterator[str]:
        with contextlib.suppress(json.JSONDecodeError):
            text = json.dumps(_steady(json.loads(text)), sort_keys=True, indent=1)
        for name, port in self._ports.items():
            text = text.replace(f":{port}", f":<{name}>")
        yield from re.sub(
            r"127\.0\.0\.1:\d+", "127.0.0.1:*", text.replace(str(self.folder), "DESK")
        ).splitlines()

    def _url(self, path: str) -> str:
        return f"http://127.0.0.1:{self._ports['http']}{path}"

    def _status_of(self, path: str) -> int:
        with (
            contextlib.suppress(OSError),
            urllib.request.urlopen(self._url(path), timeout=PATIENCE_S) as reply,
        ):
            return int(reply.status)
        return 0

    @staticmethod
    def _wait(happened: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not happened():
            if time.monotonic() > deadline:
                raise CommandsError(f"{what} did not come up within {PATIENCE_S:g} s")
            time.sleep(0.02)

    def _asked(self, unit_id: int, pdu: bytes) -> bytes:
        assert self._controller is not None
        head = b"\x00\x01\x00\x00" + (len(pdu) + 1).to_bytes(2, "big") + bytes((unit_id,))
        self._controller.sendall(head + pdu)
        reply = self._controller.recv(260)[7:]
        self._answered += 1
        return reply

    def _serve(self) -> None:
        while True:
            connection, _ = self._server.accept()
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        memories: dict[tuple[int, int], bytes] = {}
        with contextlib.suppress(OSError), connection:
            stream = connection.makefile("rb")
            while head := stream.read(7):
                pdu, unit_id = stream.read(int.from_bytes(head[4:6], "big") - 1), head[6]
                self._to_drives.append(f"{unit_id} {pdu.hex(' ')}")
                reply = _reply(memories, unit_id, pdu)
                connection.sendall(head[:4] + (len(reply) + 1).to_bytes(2, "big") + head[6:7] + reply)


def _reply(memories: dict[tuple[int, int], bytes], unit_id: int, pdu: bytes) -> bytes:
    """Answer as a drive that is where it was sent to at once."""
    address = int.from_bytes(pdu[1:3], "big")
    if pdu[0] == 0x10:
        words: Sequence[bytes] = [pdu[i : i + 2] for i in range(6, len(pdu), 2)]
        for offset, word in enumerate(words):
            memories[unit_id, address + offset] = memories[unit_id, address + offset + 100] = word
        return pdu[:5]
    if pdu[0] == 0x06:
        memories[unit_id, address] = pdu[3:5]
        return pdu
    quantity = int.from_bytes(pdu[3:5], "big")
    data = b"".join(memories.get((unit_id, address + i), b"\x00\x00") for i in range(quantity))
    return bytes((pdu[0], len(data))) + data


def _steady(value: Any, key: str = "") -> Any:
    if MOMENT.search(key) and not isinstance(value, bool | None):
        return dict.fromkeys(value, "*") if isinstance(value, dict) else "*"
    if isinstance(value, dict):
        return {name: _steady(each, name) for name, each in value.items()}
    return [_steady(each) for each in value] if isinstance(value, list) else value


def _documents(text: str) -> list[Any]:
    try:
        return [json.loads(text)]
    except json.JSONDecodeError:
        return [json.loads(line) if line[:1] in "{[" else line for line in text.splitlines()]


def _metrics(text: str) -> Iterator[str]:
    for line in text.splitlines():
        name, _, _ = line.rpartition(" ")
        yield line if line.startswith("#") or not VARIES.search(name) else f"{name} *"


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
        return port


def _stopped(process: "subprocess.Popen[bytes]") -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
    try:
        process.wait(PATIENCE_S)
    except subprocess.TimeoutExpired:
        process.kill()


if __name__ == "__main__":
    os.environ.setdefault("PYTHONHASHSEED", "0")
    sys.stdout.writelines(line + "\n" for line in script())
