"""What keys say to each other: lines that share a port, axes that share a register, settings that exclude."""

import sys
from pathlib import Path
from types import ModuleType

import pytest

from tests.config.config_bench import GOOD, ONE_WAY, edited, line_of, loaded, refusal, refused, warning_of

SECOND_LINE = """
[line.b]
drives = { tcp = "192.168.0.20:502" }

[[line.b.controllers]]
name = "plc"
tcp = "127.0.0.1:1503"
"""

SECOND_AXIS = """
[axis.y]
line = "xyz"
unit_id = 1
units = "mm"
counts_per_unit = 1000
travel = [0, 100]
referenced = "absolute"
compensation = "on"
registers.command = [{ address = 0x0700, type = "int32" }]
"""


def test_two_lines_and_two_axes_on_one_unit_are_fine(tmp_path: Path) -> None:
    plan = loaded(tmp_path, GOOD + SECOND_LINE + SECOND_AXIS).plan
    assert [[axis.name for axis in line.axes] for line in plan.lines] == [["x", "y"], []]


@pytest.mark.parametrize(
    ("kind", "scale", "warned"),
    # At 1000 counts/mm, 501 counts are 0.501 mm, and max_correction is 0.5 mm. A float has no steps.
    [("int32", 501.0, True), ("int32", 500.0, False), ("float32", 501.0, False)],
)
def test_a_position_whose_step_is_longer_than_any_correction_is_warned_of(
    tmp_path: Path, kind: str, scale: float, warned: bool
) -> None:
    text = edited(
        (
            'actual = [{ address = 0x0520, type = "int32", words = "low-first" }]',
            f'actual = [{{ address = 0x0520, type = "{kind}", scale = {scale} }}]',
        )
    )
    warnings = loaded(tmp_path, text).warnings
    if not warned:
        assert warnings == ()
        return
    [warning] = warnings
    assert (warning.key, warning.line) == ("axis.x.registers.actual[1].scale", line_of(text, "actual ="))
    assert warning.found == "one step of this position is 0.501 mm, more than max_correction = 0.5"


def test_unit_id_0_is_a_drive_on_modbus_tcp(tmp_path: Path) -> None:
    on_tcp = (
        GOOD + SECOND_LINE + SECOND_AXIS.replace('line = "xyz"', 'line = "b"').replace("id = 1", "id = 0")
    )
    assert loaded(tmp_path, on_tcp).plan.lines[1].axes[0].unit_id == 0


@pytest.mark.parametrize("second", ["/dev/serial/by-id/usb-A", "/dev/serial/../serial/by-id/usb-A"])
def test_a_serial_port_has_one_use(tmp_path: Path, second: str) -> None:
    text = GOOD + SECOND_LINE.replace('tcp = "192.168.0.20:502"', f'rtu = "{second}"')
    assert refusal(tmp_path, text, "line.b.drives.rtu").line == line_of(text, "[line.b]") + 1


def test_a_link_to_a_serial_port_is_that_port(tmp_path: Path) -> None:
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyUSB0")
    text = edited(
        ("/dev/serial/by-id/usb-A", str(tmp_path / "by-id")),
        ("/dev/serial/by-id/usb-B", str(tmp_path / "ttyUSB0")),
    )
    assert "line.xyz.drives.rtu" in refusal(tmp_path, text, "line.xyz.controllers[1].rtu").found


@pytest.mark.parametrize("other", ["127.0.0.1:1502", "localhost:1502", "0.0.0.0:1502"])
def test_an_address_is_listened_on_once(tmp_path: Path, other: str) -> None:
    text = GOOD + SECOND_LINE.replace("127.0.0.1:1503", other)
    problem = refusal(tmp_path, text, "line.b.controllers[1].tcp")
    assert problem.line == line_of(text, 'name = "plc"') + 1
    assert f"{other} is already the listener of line.xyz.controllers[2].tcp" in problem.found


def test_the_same_port_on_another_address_is_another_listener(tmp_path: Path) -> None:
    text = GOOD + SECOND_LINE.replace("127.0.0.1:1503", "192.168.7.1:1502")
    assert len(loaded(tmp_path, text).plan.lines) == 2


def test_the_gateway_does_not_talk_to_itself(tmp_path: Path) -> None:
    text = GOOD + SECOND_LINE.replace("192.168.0.20:502", "localhost:1502")
    problem = refusal(tmp_path, text, "line.xyz.controllers[2].tcp")
    assert "line.b.drives.tcp: the gateway would connect to itself" in problem.found


def test_drives_behind_one_address_belong_to_one_line(tmp_path: Path) -> None:
    second = SECOND_LINE.replace("line.b", "line.c").replace("1503", "1504")
    assert "one line" in refusal(tmp_path, GOOD + SECOND_LINE + second, "line.c.drives.tcp").remedy


@pytest.mark.parametrize("key", ['connect = "on-demand"', "connect_delay_ms = 5", "max_connection_s = 60"])
def test_keys_of_connections_are_not_for_serial_ports(tmp_path: Path, key: str) -> None:
    name = key.partition(" ")[0]
    problem = refusal(tmp_path, edited(("[line.xyz]", f"[line.xyz]\n{key}")), f"line.xyz.{name}")
    assert problem.found.endswith("with drives on a serial port")


@pytest.mark.parametrize("way", ["homing", "set-position"])
def test_a_reference_that_only_the_gateway_saw_needs_a_connection_that_stays(
    tmp_path: Path, way: str
) -> None:
    second = SECOND_LINE.replace("[line.b]", '[line.b]\nconnect = "on-demand"')
    axis = SECOND_AXIS.replace('line = "xyz"', 'line = "b"').replace('"absolute"', f'"{way}"')
    assert len(loaded(tmp_path, GOOD + second + axis.replace(f'"{way}"', '"absolute"')).plan.lines) == 2
    found = [each for each in refused(tmp_path, GOOD + second + axis) if each.key == "line.b.connect"]
    assert len(found) == 1
    assert "which has referenced" in found[0].found


def test_a_drain_is_for_rtu_drives(tmp_path: Path) -> None:
    text = GOOD + SECOND_LINE.replace("[line.b]", "[line.b]\ndrain_ms = 50")
    assert "transaction id" in refusal(tmp_path, text, "line.b.drain_ms").remedy


@pytest.mark.parametrize(
    "text",
    [
        GOOD + SECOND_LINE.replace("[line.b]", "[line.b]\ncut_through = true"),
        edited(('rtu = "/dev/serial/by-id/usb-A"\nbaudrate = 38400', 'tcp = "127.0.0.1:1503"')).replace(
            "[line.xyz]", "[line.xyz]\ncut_through = true"
        ),
    ],
)
def test_cut_through_is_for_a_line_between_two_serial_ports(tmp_path: Path, text: str) -> None:
    line = "b" if "[line.b]" in text else "xyz"
    assert "byte by byte" in refusal(tmp_path, text, f"line.{line}.cut_through").remedy


@pytest.mark.parametrize(
    ("mode", "warned"), [('compensation = "on"\n', True), ('compensation = "off"\n', False), ("", False)]
)
def test_an_axis_that_is_to_be_corrected_and_has_no_table_is_warned_of(
    tmp_path: Path, mode: str, *, warned: bool
) -> None:
    text = edited(('table = "cnc10x.tab"\ncompensation = "on"\n', mode))
    warnings = loaded(tmp_path, text).warnings
    assert [each.key for each in warnings] == (["axis.x.compensation"] if warned else [])
    if warned:
        assert warnings[0].line == line_of(text, mode.strip())
        assert warnings[0].found.startswith('compensation = "on" without a table: positions pass uncorrected')


def test_an_open_port_without_allow_is_warned_of(tmp_path: Path) -> None:
    text = edited(("127.0.0.1:1502", "0.0.0.0:1502"))
    warning = warning_of(tmp_path, text, "line.xyz.controllers[2].tcp", at="0.0.0.0:1502")
    assert "read the drives" in warning.found
    assert "allow" in warning.remedy
    allowed = edited(('role = "monitor"', 'allow = ["192.168.0.0/24"]'), text=text)
    assert all("allow" not in warning.remedy for warning in loaded(tmp_path, allowed).warnings)


# Command: 0x0606 and 0x0607. Actual: 0x0520 and 0x0521. Bits: 0x0140.
@pytest.mark.parametrize(
    ("old", "new", "key", "other"),
    [
        ("address = 0x0520", "address = 0x0607", "actual[1]", "command[1]"),
        ("address = 0x0520", "address = 0x0605", "actual[1]", "command[1]"),
        ("address = 0x0520", "address = 0x013F", "bits.homed", "actual[1]"),
    ],
)
def test_positions_of_an_axis_share_no_register(
    tmp_path: Path, old: str, new: str, key: str, other: str
) -> None:
    problems = refused(tmp_path, edited((old, new)))
    assert problems[0].key == f"axis.x.registers.{key}"
    assert f"axis.x.registers.{other}" in problems[0].found


def test_axes_of_one_unit_share_no_register_and_both_keys_are_named(tmp_path: Path) -> None:
    text = GOOD + SECOND_AXIS.replace("0x0700", "0x0607")
    problem = refusal(
        tmp_path, text, "axis.y.registers.command[1]", at="registers.command = [{ address = 0x0607"
    )
    assert problem.found == "0x0607..0x0608 overlaps 0x0606..0x0607 of axis.x.registers.command[1]"


def test_an_axis_that_was_copied_with_its_unit_id_is_one_problem(tmp_path: Path) -> None:
    text = edited(('table = "cnc10x.tab"\n', ""))
    copied = text[text.index("[axis.x]") :].replace("axis.x", "axis.y")
    problem = refusal(tmp_path, text + copied, "axis.y.unit_id")
    assert problem.found == "unit_id = 1 and the registers of axis.x: both would move the same drive"


def test_a_mode_that_lies_on_many_paths_is_one_problem(tmp_path: Path) -> None:
    text = edited(
        ('0x0606, type = "int32",', '0x0606, type = "int32", paths = { count = 16, stride = 8 },'),
        ("bits.homed", 'mode = { source = "in-frame", address = 0x0606, absolute = [1] }\nbits.homed'),
    )
    assert [problem.key for problem in refused(tmp_path, text)] == ["axis.x.registers.mode"]


def test_a_position_may_not_lie_on_a_state_bit_of_another_axis(tmp_path: Path) -> None:
    problems = refused(tmp_path, GOOD + SECOND_AXIS.replace("0x0700", "0x013F"))
    assert {problem.key for problem in problems} == {"axis.y.registers.command[1]"}


def test_the_same_registers_on_another_unit_are_other_registers(tmp_path: Path) -> None:
    text = GOOD + SECOND_AXIS.replace("0x0700", "0x0606").replace("unit_id = 1", "unit_id = 2")
    assert len(loaded(tmp_path, text).plan.lines[0].axes) == 2


def test_an_axis_needs_registers(tmp_path: Path) -> None:
    refusal(tmp_path, GOOD[: GOOD.index("[axis.x.registers]")], "axis.x.registers", at="[axis.x]")


def test_a_position_must_fit_the_frames_of_the_drive(tmp_path: Path) -> None:
    problems = refused(tmp_path, GOOD + "max_registers = 1\n")
    assert {problem.key for problem in problems} == {"axis.x.registers.max_registers"}
    assert problems[0].remedy == "allowed: 2 or more"


def test_the_homed_bit_must_be_mapped_to_be_read(tmp_path: Path) -> None:
    problem = refusal(tmp_path, edited(("bits.homed", "bits.alarm")), "axis.x.referenced", at="referenced")
    assert "registers.bits.homed" in problem.found


@pytest.mark.parametrize(
    "text", [GOOD + "safe_read = false\n", edited(("max_speed = 200.0", 'added_frames = "never"'))]
)
def test_a_homed_bit_that_may_not_be_read_is_warned_of(tmp_path: Path, text: str) -> None:
    warning = warning_of(tmp_path, text, "axis.x.referenced")
    assert "uncorrected until a controller reads" in warning.remedy


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ([("counts_per_unit = 1000.0", "counts_per_unit = 1000.0\nzero_counts = 4.6e18")], "zero_counts"),
        (
            [("counts_per_unit = 1000.0", "counts_per_unit = 1e12"), ("-300.0, 0.0", "-3e5, 0.0")],
            "counts_per_unit",
        ),
    ],
)
def test_counts_that_a_double_cannot_tell_are_refused(
    tmp_path: Path, changes: list[tuple[str, str]], key: str
) -> None:
    # 2^53 is some 9.007e15.
    text = edited(*changes, ('0x0606, type = "int32"', '0x0606, type = "int64"'))
    assert "beyond 2^53" in refusal(tmp_path, text, f"axis.x.{key}").found


def test_a_coarser_register_holds_more_travel(tmp_path: Path) -> None:
    # -300 000 counts / 10 counts a step = -30 000: fits an int16.
    text = edited(('0x0606, type = "int32", words = "low-first"', '0x0606, type = "int16", scale = 10.0'))
    assert loaded(tmp_path, text).plan.lines[0].axes[0].command[0].scale == 10.0


def test_reload_in_targets_is_warned_of(tmp_path: Path) -> None:
    warning_of(tmp_path, edited(("max_speed = 200.0", "reload = { distance = 1 }")), "axis.x.reload")


def test_backlash_and_homing_must_agree(tmp_path: Path) -> None:
    text = edited(
        (
            "max_speed = 200.0",
            'home_approach = "backward"\nbacklash = { width = 0.02, kind = "homed-forward" }',
        )
    )
    problem = refusal(tmp_path, text, "axis.x.backlash.kind", tables={"cnc10x.tab": ONE_WAY})
    assert 'home_approach = "backward"' in problem.found


def test_modulo_without_a_table_is_for_degrees(tmp_path: Path) -> None:
    text = edited(('table = "cnc10x.tab"', "modulo = 360.0"))
    assert 'units = "degree"' in refusal(tmp_path, text, "axis.x.modulo").remedy
    turning = edited(('units = "mm"', 'units = "degree"'), text=text)
    assert loaded(tmp_path, turning).plan.lines[0].axes[0].settings.modulo == 360.0


def test_a_turn_has_no_outside(tmp_path: Path) -> None:
    text = edited(
        ('table = "cnc10x.tab"', 'modulo = 360.0\noutside = "refuse"'), ('units = "mm"', 'units = "degree"')
    )
    assert refusal(tmp_path, text, "axis.x.outside").line == line_of(text, "outside")


def test_hysteresis_is_shorter_than_travel(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", "hysteresis = 300.0"))
    problems = refused(tmp_path, text)
    assert {problem.key for problem in problems} == {"axis.x.hysteresis"}
    assert {problem.line for problem in problems} == {line_of(text, "hysteresis")}


def test_no_travel_is_warned_of(tmp_path: Path) -> None:
    warning = warning_of(tmp_path, edited(("travel = [-300.0, 0.0]\n", "")), "axis.x")
    assert "travel = [lowest, highest]" in warning.remedy


STATUS_UNIT = """
[status_unit]
id = 250
"""


def test_the_gateway_has_a_unit_id_of_its_own_where_one_is_named(tmp_path: Path) -> None:
    assert loaded(tmp_path, GOOD).plan.status_unit == 0
    assert loaded(tmp_path, GOOD + STATUS_UNIT).plan.status_unit == 250


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (("unit_id = 1", "unit_id = 250"), "axis.x.unit_id"),
        (("[line.xyz]", "[line.xyz]\nother_units = [7, 250]"), "line.xyz.other_units[2]"),
    ],
    ids=["axis", "other device"],
)
def test_the_unit_id_of_the_gateway_is_that_of_no_drive(
    tmp_path: Path, change: tuple[str, str], key: str
) -> None:
    text = edited(change) + STATUS_UNIT
    problem = refusal(tmp_path, text, "status_unit.id")
    assert problem.line == line_of(text, "[status_unit]") + 1
    assert problem.found == f"250 is the unit id of a drive: {key} has it"
    assert problem.remedy == (
        "choose an id that no device of any line has, as 250: requests to it never reach a device"
    )


@pytest.mark.parametrize("value", [0, 255])
def test_the_unit_id_of_the_gateway_is_neither_the_broadcast_nor_the_device_itself(
    tmp_path: Path, value: int
) -> None:
    problem = refusal(tmp_path, GOOD + STATUS_UNIT.replace("250", str(value)), "status_unit.id")
    assert problem.remedy == "allowed: at least 1, at most 254"


@pytest.mark.parametrize(
    ("written", "asked"),
    [
        # A manual that counts from 40001 calls address 0x0606 = 1542 "register 41543".
        (
            "41543",
            "address = 41543: is that a manual's register number? Register 41543 has the address 0x0606",
        ),
        (
            "31543",
            "address = 31543: is that a manual's register number? Register 31543 has the address 0x0606",
        ),
        ("0xA247", None),  # 41543 too, and nobody numbers registers in hexadecimal
        ("0x0606", None),
        ("1542", None),
        ("50000", None),
    ],
)
def test_a_register_number_of_a_manual_is_asked_about(
    tmp_path: Path, written: str, asked: str | None
) -> None:
    text = GOOD.replace("command = [{ address = 0x0606", f"command = [{{ address = {written}")
    warnings = [each for each in loaded(tmp_path, text).warnings if "register number" in each.found]
    assert [each.found for each in warnings] == ([] if asked is None else [asked])
    for warning in warnings:
        assert warning.key == "axis.x.registers.command[1].address"
        assert warning.line == line_of(text, "command = [")
        assert "write 0x0606 if it is" in warning.remedy


@pytest.mark.parametrize(
    ("port", "used_by"),
    [(1500, "line.xyz.drives"), (1502, "line.xyz.controllers[2]")],
    ids=["drives", "through the gateway"],
)
@pytest.mark.parametrize("unit_id", [1, 2], ids=["a drive", "another unit id"])
def test_the_contact_is_at_no_address_of_a_line(
    tmp_path: Path, port: int, used_by: str, unit_id: int
) -> None:
    rtu = '{ rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }'
    good = edited((rtu, '{ tcp = "127.0.0.1:1500" }'))

    def text(port: int) -> str:
        device = f'{{ tcp = "localhost:{port}" }}'
        return f"{good}\n[alarm_output]\ndevice = {device}\nunit_id = {unit_id}\ncoil = 0\n"

    problem = refusal(tmp_path, text(port), "alarm_output.device", at="device")
    assert problem.found == f"localhost:{port} is already used by {used_by}"
    loaded(tmp_path, text(502))


@pytest.mark.parametrize("name", ["ttyB", "ttyOther"], ids=["one name", "two names of one port"])
def test_the_contact_is_at_no_serial_port_of_a_line(tmp_path: Path, name: str) -> None:
    (tmp_path / "ttyOther").symlink_to(tmp_path / "ttyB")
    good = edited(("/dev/serial/by-id/usb-B", str(tmp_path / "ttyB")))

    def text(name: str) -> str:
        device = f'{{ rtu = "{tmp_path}/{name}", baudrate = 9600 }}'
        return f"{good}\n[alarm_output]\ndevice = {device}\ncoil = 0\n"

    problem = refusal(tmp_path, text(name), "alarm_output.device", at="device")
    assert problem.found == f"{tmp_path}/{name} is already used by line.xyz.drives"
    loaded(tmp_path, text("ttyC"))


@pytest.mark.parametrize(
    ("device", "is_allowed"),
    [
        ('{ rtu = "/dev/ttyS3" }', False),
        ('{ rtu_over_tcp = "192.168.0.50:4001" }', False),
        ('{ tcp = "192.168.0.50:502" }', True),
    ],
)
def test_the_contact_is_not_at_all_devices_of_a_serial_line(
    tmp_path: Path, device: str, is_allowed: bool
) -> None:
    text = f"{edited()}\n[alarm_output]\ndevice = {device}\nunit_id = 0\ncoil = 0\n"
    if is_allowed:
        loaded(tmp_path, text)
        return
    problem = refusal(tmp_path, text, "alarm_output.unit_id", at="unit_id = 0")
    assert problem.found == "found 0, which on RTU is all devices, and none replies"


@pytest.mark.parametrize(
    ("device", "rule"),
    [
        ("{ }", "allowed: exactly one of rtu, tcp, rtu_over_tcp"),
        (
            '{ tcp = "192.168.0.50:502", rtu = "/dev/ttyS3" }',
            "allowed: exactly one of rtu, tcp, rtu_over_tcp",
        ),
        (
            '{ tcp = "192.168.0.50:502", baudrate = 9600 }',
            "baudrate belong to a serial port (rtu): leave out beside tcp",
        ),
    ],
)
def test_the_device_of_the_contact_is_one(tmp_path: Path, device: str, rule: str) -> None:
    text = f"{edited()}\n[alarm_output]\ndevice = {device}\ncoil = 0\n"
    problem = refusal(tmp_path, text, "alarm_output.device", at="device")
    assert problem.remedy == rule


GPIO = '[alarm_output]\ngpio = { chip = "/dev/gpiochip0", line = 17 }\n'


@pytest.mark.parametrize(
    ("keys", "rule"),
    [
        ("every_s = 1.0", "allowed: exactly one of device, gpio"),
        (
            'device = { tcp = "192.168.0.50:502" }\ngpio = { chip = "/dev/gpiochip0", line = 17 }\ncoil = 0',
            "allowed: exactly one of device, gpio",
        ),
        ('device = { tcp = "192.168.0.50:502" }', "needed: coil, the coil of the contact: 1 closes it"),
        (
            'gpio = { chip = "/dev/gpiochip0", line = 17 }\ncoil = 0',
            "coil belongs to device: leave out beside gpio",
        ),
        (
            'gpio = { chip = "/dev/gpiochip0", line = 17 }\ncoil = 0\nunit_id = 1',
            "unit_id, coil belong to device: leave out beside gpio",
        ),
    ],
)
def test_a_contact_is_a_coil_or_a_line(tmp_path: Path, keys: str, rule: str) -> None:
    problem = refusal(tmp_path, f"{edited()}\n[alarm_output]\n{keys}\n", "alarm_output", at="[alarm_output]")
    assert problem.remedy == rule


@pytest.mark.parametrize(
    ("chip", "line", "key", "remedy"),
    [
        ('"gpiochip0"', "17", "chip", 'allowed: the full path of a GPIO chip, as in "/dev/gpiochip0"'),
        ("0", "17", "chip", 'allowed: the full path of a GPIO chip, as in "/dev/gpiochip0"'),
        ('"/dev/gpiochip0"', "-1", "line", "allowed: at least 0, at most 65535"),
    ],
)
def test_a_line_is_a_chip_and_a_number(tmp_path: Path, chip: str, line: str, key: str, remedy: str) -> None:
    text = f"{edited()}\n[alarm_output]\ngpio = {{ chip = {chip}, line = {line} }}\n"
    assert refusal(tmp_path, text, f"alarm_output.gpio.{key}", at="gpio = {").remedy == remedy


def test_a_line_needs_the_package_of_libgpiod(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = f"{edited()}\n{GPIO}"
    section = loaded(tmp_path, text).sections.alarm_output
    assert section is not None
    assert section.gpio is not None
    assert (section.gpio.chip, section.gpio.line, section.gpio.active_low) == ("/dev/gpiochip0", 17, False)
    for module, why in (
        (None, "the Python package gpiod is not installed"),
        (ModuleType("gpiod"), "the Python package gpiod is older than version 2"),
    ):
        monkeypatch.setitem(sys.modules, "gpiod", module)
        problem = refusal(tmp_path, text, "alarm_output.gpio", at="gpio")
        assert problem.found == why
        assert problem.remedy == "pip install 'pitch-gateway[gpio]' where pitch-gateway is installed"
