"""What was recorded over real sockets and ports comes out the same again, byte for byte."""

import asyncio
import base64
import contextlib
import random
from dataclasses import replace
from pathlib import Path
from typing import Final

import msgspec
import pytest

from gateway.compensation.settings import ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, MotionPlan, Operation, TriggerPlan
from gateway.exchange.commands import (
    ClearTable,
    Command,
    Disable,
    Enable,
    EndDryRun,
    SetGain,
    SetLimits,
    SetReference,
    SetTable,
    SetTemperature,
    TableFor,
)
from gateway.exchange.control import ControlError
from gateway.exchange.plan import AxisPlan, ControllerPlan, CrossPlan, OtherUnits, Reference
from gateway.exchange.rights import Rights
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import BitField
from gateway.modbus.rtu import encode_rtu
from gateway.recording import traffic
from gateway.recording.replay import Replay, ReplayError
from gateway.recording.traffic import Answered, End, Entry, Header, Sent, Tick
from gateway.recording.writer import Recorder
from gateway.relay.gateway import Relay
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.state.tables import compiled
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.support.commands import typed
from tests.support.config import axis, gateway_toml, line
from tests.support.recordings import HEADER, entries_of, replayed
from tests.support.relay import QUICK, TIMING, Bench, RawEnd, axis_plan, eventually, line_status, until_up

ROUNDS = 120
FLAT = make_table([0.0, 100.0], [0.0, 0.0], [0.0, 0.0], Units.MM)


BEFORE: Final[dict[str, Command]] = {
    '{"kind":"control","line":"line","t":7,"command":"enable","axis":"x"}': Enable(axes=("x",)),
    '{"kind":"control","line":"line","t":7,"command":"disable","axis":"x"}': Disable(axes=("x",)),
    '{"kind":"control","line":"line","t":7,"command":"end-dry-run","axis":"x"}': EndDryRun(axes=("x",)),
    '{"kind":"control","line":"line","t":7,"command":"reference","axis":"x"}': SetReference(axis="x"),
    '{"kind":"control","line":"line","t":7,"command":"clear-table","axis":"x"}': ClearTable(axes=("x",)),
    '{"kind":"gain","line":"line","t":7,"axis":"x","forward":0.5,"backward":0.25}': SetGain(
        axes=("x",), forward=0.5, backward=0.25
    ),
    '{"kind":"gain","line":"line","t":7,"axis":"x","forward":0.5,"backward":0.25,"is_alone":true}': SetGain(
        axes=("x",), forward=0.5, backward=0.25, is_configured=True
    ),
    '{"kind":"limits","line":"line","t":7,"axis":"x","max_correction":0.5,"max_slope":0.1,'
    '"travel_margin":2.0,"budget_us":150.0}': SetLimits(
        axis="x", max_correction=0.5, max_slope=0.1, travel_margin=2.0, budget_us=150.0
    ),
    '{"kind":"temperature","line":"line","t":7,"axis":"x","celsius":21.5}': SetTemperature(
        axis="x", celsius=21.5
    ),
}
"""Commands as 1.0.0 recorded them."""
FOR_X: Final = SetTable(tables=(TableFor("x", "x.tab", "centroid-3", "0" * 64),))


@pytest.mark.parametrize("command", [*BEFORE.values(), FOR_X], ids=str)
def test_a_command_is_recorded_so_that_it_can_be_given_again(command: Command) -> None:
    entry = traffic.Commanded("line", 7, command, (compiled(FLAT),) if command is FOR_X else ())
    assert traffic.decode(traffic.encode(entry)) == entry


@pytest.mark.parametrize("recorded", BEFORE)
def test_a_command_that_an_older_release_recorded_is_the_same(recorded: str) -> None:
    assert traffic.decode(recorded.encode()) == traffic.Commanded("line", 7, BEFORE[recorded])


def test_tables_that_an_older_release_recorded_are_the_same() -> None:
    data = compiled(FLAT)
    text = base64.b64encode(data).decode()
    each = f'{{"axis":"x","file":"x.tab","format":"centroid-3","sha256":"{"0" * 64}","data":"{text}"}}'
    entry = traffic.decode(f'{{"kind":"tables","line":"line","t":7,"tables":[{each}]}}'.encode())
    assert entry == traffic.Commanded("line", 7, FOR_X, (data,))


def test_a_command_of_a_newer_release_is_refused_with_its_name() -> None:
    with pytest.raises(traffic.WrongEntryError, match=r"the command 'dance' is unknown; replay it with a"):
        traffic.decode(b'{"kind":"control","line":"line","t":7,"command":"dance","axis":"x"}')


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('"command","t":7,"command":{"kind":"enable","axes":[]}', "enable names 0 axes"),
        ('"command","t":7,"command":{"kind":"disable","axes":["x","y"]}', "disable names 2 axes"),
        (
            f'"command","t":7,"command":{msgspec.json.encode(FOR_X).decode()}',
            "set-table names 1 tables and holds 0",
        ),
        ('"reply","t":7,"unit":1,"pdu":"0304zz"', "pdu"),
        ('"sent","unit":1,"pdu":"030"', "pdu"),
    ],
)
def test_what_no_relay_records_is_no_entry(entry: str, said: str) -> None:
    with pytest.raises(traffic.WrongEntryError, match=f"^not an entry of a recording: .*{said}"):
        traffic.decode(f'{{"line":"line","kind":{entry}}}'.encode())


class MoodyDrive:
    """Answers most requests rightly, some with an exception, late, twice, with garbage, or not at all."""

    def __init__(self, kind: str, seed: int) -> None:
        self.kind = kind
        self.random = random.Random(seed)
        self.end: RawEnd | None = None

    def __call__(self, data: bytes) -> bytes | None:
        pdu = data[7:] if self.kind == "tcp" else data[1:-2]
        mood = self.random.random()
        if mood < 0.04:
            return None
        if mood < 0.07 and self.end is not None and self.end.channel is not None:
            self.end.channel.close()
            return None
        reply = self._framed(data, self._answer(pdu) if mood > 0.15 else bytes((pdu[0] | 0x80, 2)))
        if mood > 0.97:
            return reply + reply
        return b"\x55\xaa\x01" if mood > 0.95 and self.kind == "rtu" else reply

    def _answer(self, pdu: bytes) -> bytes:
        if pdu[0] in (3, 4) and len(pdu) < 5:
            return bytes((pdu[0] | 0x80, 3))
        if pdu[0] in (3, 4):
            quantity = pdu[4]
            return bytes((pdu[0], 2 * quantity)) + self.random.randbytes(2 * quantity)
        return pdu[:5]

    def _framed(self, data: bytes, pdu: bytes) -> bytes:
        if self.kind == "rtu":
            return encode_rtu(data[0], pdu)
        return data[:4] + (len(pdu) + 1).to_bytes(2, "big") + data[6:7] + pdu


def random_request(rng: random.Random) -> bytes:
    """Return targets, halves of targets, reads of positions and of other registers, and nonsense."""
    target = rng.randrange(100_000).to_bytes(4, "big")
    return rng.choice(
        (
            bytes.fromhex("10 0064 0002 04") + target,
            bytes.fromhex("10 0064 0002 04") + target,
            bytes.fromhex("06 0064") + target[:2],
            bytes.fromhex("06 0065") + target[2:],
            bytes.fromhex("03 006E 0002"),
            bytes.fromhex("03 0064 0002"),
            bytes.fromhex("03 0060 0010"),
            bytes.fromhex("03 00C8 0001"),
            bytes.fromhex("06 0078 0001"),
            bytes.fromhex("06 0078 0001"),
            bytes((rng.randrange(1, 0x2B),)) + rng.randbytes(rng.randrange(8)),
        )
    )


def staged() -> AxisPlan:
    """An axis on unit 2 whose targets wait for a trigger, and whose drive says whether it is homed."""
    return replace(
        axis_plan(),
        name="y",
        unit_id=2,
        referenced=Reference.DRIVE_BIT,
        bits={"homed": BitField(200, 0), "done": BitField(200, 1)},
        motion=MotionPlan(is_staged=True, triggers=(TriggerPlan(120, deeds={1: Operation(Action.START)}),)),
    )


async def recorded_relay(
    bench: Bench,
    kind: str,
    recorder: Recorder,
    seed: int = 1,
    *,
    axis: AxisPlan | None = None,
    gap_ms: float = 0.0,
) -> tuple[Relay, GatewayPlan]:
    """A relay with two axes between two TCP controllers and a moody drive."""
    drive = MoodyDrive(kind, seed)
    drive.end, where = await bench.drive(kind, drive)
    plans = (ControllerPlan("cnc", timeout_ms=30.0), ControllerPlan("hmi", timeout_ms=30.0))
    links = tuple(ControllerLink(each, bench.controller_link("tcp")[0].endpoint) for each in plans)
    axes = (axis or axis_plan(), staged())
    plan = GatewayPlan("bench", (LinePlan("line", where, links, axes, replace(QUICK, gap_ms=gap_ms)),))
    relay = await bench.start(plan, recorder=recorder)
    await until_up(relay)
    return relay, plan


async def chat(bench: Bench, relay: Relay, seed: int) -> None:
    """Let two controllers ask at random, one of which comes and goes."""
    rng = random.Random(seed)
    steady = await bench.connect(relay.address("line", "cnc"))
    fickle = await bench.connect(relay.address("line", "hmi"))
    for number in range(ROUNDS):
        for end in (steady, fickle):
            if rng.random() < 0.7:
                end.write(encode_mbap(number, rng.choice((1, 1, 2, 2, 3)), random_request(rng)))
        if rng.random() < 0.1:
            assert fickle.channel is not None
            fickle.channel.close()
            fickle = await bench.connect(relay.address("line", "hmi"))
        if rng.random() < 0.5:
            heard = len(steady.data)
            steady.write(encode_mbap(number, 1, bytes.fromhex("03 006E 0002")))
            with contextlib.suppress(TimeoutError):  # some are never answered
                async with asyncio.timeout(0.05):
                    await steady.until(lambda end, heard=heard: len(end.data) > heard)  # type: ignore[misc]
        if number == ROUNDS // 2:
            relay.command(Disable(axes=("x",)))
        if number == 3 * ROUNDS // 4:
            relay.command(Enable(axes=("x",)))


async def recorded_chat(bench: Bench, path: Path) -> tuple[GatewayPlan, list[Entry]]:
    relay, plan = await recorded_relay(bench, "tcp", Recorder(path, HEADER))
    await chat(bench, relay, 1)
    await relay.stop()
    return plan, entries_of(path)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", ["tcp", "rtu"])
async def test_random_traffic_replays_to_the_same_bytes(
    bench: Bench, tmp_path: Path, kind: str, seed: int
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, kind, Recorder(path, HEADER), seed)
    await chat(bench, relay, seed)
    await relay.stop()
    result = replayed(plan, path)
    assert (result.different, result.first, result.is_truncated) == (0, [], False)
    kinds = set(map(type, entries_of(path)))
    assert kinds >= {Header, traffic.Request, Sent, traffic.Reply, Answered, Tick}
    assert kinds >= {traffic.Commanded, traffic.Gone, traffic.Stop, End}
    assert result.outputs > ROUNDS
    assert line_status(relay)["timeouts"]


@pytest.mark.parametrize("kind", ["tcp", "rtu"])
async def test_requests_that_waited_for_a_silence_replay_to_the_same_bytes(
    bench: Bench, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, kind, Recorder(path, HEADER), gap_ms=3.0)
    await chat(bench, relay, 1)
    await relay.stop()
    result = replayed(plan, path)
    assert (result.different, result.first, result.is_truncated) == (0, [], False)
    entries = entries_of(path)
    assert len([entry for entry in entries if isinstance(entry, traffic.Paced)]) > 10
    assert replayed(plan, [each for each in entries if not isinstance(each, traffic.Paced)]).different


@pytest.mark.parametrize("seed", [1, 2])
async def test_temperatures_and_another_axis_replay_alike(bench: Bench, tmp_path: Path, seed: int) -> None:
    path = tmp_path / "record.jsonl"
    axis = axis_plan()
    warm = replace(
        axis,
        settings=replace(axis.settings, travel=(-1e5, 1e5), max_correction=1e6, travel_margin=1e9),
        thermal=ThermalSettings(1e-4, rate_per_min=60.0),
        cross=(CrossPlan("y", (-1e6, 1e6), (-100.0, 100.0)),),
    )
    relay, plan = await recorded_relay(bench, "tcp", Recorder(path, HEADER), seed, axis=warm)
    for celsius in (21.0, 35.0, 15.0):
        assert relay.command(SetTemperature(axis="x", celsius=celsius)) == {"x": ""}
        with pytest.raises(ControlError):
            relay.command(SetTemperature(axis="x", celsius=3000.0))
        await chat(bench, relay, seed)
    await relay.stop()
    result = replayed(plan, path)
    assert (result.different, result.first, result.is_truncated) == (0, [], False)
    told = [entry.command for entry in entries_of(path) if isinstance(entry, traffic.Commanded)]
    found = [each.celsius for each in told if isinstance(each, SetTemperature)]
    assert found == [21.0, 3000.0, 35.0, 3000.0, 15.0, 3000.0]
    cold = replace(plan.lines[0], axes=(replace(warm, thermal=None), *plan.lines[0].axes[1:]))
    assert replayed(GatewayPlan("bench", (cold,)), path).different


def test_one_line_replays_alone_though_an_axis_of_another_one_acts_on_it() -> None:
    plain = replace(axis_plan(), settings=replace(axis_plan().settings, max_correction=1.0))
    x = replace(plain, cross=(CrossPlan("y", (0.0, 100.0), (0.0, 0.2)),), table=FLAT)
    links = (ControllerLink(ControllerPlan("cnc"), TcpEndpoint("h", 1)),)
    plan = GatewayPlan(
        "bench",
        tuple(
            LinePlan(name, TcpEndpoint("h", 1), links, (axis,), TIMING)
            for name, axis in (("one", x), ("other", replace(plain, name="y", table=FLAT)))
        ),
    )
    target, told = "1000640002040000C350", "100064000204" + (50_100).to_bytes(4).hex()  # y at 50 adds 0.1 mm
    entries: list[Entry] = []
    for t, name in enumerate(("other", "one"), start=1):
        sent = target.lower() if name == "other" else told
        entries += (
            traffic.Up(name, t * 1000),
            traffic.Request(name, t * 1000, 1, "cnc", 7, 1, target),
            Sent(name, 1, sent),
            traffic.Reply(name, t * 1000 + 1, 1, "1000640002"),
            Answered(name, 1, 7, 1, "1000640002"),
        )
    for only, outputs in ((None, 4), ("one", 2), ("other", 2)):
        result = replayed(plan, [*entries, End(0)], only)
        assert (result.outputs, result.first) == (outputs, [])


def test_an_odd_frame_of_a_serial_port_replays_to_the_same_bytes() -> None:
    link = ControllerLink(ControllerPlan("cnc", serial=True), SerialEndpoint("/dev/ttyUSB0"))
    line = LinePlan("one", SerialEndpoint("/dev/ttyUSB1"), (link,), (axis_plan(),), TIMING)
    entries: tuple[Entry, ...] = (
        traffic.Up("one", 1000),
        traffic.Request("one", 2000, 1, "cnc", 0, 5, "030101"),
        Sent("one", 5, "030101"),
        traffic.Reply("one", 3000, 5, "030101"),
        Answered("one", 1, 0, 5, "030101"),
        End(0),
    )
    for odd, different in ((frozenset({5}), 0), (frozenset(), 1)):
        plan = GatewayPlan("bench", (replace(line, other_units=OtherUnits(odd, odd)),))
        assert bool(replayed(plan, entries).different) == different


async def test_another_configuration_shows_what_it_would_have_done(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, "tcp", Recorder(path, HEADER))
    near = await bench.connect(relay.address("line", "cnc"))
    near.write(encode_mbap(1, 1, bytes.fromhex("10 0064 0002 04 0000C350")))
    await near.until(lambda end: len(end.data) > 0)
    await relay.stop()
    without_x = replace(plan.lines[0], axes=plan.lines[0].axes[1:])
    result = replayed(GatewayPlan("bench", (without_x,)), path)
    first = result.first[0]
    # 50 000 counts; the axis of the bench adds 50 there, and without an axis they pass as they are.
    assert first.expected == Sent("line", 1, "10006400020400" + "00c382")
    assert first.got == Sent("line", 1, "10006400020400" + "00c350")
    cause = entries_of(path)[first.entry - 1]
    assert isinstance(cause, traffic.Request)
    assert first.t == cause.t


async def test_an_output_too_many_or_too_few_is_a_difference(bench: Bench, tmp_path: Path) -> None:
    plan, entries = await recorded_chat(bench, tmp_path / "record.jsonl")
    place = next(i for i, entry in enumerate(entries) if isinstance(entry, Answered))
    for changed in ([*entries[:place], *entries[place + 1 :]], [*entries[:place], *entries[place:][:1] * 2]):
        assert replayed(plan, [*changed, End(0)]).different >= 1


async def test_a_recording_that_was_cut_off_is_replayed_to_its_end(bench: Bench, tmp_path: Path) -> None:
    plan, entries = await recorded_chat(bench, tmp_path / "record.jsonl")
    for length in range(1, 60):
        result = replayed(plan, entries[:length])
        assert (result.different, result.is_truncated) == (0, True)


async def test_a_full_disk_ends_the_recording_and_not_the_gateway(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, "tcp", Recorder(path, HEADER, max_bytes=3000))
    await chat(bench, relay, 1)
    await eventually(lambda: any(note.event == "recording-ended" for note in bench.notes))
    near = await bench.connect(relay.address("line", "cnc"))
    while not near.data:  # one may wait for longer than its 30 ms, and is then withdrawn
        near.write(encode_mbap(1, 1, b"\x03\x00\x6e\x00\x02"))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(0.2):
                await near.until(lambda end: len(end.data) > 0)
    await relay.stop()
    [note] = [note for note in bench.notes if note.event == "recording-ended"]
    assert note.severity.value == "error"
    assert "its limit of 3000 bytes" in str(note.fields["detail"])
    assert "The gateway continues without it" in str(note.fields["detail"])
    assert path.stat().st_size <= 3000
    assert replayed(plan, path).different == 0


async def test_a_disk_that_is_too_slow_ends_the_recording(tmp_path: Path) -> None:
    lost: list[str] = []
    recorder = Recorder(tmp_path / "record.jsonl", HEADER, capacity=3)
    recorder.on_lost = lost.append
    recorder.start()
    for number in range(5):
        recorder.put(Tick("line", number))  # faster than anything is written
    await recorder.stop()
    assert len(lost) == 1
    assert "3 entries wait for a disk that is too slow" in lost[0]
    assert [type(entry) for entry in entries_of(recorder.path)] == [Header]


async def test_a_recorder_writes_while_it_records_and_ends_in_order(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "record.jsonl", HEADER)
    recorder.start()
    recorder.put(Tick("line", 1))
    await eventually(lambda: recorder.entries == 1)
    recorder.put(Tick("line", 2))
    await recorder.stop()
    recorder.put(Tick("line", 3))
    assert entries_of(recorder.path) == [HEADER, Tick("line", 1), Tick("line", 2), End(2)]
    assert recorder.path.stat().st_mode & 0o777 == 0o600


async def test_a_file_that_exists_is_not_recorded_over(bench: Bench, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    path.write_text("precious")
    with pytest.raises(Exception, match="exists: record into a new file, or remove this one"):
        await recorded_relay(bench, "tcp", Recorder(path, HEADER))
    assert path.read_text() == "precious"


def test_lines_and_controllers_that_a_configuration_lacks_are_named() -> None:
    plan = GatewayPlan("bench", (LinePlan("line", TcpEndpoint("h", 1), (), (), TIMING),))
    with pytest.raises(ReplayError, match="there is no line other; there are line"):
        Replay(plan, "other")
    with pytest.raises(ReplayError, match=r"has no line xyz, .* there are line; choose a line of"):
        Replay(plan).feed(2, traffic.Up("xyz", 0))
    with pytest.raises(ReplayError, match="has no controller cnc, but the recording has"):
        Replay(plan).feed(2, traffic.Request("line", 0, 1, "cnc", 0, 1, "0300000001"))


# === who moves an axis is in a recording =================================================================

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
