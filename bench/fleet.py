"""Many whole gateways, one broker, one Prometheus: ``python -m bench.fleet --gateways 200 --write``.

Each gateway is a real relay and a real supervisor, as the systemd units start them, with one line of three
axes. Its controller asks ten times a second. Broker and Prometheus are mosquitto and Prometheus themselves,
the latter with the rules of ``deploy/monitoring``. It measures by default, then tuned, then a broker that is
killed and comes back. ``--write`` makes ``fleet.md``; else the text is printed.
"""

import argparse
import contextlib
import json
import os
import re
import shutil
import signal
import socket
import sys
import threading
import time
import urllib.parse
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from paho.mqtt.client import Client, MQTTMessage
from paho.mqtt.enums import CallbackAPIVersion

from bench import machine
from bench.candidates import free_port
from bench.errors import BenchError
from bench.fleet_plant import AXES
from bench.gateway_setup import Controller, GatewaySetup, LineSetup, config_text, write_setup
from bench.places import BENCH, BUILD, ROOT
from bench.processes import Process, Processes, cpu_ns, line_from, resident_bytes, stop_on_signals
from gateway.cli.processes import command_of
from gateway.config.compile import compile_into_state
from gateway.config.load import load
from gateway.ipc.log import LogFormat

FOLDER: Final = BUILD / "fleet"
RESULT: Final = BENCH / "fleet.md"
MONITORING: Final = ROOT / "deploy" / "monitoring"
FIRST_CONTROLLER_PORT, FIRST_PAGE_PORT = 21_000, 23_000
PER_S: Final = 10
AT_ONCE: Final = 8
"""Gateways that start at the same time."""
PATIENCE_S: Final = 300.0
SETTLE_S: Final = 15.0
"""After the start of all, and after a change, before anything is counted."""
DOWN_S: Final = (1.0, 10.0)
"""How long the broker is away, each time."""
LISTEN_S: Final = 10.0
"""How long every message is read, for its topic and size."""
MIB: Final = 2**20
GIB_A_GATEWAY: Final = 0.08
"""Memory that a gateway may take, for the check before the start."""
PLANT, FLEET = 200, 10_000
"""The sizes that the text computes."""
ONLINE: Final = "pitch-gateway/+/availability"


@dataclass(frozen=True, slots=True)
class Tuning:
    """Settings of the gateways and of Prometheus."""

    title: str
    interval_s: float
    keepalive_s: int
    scrape_s: int

    @property
    def keys(self) -> str:
        """The keys of ``[mqtt]``."""
        return f"interval_s = {self.interval_s}\nkeepalive_s = {self.keepalive_s}\n"


DEFAULT: Final = Tuning("by default", 0.5, 15, 5)
TUNED: Final = Tuning("tuned", 10.0, 60, 30)


@dataclass(slots=True)
class Machine:
    """One gateway of the fleet."""

    setup: GatewaySetup
    config: Path
    page_port: int
    relay: Process | None = None
    supervisor: Process | None = None


@dataclass(frozen=True, slots=True)
class Figures:
    """What was measured with one tuning; rates are a second, for the whole fleet."""

    tuning: Tuning
    gateways: int
    messages: float
    payload_bytes: float
    bytes: float
    topics: Sequence[tuple[str, float, float]]
    """Kind of topic, messages a second, and bytes of payload of one."""
    cores: dict[str, float]
    """Processor time a second, by program."""
    memory: dict[str, float]
    """Bytes, by program: proportional (PSS), so that shared pages count once."""
    up: int
    series: int
    samples: float
    page_bytes: float
    page_s: float
    machines: dict[str, float]


class Witness:
    """A client of the broker: its own counters, who is online, and every message for a while."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._lock = threading.Lock()
        self.counters: dict[str, float] = {}
        self.online: dict[str, float] = {}
        """When each gateway was first said to be online, by the monotonic clock in seconds."""
        self.kinds: Counter[str] = Counter()
        self.sizes: Counter[str] = Counter()
        self._client = self._connected()

    def _connected(self) -> Client:
        client = Client(CallbackAPIVersion.VERSION2, client_id="bench", reconnect_on_failure=False)
        client.on_message = self._take
        client.connect("127.0.0.1", self._port, 60)
        client.subscribe([("$SYS/broker/#", 0), (ONLINE, 1)])
        client.loop_start()
        return client

    def again(self) -> None:
        """Connect to a broker that has just come back, before the gateways do."""
        self._client.loop_stop()
        self.online = {}
        self._client = self._connected()

    def listen(self, seconds: float) -> None:
        """Count every message of the gateways."""
        self._client.subscribe("pitch-gateway/#", 0)
        time.sleep(2.0)  # what is retained comes first
        with self._lock:
            self.kinds.clear()
            self.sizes.clear()
        time.sleep(seconds)
        self._client.unsubscribe("pitch-gateway/#")

    def counter(self, name: str) -> float:
        """Return a counter of mosquitto, as it last told."""
        return self.counters.get(f"$SYS/broker/{name}", 0.0)

    def _take(self, _client: Client, _data: object, message: MQTTMessage) -> None:
        if message.topic.startswith("$SYS"):
            with contextlib.suppress(ValueError):
                self.counters[message.topic] = float(message.payload)
            return
        _, name, *rest = message.topic.split("/")
        if rest == ["availability"] and message.payload == b"online":
            self.online.setdefault(name, time.monotonic())
        with self._lock:
            kind = kind_of(rest)
            self.kinds[kind] += 1
            self.sizes[kind] += len(message.payload)


def kind_of(rest: Sequence[str]) -> str:
    """Return a topic of a gateway without its names.

    >>> kind_of(["axis", "a1-1", "table"]), kind_of(["info"])
    ('axis/AXIS/table', 'info')
    """
    return "/".join([rest[0], *(rest[0].upper() for _ in rest[1:2]), *rest[2:]])


class Fleet:
    """All that runs."""

    def __init__(self, processes: Processes, count: int, say: Callable[[str], None]) -> None:
        self._processes = processes
        self._say = say
        self.count = count
        self.broker_port, self.prometheus_port, drives_port = free_port(), free_port(), free_port()
        shutil.rmtree(FOLDER, ignore_errors=True)
        FOLDER.mkdir(parents=True)
        words = [drives_port, FIRST_CONTROLLER_PORT, count, PER_S]
        command = [sys.executable, "-m", "bench.fleet_plant", *map(str, words)]
        self.plant = processes.start("fleet-plant", command, is_talking=True)
        line_from(self.plant)
        self.start_broker()
        self.witness = Witness(self.broker_port)
        self.machines = [self._made(number, drives_port) for number in range(count)]
        self.prometheus = self._start_prometheus()
        self._start_gateways()

    def start_broker(self) -> None:
        """Start the broker, and wait until it listens."""
        config = FOLDER / "mosquitto.conf"
        user = "user root\n" if os.geteuid() == 0 else ""
        config.write_text(
            f"{user}listener {self.broker_port} 127.0.0.1\nallow_anonymous true\nsys_interval 1\n"
        )
        program = shutil.which("mosquitto", path=f"{os.environ['PATH']}:/usr/sbin") or ""
        self.broker = self._processes.start("fleet-broker", [program, "-c", config])
        self.until("the broker", lambda: is_open(self.broker_port), 0.01)

    def tune(self, tuning: Tuning) -> None:
        """Change settings while all runs, as an engineer would."""
        self._write_prometheus(tuning)
        self.prometheus.send_signal(signal.SIGHUP)
        for each in self.machines:
            each.config.write_text(config_text(replace(each.setup, mqtt=tuning.keys)))
            assert each.supervisor is not None, "it was started"
            each.supervisor.send_signal(signal.SIGHUP)

    def measure(self, tuning: Tuning, seconds: float) -> Figures:
        """Measure for so long, and listen a while after it."""
        self._say(f"{tuning.title}: measures {seconds:.0f} s")
        self._asked()
        began_s, before, cores = time.monotonic(), self._counts(), self._cores()
        time.sleep(seconds)
        counts, after = self._counts(), self._cores()
        took_s = time.monotonic() - began_s
        machines, memory = self._asked(), self._memory()
        machines["exchanges_per_s"] = machines["exchanges"] / took_s
        each = {name: (after[name] - cores[name]) / took_s / 1e9 for name in cores}
        messages, payload, all_bytes = (
            (now - then) / took_s for now, then in zip(counts, before, strict=True)
        )
        self.witness.listen(LISTEN_S)
        kinds, sizes = self.witness.kinds.copy(), self.witness.sizes.copy()
        return Figures(
            tuning,
            self.count,
            messages,
            payload,
            all_bytes,
            topics=[
                (kind, count / LISTEN_S, sizes[kind] / count)
                for kind, count in sorted(kinds.items())
                if count
            ],
            cores=each,
            memory=memory,
            up=int(self._asked_prometheus('sum(up{job="pitch-gateway"})')),
            series=self._series(),
            samples=self._asked_prometheus('sum(scrape_samples_scraped{job="pitch-gateway"})')
            / tuning.scrape_s,
            page_bytes=self._asked_prometheus('avg(scrape_body_size_bytes{job="pitch-gateway"})'),
            page_s=self._asked_prometheus('avg(scrape_duration_seconds{job="pitch-gateway"})'),
            machines=machines,
        )

    def restart_broker(self, down_s: float) -> list[float]:
        """Kill the broker and start it again; return when each gateway was online, in seconds after it."""
        self._say(f"the broker is killed, and away for {down_s:.0f} s")
        self.broker.kill()
        self.broker.wait()
        time.sleep(down_s)
        self.start_broker()
        began_s = time.monotonic()
        self.witness.again()
        self.until("all gateways to be back", lambda: len(self.witness.online) >= self.count, 0.1)
        return sorted(at - began_s for at in self.witness.online.values())

    def until(self, what: str, is_so: Callable[[], bool], look_s: float) -> None:
        """Wait.

        Raises:
            BenchError: it takes too long.
        """
        end = time.monotonic() + PATIENCE_S
        while not is_so():
            if time.monotonic() > end:
                raise BenchError(f"waited {PATIENCE_S:.0f} s for {what} (see {self._processes.logs})")
            time.sleep(look_s)

    def _made(self, number: int, drives_port: int) -> Machine:
        line = LineSetup(
            (Controller(tcp_port=FIRST_CONTROLLER_PORT + number),), drive_port=drives_port, axes=AXES
        )
        page = FIRST_PAGE_PORT + number
        name = f"mill-{number + 1:04}"
        setup = GatewaySetup((line,), http_port=page, mqtt_port=self.broker_port, name=name)
        config = write_setup(FOLDER / name, setup)
        loaded = load(config)
        compile_into_state(loaded)
        return Machine(setup, config, page)

    def _start_gateways(self) -> None:
        for first in range(0, self.count, AT_ONCE):
            some = self.machines[first : first + AT_ONCE]
            for each in some:
                name, config = each.setup.name, each.config
                relay = command_of("gateway.relay", config, LogFormat.JSON)
                supervisor = command_of("gateway.supervisor", config, LogFormat.JSON, "--events", "no")
                each.relay = self._processes.start(f"fleet-{name}-relay", relay)
                each.supervisor = self._processes.start(f"fleet-{name}-supervisor", supervisor)
            self.until("pages", partial(are_served, some), 0.2)
            self._say(f"{first + len(some)} of {self.count} gateways run")
        self.until("all to be online", lambda: len(self.witness.online) >= self.count, 0.2)

    def _start_prometheus(self) -> Process:
        self._write_prometheus(DEFAULT)
        words = [
            "prometheus",
            f"--config.file={FOLDER / 'prometheus.yml'}",
            f"--storage.tsdb.path={FOLDER / 'tsdb'}",
            f"--web.listen-address=127.0.0.1:{self.prometheus_port}",
            "--enable-feature=extra-scrape-metrics",
        ]
        return self._processes.start("fleet-prometheus", words)

    def _write_prometheus(self, tuning: Tuning) -> None:
        targets = [f"127.0.0.1:{each.page_port}" for each in self.machines]
        text = {
            "global": {
                "scrape_interval": f"{tuning.scrape_s}s",
                "evaluation_interval": f"{tuning.scrape_s}s",
            },
            "rule_files": [str(MONITORING / name) for name in ("records.yml", "alerts.yml")],
            "scrape_configs": [{"job_name": "pitch-gateway", "static_configs": [{"targets": targets}]}],
        }
        (FOLDER / "prometheus.yml").write_text(json.dumps(text, indent=1))  # JSON is YAML

    def _counts(self) -> tuple[float, float, float]:
        names = ("publish/messages/received", "publish/bytes/received", "bytes/received")
        messages, payload, all_bytes = map(self.witness.counter, names)
        return messages, payload, all_bytes

    def _pids(self) -> Iterator[tuple[str, int]]:
        for each in self.machines:
            assert each.relay is not None, "it was started"
            assert each.supervisor is not None, "it was started"
            yield "relays", each.relay.pid
            yield "supervisors", each.supervisor.pid
        yield "broker", self.broker.pid
        yield "Prometheus", self.prometheus.pid
        yield "drives and controllers", self.plant.pid

    def _cores(self) -> dict[str, int]:
        found: Counter[str] = Counter()
        for name, pid in self._pids():
            found[name] += cpu_ns(pid)
        return dict(found)

    def _memory(self) -> dict[str, float]:
        found: dict[str, float] = {}
        for name, pid in self._pids():
            found[name] = found.get(name, 0.0) + pss_bytes(pid)
        return found

    def _asked(self) -> dict[str, float]:
        self.plant.send_signal(signal.SIGUSR1)
        figures: dict[str, float] = json.loads(line_from(self.plant))
        return figures

    def _asked_prometheus(self, query: str) -> float:
        found = self._api(f"query?{urllib.parse.urlencode({'query': query})}")["result"]
        return float(found[0]["value"][1]) if found else 0.0

    def _series(self) -> int:
        return int(self._api("status/tsdb")["headStats"]["numSeries"])

    def _api(self, path: str) -> Any:
        url = f"http://127.0.0.1:{self.prometheus_port}/api/v1/{path}"
        with urllib.request.urlopen(url, timeout=60.0) as answer:
            return json.load(answer)["data"]


def is_open(port: int) -> bool:
    """Whether somebody listens at a port."""
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1.0):
        return True
    return False


def are_served(machines: Sequence[Machine]) -> bool:
    """Whether all of them serve their page.

    Raises:
        BenchError: a process has ended.
    """
    for each in machines:
        for what, process in (("relay", each.relay), ("supervisor", each.supervisor)):
            if process is not None and process.poll() is not None:
                raise BenchError(f"the {what} of {each.setup.name} has ended: its log is in {BUILD / 'logs'}")
    return all(is_open(each.page_port) for each in machines)


def pss_bytes(pid: int) -> float:
    """Return the memory of a process; pages that it shares count by its share."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return float(line.split()[1]) * 1024
    return float(resident_bytes(pid))


# --- The text


INTRODUCTION: Final = (
    f"`python -m bench.fleet --write`. Each gateway is a relay and a supervisor, one line, {AXES} axes, "
    f"{PER_S} exchanges a second. All run on one machine; in a plant each gateway has its own."
)
ON_TUNED: Final = (
    f"*Tuned* is `interval_s = {TUNED.interval_s:.0f}` and `keepalive_s = {TUNED.keepalive_s}` in `[mqtt]`, "
    f"and {TUNED.scrape_s} s for `scrape_interval` and `evaluation_interval`. Events, alarms, tables and the "
    "journal come as they happen with both."
)
ON_RESTARTS: Final = (
    "It was killed, and came back with nothing retained. Seconds from then until a gateway was online again:"
)
ON_SPREAD: Final = (
    "Each pause is drawn from its upper half: 0.5 to 1 s, 1 to 2 s, and so on up to 30 to 60 s. The longer a "
    "broker is away, the wider its clients are spread."
)


def text(found: Sequence[Figures], back_s: Mapping[float, Sequence[float]], facts: machine.Facts) -> str:
    """Return fleet.md."""
    count = found[0].gateways
    default, tuned = found
    lines = [
        "# A fleet: many gateways, one broker, one Prometheus",
        "",
        INTRODUCTION,
        "",
        *(f"- {name}: {value}" for name, value in facts),
        "",
        f"## {count} gateways, measured",
        "",
        *_rows(found),
        "",
        "By topic, a second:",
        "",
        "| topic | " + " | ".join(f"{each.tuning.title}: messages | bytes of one" for each in found) + " |",
        "|---|" + "---:|---:|" * len(found),
        *_topic_rows(found),
        "",
        ON_TUNED,
        "",
        "## A broker that comes back",
        "",
        ON_RESTARTS,
        "",
        *_back_rows(back_s),
        "",
        ON_SPREAD,
        "",
        *_paper(default, tuned),
        "",
    ]
    return "\n".join(lines)


def _rows(found: Sequence[Figures]) -> Iterator[str]:
    yield "| | " + " | ".join(each.tuning.title for each in found) + " |"
    yield "|---|" + "---:|" * len(found)
    rows: list[tuple[str, Callable[[Figures], str]]] = [
        ("messages to the broker a second", lambda one: f"{one.messages:.1f}"),
        ("… of one gateway", lambda one: f"{one.messages / one.gateways:.2f}"),
        ("bytes to the broker a second, with MQTT's own", lambda one: f"{one.bytes:,.0f}"),
        ("… of one gateway", lambda one: f"{one.bytes / one.gateways:,.0f}"),
        ("targets that Prometheus reaches", lambda one: f"{one.up}"),
        ("series in Prometheus", lambda one: f"{one.series:,}"),
        ("samples a second", lambda one: f"{one.samples:,.0f}"),
        ("one page `/metrics`, bytes", lambda one: f"{one.page_bytes:,.0f}"),
        ("… seconds", lambda one: f"{one.page_s:.3f}"),
        ("exchanges a second", lambda one: f"{one.machines['exchanges_per_s']:.1f}"),
        ("round trip of a controller, median ms", lambda one: f"{one.machines['p50_ms']:.2f}"),
        ("… p99 ms", lambda one: f"{one.machines['p99_ms']:.2f}"),
        ("turns without a reply in time; refused", _failures),
    ]
    rows += [(f"{name}: cores", partial(_cores, name)) for name in found[0].cores]
    rows += [(f"one of the {name}: MiB", partial(_mib_of_one, name)) for name in ("relays", "supervisors")]
    rows += [(f"{name}: MiB", partial(_mib, name)) for name in ("broker", "Prometheus")]
    for what, show in rows:
        yield f"| {what} | " + " | ".join(map(show, found)) + " |"


def _failures(one: Figures) -> str:
    return f"{one.machines['late']:.0f}; {one.machines['refused']:.0f}"


def _cores(name: str, one: Figures) -> str:
    return f"{one.cores[name]:.3f}"


def _mib(name: str, one: Figures) -> str:
    return f"{one.memory[name] / MIB:.1f}"


def _mib_of_one(name: str, one: Figures) -> str:
    return f"{one.memory[name] / one.gateways / MIB:.1f}"


def _topic_rows(found: Sequence[Figures]) -> Iterator[str]:
    by_kind = [{kind: (rate, size) for kind, rate, size in each.topics} for each in found]
    for kind in sorted(set().union(*by_kind)):
        cells = [
            f"{each[kind][0]:.1f} | {each[kind][1]:.0f}" if kind in each else "0 | –" for each in by_kind
        ]
        yield f"| `{kind}` | " + " | ".join(cells) + " |"


def _back_rows(back_s: Mapping[float, Sequence[float]]) -> Iterator[str]:
    yield "| away | first | median | 99 % | last | most within 0.1 s |"
    yield "|---:|---:|---:|---:|---:|---:|"
    for down_s, found in back_s.items():
        tenths = Counter(int(at * 10) for at in found)
        marks = [down_s, found[0], found[len(found) // 2], found[len(found) * 99 // 100], found[-1]]
        shown = " | ".join(f"{at:.1f} s" for at in marks)
        yield f"| {shown} | {max(tenths.values())} of {len(found)} |"


def _paper(default: Figures, tuned: Figures) -> Iterator[str]:
    if default.gateways < PLANT:
        yield f"## {PLANT} gateways, by arithmetic"
        yield ""
        yield from _scaled(default, tuned, PLANT)
        yield ""
    yield f"## {FLEET:,} gateways, by arithmetic"
    yield ""
    yield from _scaled(default, tuned, FLEET)
    retained = 3 + AXES
    yield ""
    yield (
        "This is arithmetic, not a measurement. One broker on one machine does not carry it by default; a "
        "cluster of brokers with the settings *tuned* has room."
    )
    yield ""
    yield "| what | setting |"
    yield "|---|---|"
    yield "| rate of messages | `interval_s = 10` or more, as the readers need it; `keepalive_s = 60` |"
    yield (
        "| topics | one `base_topic` for each plant, so that rights and bridges can name it. On the whole "
        "broker each gateway has a `name` of its own: its client id is `pitch-gateway-NAME` |"
    )
    yield (
        "| readers | for a fleet read `BASE/+/availability`, `BASE/+/info`, `BASE/+/event` and "
        "`BASE/+/journal`. Read `axis/…` and `line/…` of one machine while somebody looks at it |"
    )
    yield (
        f"| retained messages | {retained} of each gateway with {AXES} axes: {FLEET * retained:,} in all. "
        "Keep `discovery` off: it makes devices for one house |"
    )
    yield (
        "| a broker that returns | limit new connections of each node (in EMQX `max_conn_rate`). A gateway "
        "that is refused waits up to 60 s. Events wait meanwhile, 256 of each gateway |"
    )
    yield (
        "| events to a database | several readers with a shared subscription, "
        "`$share/GROUP/BASE/+/event`; a number may come twice |"
    )
    yield (
        "| Prometheus | several, each with a part of the targets (`hashmod` in `relabel_configs`), "
        "`scrape_interval: 30s`; above them one that reads only the results of `records.yml` |"
    )


def _scaled(default: Figures, tuned: Figures, count: int) -> Iterator[str]:
    yield "| | by default | tuned |"
    yield "|---|---:|---:|"
    both = (default, tuned)

    def row(what: str, value: Callable[[Figures], float], form: str) -> str:
        cells = (format(value(one) / one.gateways * count, form) for one in both)
        return f"| {what} | " + " | ".join(cells) + " |"

    yield row("messages a second", lambda one: one.messages, ",.0f")
    yield row("MB a second", lambda one: one.bytes / 1e6, ",.2f")
    yield row("series", lambda one: one.series, ",.0f")
    yield row("samples a second", lambda one: one.samples, ",.0f")
    yield row("cores of the broker", lambda one: one.cores["broker"], ",.2f")
    yield row("cores of Prometheus", lambda one: one.cores["Prometheus"], ",.2f")
    yield row("cores of the gateways", lambda one: one.cores["relays"] + one.cores["supervisors"], ",.1f")
    memory = (one.memory["relays"] + one.memory["supervisors"] for one in both)
    cells = (f"{size / one.gateways * count / 2**30:,.1f}" for size, one in zip(memory, both, strict=True))
    yield "| GiB of the gateways | " + " | ".join(cells) + " |"


# --- The command line


def main() -> int:
    """Run. Exit codes: 0 measured, 1 something could not be, 2 wrong usage, 130 Ctrl-C."""
    options = _options()
    stop_on_signals()
    disturbance = machine.Disturbance()

    def say(what: str) -> None:
        sys.stderr.write(f"{time.strftime('%H:%M:%S')} {what}\n")

    try:
        for program in ("mosquitto", "prometheus"):
            if shutil.which(program, path=f"{os.environ['PATH']}:/usr/sbin") is None:
                raise BenchError(f"{program} is not installed: apt-get install {program}")
        with Processes(BUILD / "logs" / "fleet") as processes:
            fleet = Fleet(processes, options.gateways, say)
            time.sleep(SETTLE_S)
            found = [fleet.measure(DEFAULT, options.seconds)]
            fleet.tune(TUNED)
            time.sleep(SETTLE_S + TUNED.scrape_s)
            found.append(fleet.measure(TUNED, options.seconds))
            back_s = {}
            for down_s in DOWN_S:
                back_s[down_s] = fleet.restart_broker(down_s)
                time.sleep(SETTLE_S)
    except BenchError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except KeyboardInterrupt:
        return 130
    written = text(
        found, back_s, machine.machine() + machine.how_and_when("bench.fleet") + disturbance.facts()
    )
    if options.write:
        RESULT.write_text(written)
        say(f"written: {RESULT}")
    else:
        sys.stdout.write(written)
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m bench.fleet", description=(__doc__ or "").split("\n\n")[0]
    )
    parser.add_argument("--gateways", type=int, default=PLANT, help="how many; default: %(default)s")
    parser.add_argument(
        "--seconds", type=float, default=60.0, help="of each measurement; default: %(default)s"
    )
    parser.add_argument("--write", action="store_true", help=f"write {RESULT.relative_to(ROOT)}")
    options = parser.parse_args()
    found = re.search(r"^MemAvailable: +(\d+) kB", Path("/proc/meminfo").read_text(), re.MULTILINE)
    free_gib = int(found[1]) / 2**20 if found else 0.0
    if not 1 <= options.gateways <= 2000:
        parser.error("--gateways: 1 to 2000")
    if options.gateways * GIB_A_GATEWAY > free_gib:
        most = int(free_gib / GIB_A_GATEWAY)
        parser.error(
            f"--gateways {options.gateways}: {free_gib:.1f} GiB of memory are free, enough for {most}"
        )
    if options.seconds < 2 * DEFAULT.scrape_s:
        parser.error(f"--seconds: {2 * DEFAULT.scrape_s} or more, two looks of Prometheus")
    return options


if __name__ == "__main__":
    sys.exit(main())
