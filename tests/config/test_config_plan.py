"""A good file gives exactly the numbers that it says, and the documented ones where it says nothing."""

from pathlib import Path

import pytest

from gateway.compensation.settings import (
    AxisSettings,
    Backlash,
    BacklashKind,
    Gain,
    Outside,
    OutsideKind,
    Reversal,
    ReversalKind,
    Setpoints,
)
from gateway.compensation.units import Units
from gateway.drives.motion import Form
from gateway.exchange.plan import AxisPlan, CompensationMode, ControllerPlan, LineTiming, Reference, Role
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from gateway.state.plan import ControllerLink, LinePlan, RelayOptions
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.config.config_bench import GOOD, ONE_WAY, edited, loaded


def only_line(folder: Path, text: str = GOOD, tables: dict[str, str] | None = None) -> LinePlan:
    [line] = loaded(folder, text, tables).plan.lines
    return line


def only_axis(folder: Path, text: str = GOOD, tables: dict[str, str] | None = None) -> AxisPlan:
    [axis] = only_line(folder, text, tables).axes
    return axis


def test_a_line_with_its_controllers(tmp_path: Path) -> None:
    line = only_line(tmp_path)
    assert line.drives == SerialEndpoint("/dev/serial/by-id/usb-B", 115200, "E", 8, 1)
    assert line.controllers == (
        ControllerLink(
            ControllerPlan("cnc", Role.MOTION, 1000.0, serial=True),
            SerialEndpoint("/dev/serial/by-id/usb-A", 38400, "N", 8, 1),
        ),
        ControllerLink(
            ControllerPlan("hmi", Role.MONITOR, 1000.0, serial=False), TcpEndpoint("127.0.0.1", 1502)
        ),
    )
    assert line.timing == LineTiming(1000.0, 1000.0, 100.0, 0.0)


def test_the_relay_is_scheduled_as_it_was_started_unless_the_file_says_otherwise(tmp_path: Path) -> None:
    assert loaded(tmp_path).plan.relay == RelayOptions(fifo=0, cpus=(), lock_memory=False)
    assert loaded(tmp_path, GOOD + "\n[relay]\n").plan.relay == RelayOptions()
    text = GOOD + "\n[relay]\nfifo = 50\ncpus = [3, 1]\nlock_memory = true\n"
    assert loaded(tmp_path, text).plan.relay == RelayOptions(fifo=50, cpus=(3, 1), lock_memory=True)


def test_the_driver_of_a_port_may_be_left_as_it_is(tmp_path: Path) -> None:
    text = edited(
        ('parity = "even"', 'parity = "even", low_latency = false'),
        ("baudrate = 38400", "baudrate = 38400\nlow_latency = false"),
    )
    line = only_line(tmp_path, text)
    ends = (line.drives, line.controllers[0].endpoint)
    assert [end.low_latency for end in ends if isinstance(end, SerialEndpoint)] == [False, False]
    line = only_line(tmp_path)
    ends = (line.drives, line.controllers[0].endpoint)
    assert [end.low_latency for end in ends if isinstance(end, SerialEndpoint)] == [True, True]


def test_the_numbers_of_an_axis_that_says_little(tmp_path: Path) -> None:
    assert only_axis(tmp_path).settings == AxisSettings(
        units=Units.MM,
        counts_per_unit=1000.0,
        travel=(-300.0, 0.0),
        travel_margin=0.5,
        setpoints=Setpoints.TARGETS,
        hysteresis=0.002,  # two counts of 1 µm
        reload_distance=1.0,
        max_correction=0.5,
        max_slope=0.01,
        max_speed=200.0,
        fresh_ms=20.0,
    )


def test_the_registers_of_an_axis(tmp_path: Path) -> None:
    axis = only_axis(tmp_path)
    assert axis.command == (PositionField(0x0606, RegisterType.INT32, WordOrder.LOW_FIRST, 1.0),)
    assert axis.actual == (PositionField(0x0520, RegisterType.INT32, WordOrder.LOW_FIRST, 1.0),)
    assert axis.commanded == ()
    assert axis.bits == {"homed": BitField(0x0140, 6), "done": BitField(0x0140, 1)}
    assert (axis.writes_with, axis.max_registers, axis.safe_read) == (Form.FC16, 123, True)
    assert axis.checks_crc
    assert (axis.added_frames, axis.exception_writes_nothing) == (True, False)
    assert (axis.compensation, axis.referenced) == (CompensationMode.ON, Reference.DRIVE_BIT)


def test_the_table_of_an_axis(tmp_path: Path) -> None:
    axis = only_axis(tmp_path)
    assert axis.table is not None
    assert list(axis.table.positions) == [-300.0, -150.0, 0.0]
    assert list(axis.table.forward) == [-0.012, -0.003, 0.01]
    assert list(axis.table.backward) == [-0.02, -0.01, 0.0]
    assert (axis.table_name, axis.table_format, len(axis.table_digest)) == ("cnc10x.tab", "centroid-3", 64)


EVERYTHING = """\
zero_counts = -500
machine_offset = 2.5
travel_margin = 0.25
setpoints = "stream"
hysteresis = 0.01
reversal = { time_ms = 50 }
reload = { distance = 3 }
outside = { fade = 10 }
gain = { forward = 1, backward = 0.5 }
backlash = { width = 0.04, kind = "homed-backward" }
max_correction = 0.3
max_slope = 0.02
max_speed = 150
fresh_ms = 5
home_approach = "backward"
added_frames = "never"
"""


def test_an_axis_that_says_everything(tmp_path: Path) -> None:
    text = edited(
        ("max_speed = 200.0", EVERYTHING),
        ("counts_per_unit = 1000.0", "counts_per_unit = -2000"),
        ('referenced = "drive-bit"', 'referenced = "absolute"'),
        ('compensation = "on"', 'compensation = "shadow"'),
    )
    text += 'commanded = [{ address = 0x0530, type = "float32", scale = 10 }]\n'
    text += 'exception = "nothing-written"\nsafe_read = false\nchecks_crc = false\nmax_registers = 10\n'
    axis = only_axis(tmp_path, text, {"cnc10x.tab": ONE_WAY})
    assert axis.settings == AxisSettings(
        units=Units.MM,
        counts_per_unit=-2000.0,
        zero_counts=-500.0,
        machine_offset=2.5,
        travel=(-300.0, 0.0),
        travel_margin=0.25,
        setpoints=Setpoints.STREAM,
        hysteresis=0.01,
        reversal=Reversal(ReversalKind.TIME_MS, 50.0),
        reload_distance=3.0,
        outside=Outside(OutsideKind.FADE, 10.0),
        gain=Gain(1.0, 0.5),
        backlash=Backlash(0.04, BacklashKind.HOMED_BACKWARD),
        max_correction=0.3,
        max_slope=0.02,
        max_speed=150.0,
        fresh_ms=5.0,
        home_approach=-1,
    )
    assert axis.commanded == (PositionField(0x0530, RegisterType.FLOAT32, WordOrder.HIGH_FIRST, 10.0),)
    assert (axis.compensation, axis.referenced) == (CompensationMode.SHADOW, Reference.ABSOLUTE)
    assert (axis.added_frames, axis.exception_writes_nothing, axis.safe_read) == (False, True, False)
    assert (axis.checks_crc, axis.max_registers) == (False, 10)


@pytest.mark.parametrize(
    ("command", "actual", "hysteresis"),
    [
        ('"float32"', '"float32"', 0.001),
        ('"float32"', '"int32", scale = 0.01', 0.02),
        ('"int32", scale = 0.01', '"int32", scale = 0.01', 0.02),
        ('"int32", scale = 0.01', '"int32"', 2.0),
        ('"int32", scale = 10', '"int32"', 2.0),
    ],
)
def test_where_a_count_is_a_millimetre_the_steps_of_the_registers_are_the_default_hysteresis(
    tmp_path: Path, command: str, actual: str, hysteresis: float
) -> None:
    text = edited(
        ("counts_per_unit = 1000.0", "counts_per_unit = 1.0"),
        ('address = 0x0606, type = "int32"', f"address = 0x0606, type = {command}"),
        ('address = 0x0520, type = "int32"', f"address = 0x0520, type = {actual}"),
        ('table = "cnc10x.tab"\n', ""),
    )
    assert only_axis(tmp_path, text).settings.hysteresis == pytest.approx(hysteresis, rel=1e-12)


def test_default_lengths_of_an_axis_in_inches_are_those_in_mm(tmp_path: Path) -> None:
    text = edited(
        ('units = "mm"', 'units = "inch"'),
        ("counts_per_unit = 1000.0", "counts_per_unit = 1e6"),
        ("travel = [-300.0, 0.0]", "travel = [-12.0, 0.0]"),
        ('table = "cnc10x.tab"\n', ""),
    )
    settings = only_axis(tmp_path, text).settings
    # 1 µm is more than two counts of a millionth of an inch.
    assert settings.hysteresis == pytest.approx(0.001 / 25.4, rel=1e-15)
    assert settings.max_correction == settings.travel_margin == pytest.approx(0.5 / 25.4, rel=1e-15)
    assert settings.reload_distance == pytest.approx(1.0 / 25.4, rel=1e-15)


def test_without_a_table_an_axis_passes_one_to_one(tmp_path: Path) -> None:
    axis = only_axis(tmp_path, edited(('table = "cnc10x.tab"\n', "")))
    assert axis.table is None
    assert (axis.table_name, axis.table_format, axis.table_digest) == ("", "", "")


def test_a_step_may_be_asked_for_in_either_way_of_commanding(tmp_path: Path) -> None:
    for setpoints in ("targets", "stream"):
        text = edited(("max_speed = 200.0", f'setpoints = "{setpoints}"\nreversal = "step"'))
        assert only_axis(tmp_path, text).settings.reversal == Reversal(ReversalKind.STEP)


def test_the_drive_that_needs_the_longest_silence_sets_the_pace_of_its_line(tmp_path: Path) -> None:
    text = edited(("[line.xyz]", "[line.xyz]\ngap_ms = 4\ndrain_ms = 250\nturnaround_ms = 150"))
    text = edited(("[line.xyz]", "[line.xyz]\nresponse_timeout_ms = 300"), text=text) + "gap_ms = 10.5\n"
    assert only_line(tmp_path, text).timing == LineTiming(300.0, 250.0, 150.0, 10.5)


def test_how_the_drives_are_connected_to_reaches_the_plan(tmp_path: Path) -> None:
    rtu = '{ rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }'
    keys = 'connect = "on-demand"\nconnect_delay_ms = 1000\nmax_connection_s = 3600'
    text = edited((rtu, '{ tcp = "10.0.0.7:502" }'), ("[line.xyz]", f"[line.xyz]\n{keys}"))
    timing = only_line(tmp_path, text).timing
    assert (timing.connects_on_demand, timing.connect_delay_ms, timing.max_connection_s) == (
        True,
        1000.0,
        3600.0,
    )
    plain = only_line(tmp_path, GOOD).timing
    assert (plain.connects_on_demand, plain.connect_delay_ms, plain.max_connection_s) == (False, 0.0, 0.0)


def test_cut_through_is_off_unless_it_is_asked_for(tmp_path: Path) -> None:
    assert only_line(tmp_path, GOOD).cut_through is False
    assert only_line(tmp_path, edited(("[line.xyz]", "[line.xyz]\ncut_through = true"))).cut_through is True


def test_what_a_drive_takes_to_answer_reaches_the_plan(tmp_path: Path) -> None:
    assert only_axis(tmp_path).response_ms is None
    assert only_axis(tmp_path, GOOD + "response_ms = 2.5\n").response_ms == 2.5


def test_drives_over_the_network(tmp_path: Path) -> None:
    rtu = '{ rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }'
    over = only_line(tmp_path, edited((rtu, '{ rtu_over_tcp = "nport.local:4001" }')))
    assert over.drives == TcpEndpoint("nport.local", 4001, rtu=True)
    six = only_line(tmp_path, edited((rtu, '{ tcp = "[FD00::0:1]:502" }')))
    assert six.drives == TcpEndpoint("fd00::1", 502)


def test_who_may_connect(tmp_path: Path) -> None:
    line = only_line(
        tmp_path, edited(('role = "monitor"', 'allow = ["192.168.0.0/24", "10.0.0.7", "fd00::/8"]'))
    )
    assert line.controllers[1].allow == ("192.168.0.0/24", "10.0.0.7/32", "fd00::/8")


def test_a_line_without_axes_is_a_plain_gateway(tmp_path: Path) -> None:
    assert only_line(tmp_path, GOOD[: GOOD.index("[axis.x]")]).axes == ()


def test_folders_are_relative_to_the_file(tmp_path: Path) -> None:
    result = loaded(tmp_path)
    assert (result.tables_folder, result.state_folder) == (tmp_path / "tables", tmp_path / "state")
    assert result.plan.name == "mill-1"
    assert result.warnings == ()


def test_guarded_and_remapping_registers_reach_the_plan(tmp_path: Path) -> None:
    text = GOOD + (
        'position_like = [{ address = 0x0530, type = "int32" }]\n'
        'remap = [{ address = 0x0550, type = "uint16" }]\n'
    )
    text = text.replace("max_speed = 200.0", 'max_speed = 200.0\nunmapped = "pass"')
    axis = loaded(tmp_path, text).plan.lines[0].axes[0]
    assert [field.address for field in axis.guarded] == [0x0530]
    assert [field.address for field in axis.remapping] == [0x0550]
    assert axis.passes_unmapped
    assert not loaded(tmp_path).plan.lines[0].axes[0].passes_unmapped


@pytest.mark.parametrize(
    ("drives", "odd"),
    [
        ('rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even"', {5, 7}),
        ('tcp = "192.0.2.1:502"', set()),
        ('rtu_over_tcp = "192.0.2.1:502"', set()),
    ],
)
def test_other_devices_may_take_odd_frames_where_their_bus_is_a_serial_port(
    tmp_path: Path, drives: str, odd: set[int]
) -> None:
    before = 'rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even"'
    text = edited((before, drives), ("[line.xyz]", "[line.xyz]\nother_units = [5, 7, 0]"))
    other = only_line(tmp_path, text).other_units
    assert (set(other.unit_ids), set(other.odd)) == ({0, 5, 7}, odd)
