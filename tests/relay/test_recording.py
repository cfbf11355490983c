"""What was recorded over real sockets and ports comes out the same again, byte for byte."""

import asyncio
import contextlib
import random
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import pytest

from gateway.compensation.settings import Gain, ThermalSettings
from gateway.compensation.table import make_table
from gateway.compensation.units import Units
from gateway.drives.motion import Action, Deed, MotionPlan, TriggerPlan
from gateway.exchange.control import (
    ClearTable,
    Control,
    ControlError,
    Declare,
    EndDryRun,
    SetGain,
    SetLimits,
    SetTables,
    SetTemperature,
    Switch,
    TableChange,
)
from gateway.exchange.limits import Limits
from gateway.exchange.plan import AxisPlan, ControllerPlan, CrossPlan, OtherUnits, Reference
from gateway.ipc import traffic
from gateway.ipc.traffic import Answered, End, Entry, Header, Sent, Tick
from gateway.modbus.mbap import encode_mbap
from gateway.modbus.registers import BitField
from gateway.modbus.rtu import encode_rtu
from gateway.relay.gateway import Relay
from gateway.relay.recorded import entry_of, message_of
from gateway.relay.recorder import Recorder
from gateway.relay.replay import Replay, ReplayError, ReplayResult
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan
from gateway.state.tables import compiled
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint

if TYPE_CHECKING:
    from tests.relay.conftest import Bench, RawEnd, Tools

HEADER = Header(traffic.FORMAT, "0", "2026-01-01T00:00:00+00:00", "gateway.toml", "")
ROUNDS = 120
FLAT = make_table([0.0, 100.0], [0.0, 0.0], [0.0, 0.0], Units.MM)


def entries_of(path: Path) -> list[Entry]:
    return [traffic.decode(line) for line in path.read_bytes().splitlines(keepends=True)]


def replayed(path: Path, plan: GatewayPlan, only: str | None = None) -> ReplayResult:
    replay = Replay(plan, only)
    for number, entry in enumerate(entries_of(path), start=1):
        replay.feed(number, entry)
    return replay.result


MESSAGES: dict[type, tuple[Control, ...]] = {
    Switch: (Switch("x", is_wanted=True), Switch("x", is_wanted=False)),
    Declare: (Declare("x"),),
    SetTables: (SetTables((TableChange("x", FLAT, "x.tab", "centroid-3", "0" * 64),)),),
    ClearTable: (ClearTable("x"),),
    SetGain: (SetGain("x", Gain(0.5, 0.25)), SetGain("x", Gain(0.5, 0.25), is_configured=True)),
    SetLimits: (SetLimits("x", Limits(0.5, 0.1, 2.0, 150.0)),),
    SetTemperature: (SetTemperature("x", 21.5),),
    EndDryRun: (EndDryRun("x"),),
}


@pytest.mark.parametrize("kind", get_args(Control))
def test_whatever_is_asked_of_a_line_is_recorded_so_that_it_can_be_asked_again(kind: type) -> None:
    for message in MESSAGES[kind]:
        entry = traffic.decode(traffic.encode(entry_of(message, "line", 7)))
        assert isinstance(entry, get_args(traffic.ControlInput))
        assert (entry.line, entry.t) == ("line", 7)
        again = message_of(entry)
        if isinstance(message, SetTables) and isinstance(again, SetTables):
            [was], [now] = message.changes, again.changes
            assert compiled(now.table) == compiled(was.table)
            assert replace(now, table=was.table) == was
        else:
            assert again == message


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


def staged(tools: "Tools") -> AxisPlan:
    """An axis on unit 2 whose targets wait for a trigger, and whose drive says whether it is homed."""
    return replace(
        tools.axis(),
        name="y",
        unit_id=2,
        referenced=Reference.DRIVE_BIT,
        bits={"homed": BitField(200, 0), "done": BitField(200, 1)},
        motion=MotionPlan(is_staged=True, triggers=(TriggerPlan(120, deeds={1: Deed(Action.START)}),)),
    )


async def recorded_relay(
    bench: "Bench",
    tools: "Tools",
    kind: str,
    recorder: Recorder,
    seed: int = 1,
    *,
    axis: AxisPlan | None = None,
) -> tuple[Relay, GatewayPlan]:
    """A relay with two axes between two TCP controllers and a moody drive."""
    drive = MoodyDrive(kind, seed)
    drive.end, where = await bench.drive(kind, drive)
    plans = (ControllerPlan("cnc", timeout_ms=30.0), ControllerPlan("hmi", timeout_ms=30.0))
    links = tuple(ControllerLink(each, bench.controller_link("tcp")[0].endpoint) for each in plans)
    plan = GatewayPlan(
        "bench", (LinePlan("line", where, links, (axis or tools.axis(), staged(tools)), tools.quick),)
    )
    relay = Relay(plan, bench.notes.append, recorder=recorder)
    await relay.start()
    bench.stack.push_async_callback(relay.stop)
    await tools.until_up(relay)
    return relay, plan


async def chat(bench: "Bench", relay: Relay, seed: int) -> None:
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
            relay.control(Switch("x", is_wanted=False))
        if number == 3 * ROUNDS // 4:
            relay.control(Switch("x", is_wanted=True))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", ["tcp", "rtu"])
async def test_random_traffic_with_time_outs_and_reconnects_replays_to_the_same_bytes(
    bench: "Bench", tools: "Tools", tmp_path: Path, kind: str, seed: int
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, tools, kind, Recorder(path, HEADER), seed)
    await chat(bench, relay, seed)
    await relay.stop()
    result = replayed(path, plan)
    assert (result.different, result.first, result.is_cut_off) == (0, [], False)
    kinds = {type(entry).__name__ for entry in entries_of(path)}
    assert kinds >= {
        "Header",
        "Request",
        "Sent",
        "Reply",
        "Answered",
        "Tick",
        "Control",
        "Gone",
        "Stop",
        "End",
    }
    assert result.outputs > ROUNDS
    status = tools.line_status(relay)
    assert status["timeouts"]


@pytest.mark.parametrize("seed", [1, 2])
async def test_temperatures_and_another_axis_replay_to_the_same_bytes(
    bench: "Bench", tools: "Tools", tmp_path: Path, seed: int
) -> None:
    path = tmp_path / "record.jsonl"
    axis = tools.axis()
    warm = replace(
        axis,
        settings=replace(axis.settings, travel=(-1e5, 1e5), max_correction=1e6, travel_margin=1e9),
        thermal=ThermalSettings(1e-4, rate_per_min=60.0),
        cross=(CrossPlan("y", (-1e6, 1e6), (-100.0, 100.0)),),
    )
    relay, plan = await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER), seed, axis=warm)
    for celsius in (21.0, 35.0, 15.0):
        assert relay.control(SetTemperature("x", celsius)) == {"x": ""}
        with pytest.raises(ControlError):
            relay.control(SetTemperature("x", 3000.0))
        await chat(bench, relay, seed)
    await relay.stop()
    result = replayed(path, plan)
    assert (result.different, result.first, result.is_cut_off) == (0, [], False)
    told = [entry for entry in entries_of(path) if isinstance(entry, traffic.Temperature)]
    assert [entry.celsius for entry in told] == [21.0, 3000.0, 35.0, 3000.0, 15.0, 3000.0]
    cold = replace(plan.lines[0], axes=(replace(warm, thermal=None), *plan.lines[0].axes[1:]))
    assert replayed(path, GatewayPlan("bench", (cold,))).different


def test_one_line_replays_alone_though_an_axis_of_another_one_acts_on_it(tools: "Tools") -> None:
    plain = replace(tools.axis(), settings=replace(tools.axis().settings, max_correction=1.0))
    x = replace(plain, cross=(CrossPlan("y", (0.0, 100.0), (0.0, 0.2)),), table=FLAT)
    links = (ControllerLink(ControllerPlan("cnc"), TcpEndpoint("h", 1)),)
    plan = GatewayPlan(
        "bench",
        tuple(
            LinePlan(name, TcpEndpoint("h", 1), links, (axis,), tools.timing)
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
        replay = Replay(plan, only)
        for number, entry in enumerate([*entries, End(0)], start=1):
            replay.feed(number, entry)
        assert (replay.result.outputs, replay.result.first) == (outputs, [])


def test_an_odd_frame_of_a_serial_port_replays_to_the_same_bytes(tools: "Tools") -> None:
    link = ControllerLink(ControllerPlan("cnc", serial=True), SerialEndpoint("/dev/ttyUSB0"))
    line = LinePlan("one", SerialEndpoint("/dev/ttyUSB1"), (link,), (tools.axis(),), tools.timing)
    entries: tuple[Entry, ...] = (
        traffic.Up("one", 1000),
        traffic.Request("one", 2000, 1, "cnc", 0, 5, "030101"),
        Sent("one", 5, "030101"),
        traffic.Reply("one", 3000, 5, "030101"),
        Answered("one", 1, 0, 5, "030101"),
        End(0),
    )
    for odd, different in ((frozenset({5}), 0), (frozenset(), 1)):
        replay = Replay(GatewayPlan("bench", (replace(line, other_units=OtherUnits(odd, odd)),)), None)
        for number, entry in enumerate(entries, start=1):
            replay.feed(number, entry)
        assert bool(replay.result.different) == different


async def test_another_configuration_shows_what_it_would_have_done(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER))
    near = await bench.connect(relay.address("line", "cnc"))
    near.write(encode_mbap(1, 1, bytes.fromhex("10 0064 0002 04 0000C350")))
    await near.until(lambda end: len(end.data) > 0)
    await relay.stop()
    without_x = replace(plan.lines[0], axes=plan.lines[0].axes[1:])
    result = replayed(path, GatewayPlan("bench", (without_x,)))
    first = result.first[0]
    # 50 000 counts; the axis of the bench adds 50 there, and without an axis they pass as they are.
    assert first.expected == Sent("line", 1, "10006400020400" + "00c382")
    assert first.got == Sent("line", 1, "10006400020400" + "00c350")
    cause = entries_of(path)[first.entry - 1]
    assert isinstance(cause, traffic.Request)
    assert first.t == cause.t


async def test_an_output_too_many_or_too_few_is_a_difference(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER))
    await chat(bench, relay, 1)
    await relay.stop()
    entries = entries_of(path)
    place = next(i for i, entry in enumerate(entries) if isinstance(entry, Answered))
    for changed in ([*entries[:place], *entries[place + 1 :]], [*entries[:place], *entries[place:][:1] * 2]):
        replay = Replay(plan)
        for number, entry in enumerate([*changed, End(0)], start=1):
            replay.feed(number, entry)
        assert replay.result.different >= 1


async def test_a_recording_that_was_cut_off_is_replayed_as_far_as_it_goes(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER))
    await chat(bench, relay, 1)
    await relay.stop()
    entries = entries_of(path)
    for length in range(1, 60):
        replay = Replay(plan)
        for number, entry in enumerate(entries[:length], start=1):
            replay.feed(number, entry)
        assert (replay.result.different, replay.result.is_cut_off) == (0, True)


async def test_a_full_disk_ends_the_recording_loudly_and_not_the_gateway(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    path = tmp_path / "record.jsonl"
    relay, plan = await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER, max_bytes=3000))
    await chat(bench, relay, 1)
    await tools.eventually(lambda: any(note.event == "recording-ended" for note in bench.notes))
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
    assert "The gateway goes on without it" in str(note.fields["detail"])
    assert path.stat().st_size <= 3000
    assert replayed(path, plan).different == 0


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


async def test_a_recorder_writes_while_it_records_and_ends_in_order(tools: "Tools", tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "record.jsonl", HEADER)
    recorder.start()
    recorder.put(Tick("line", 1))
    await tools.eventually(lambda: recorder.entries == 1)
    recorder.put(Tick("line", 2))
    await recorder.stop()
    recorder.put(Tick("line", 3))
    assert entries_of(recorder.path) == [HEADER, Tick("line", 1), Tick("line", 2), End(2)]
    assert recorder.path.stat().st_mode & 0o777 == 0o600


async def test_a_file_that_exists_is_not_recorded_over(
    bench: "Bench", tools: "Tools", tmp_path: Path
) -> None:
    path = tmp_path / "record.jsonl"
    path.write_text("precious")
    with pytest.raises(Exception, match="exists: record into a new file, or remove this one"):
        await recorded_relay(bench, tools, "tcp", Recorder(path, HEADER))
    assert path.read_text() == "precious"


def test_lines_and_controllers_that_a_configuration_lacks_are_named(tools: "Tools") -> None:
    plan = GatewayPlan("bench", (LinePlan("line", TcpEndpoint("h", 1), (), (), tools.timing),))
    with pytest.raises(ReplayError, match="there is no line other; there are line"):
        Replay(plan, "other")
    with pytest.raises(ReplayError, match=r"has a line xyz, .* there are line; choose one"):
        Replay(plan).feed(2, traffic.Up("xyz", 0))
    with pytest.raises(ReplayError, match="has no controller cnc, which the recording has"):
        Replay(plan).feed(2, traffic.Request("line", 0, 1, "cnc", 0, 1, "0300000001"))
