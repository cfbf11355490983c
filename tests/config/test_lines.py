"""Baud rates, unit ids, controllers that would move one axis, and limits that no line can meet."""

from pathlib import Path

import pytest

from gateway.config.checks.lines import USUAL_RATES
from gateway.drives import library
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused

SECOND = """
[[line.xyz.controllers]]
name = "panel"
tcp = "127.0.0.1:1503"
"""


@pytest.mark.parametrize(
    ("where", "key"),
    [
        ("baudrate = 115200, parity", "line.xyz.drives.baudrate"),
        ("baudrate = 38400", "line.xyz.controllers[1].baudrate"),
    ],
)
def test_a_baud_rate_that_is_none_is_named_with_the_nearest(tmp_path: Path, where: str, key: str) -> None:
    wrong = where.replace("115200", "115000").replace("38400", "115000")
    [warning] = [each for each in loaded(tmp_path, edited((where, wrong))).warnings if "baudrate" in each.key]
    assert warning.key == key
    assert warning.found == "115000 is not a baud rate of any device"
    assert warning.remedy == "see the manual of the device; the nearest usual one is 115200"


@pytest.mark.parametrize("name", library.names())
def test_the_rate_of_every_shipped_drive_is_one(name: str) -> None:
    rate = library.shipped(name).serial.baudrate
    assert rate is None or rate in USUAL_RATES


DRIVEN = """
[line.a]
drives = {{ rtu = "/dev/ttyUSB7", baudrate = 115200 }}
[[line.a.controllers]]
name = "plc"
tcp = "127.0.0.1:1510"
[axis.y]
line = "a"
unit_id = {unit_id}
drive = "oriental-az"
units = "mm"
counts_per_unit = 1000
travel = [0, 100]
referenced = "drive-bit"
compensation = "on"
"""


@pytest.mark.parametrize(("unit_id", "is_told"), [(1, False), (31, False), (32, True)])
def test_a_unit_id_that_the_drive_cannot_have_is_named(tmp_path: Path, unit_id: int, is_told: bool) -> None:
    text = GOOD + DRIVEN.format(unit_id=unit_id)
    found = [each for each in loaded(tmp_path, text).warnings if each.key == "axis.y.unit_id"]
    assert len(found) == is_told
    if is_told:
        assert found[0].line == line_of(text, "unit_id = 32")
        assert found[0].found == "oriental-az accepts unit ids 1 to 31, not 32"


@pytest.mark.parametrize("name", library.names())
def test_the_range_of_a_profile_is_what_its_words_say(name: str) -> None:
    profile = library.shipped(name)
    if profile.unit_id_range is not None:
        lowest, highest = profile.unit_id_range
        assert f"{lowest} to {highest}" in profile.unit_ids


def two_movers(tmp_path: Path, changes: str = "", axis: str = "") -> list[str]:
    text = GOOD.replace("[axis.x]\n", f"{SECOND}{changes}\n[axis.x]\n{axis}\n")
    return [each.found for each in loaded(tmp_path, text).warnings if "may each move" in each.found]


def test_two_motion_controllers_of_one_axis_are_named(tmp_path: Path) -> None:
    assert two_movers(tmp_path) == [
        "cnc and panel may each move axis x: while one does, the other is refused"
    ]


@pytest.mark.parametrize(
    ("changes", "axis"),
    [
        ('role = "monitor"', ""),
        ('role = "operator"', ""),
        ("read_only = true", ""),
        ("unit_ids = [7]", ""),
        ("", 'writers = "any"'),
    ],
)
def test_one_that_cannot_move_it_or_where_all_are_meant_to_is_none(
    tmp_path: Path, changes: str, axis: str
) -> None:
    assert two_movers(tmp_path, changes, axis) == []


ALONE = "accepts only IPv6 connections"


def listening_at(*addresses: str) -> str:
    """Return the configuration with its second controller at the first address, and more at the others."""
    more = "".join(
        f'\n[[line.xyz.controllers]]\nname = "more-{number}"\ntcp = "{address}"\n'
        for number, address in enumerate(addresses[1:])
    )
    return edited(("127.0.0.1:1502", addresses[0])) + more


@pytest.mark.parametrize(
    ("addresses", "key"),
    [
        (("[::]:1502",), "line.xyz.controllers[2].tcp"),
        (("[0:0::0]:1502",), "line.xyz.controllers[2].tcp"),
        (("127.0.0.1:1502", "[::]:1503"), "line.xyz.controllers[3].tcp"),
        (("0.0.0.0:1503", "[::]:1502"), "line.xyz.controllers[3].tcp"),
        # Both, as the remedy has it; IPv4 alone; or what nobody takes for all addresses.
        (("[::]:1502", "0.0.0.0:1502"), None),
        (("0.0.0.0:1502", "[::]:1502"), None),
        (("0.0.0.0:1502",), None),
        (("[::1]:1502",), None),
        (("[2001:db8::1]:1502",), None),
    ],
)
def test_who_listens_on_all_ipv6_addresses_learns_that_these_are_not_all(
    tmp_path: Path, addresses: tuple[str, ...], key: str | None
) -> None:
    warnings = loaded(tmp_path, listening_at(*addresses)).warnings
    found = [warning for warning in warnings if ALONE in warning.found]
    assert [warning.key for warning in found] == ([] if key is None else [key])
    if found:
        port = next(address for address in addresses if address.startswith("[0") or "::]" in address)[-4:]
        assert f'tcp = "0.0.0.0:{port}"' in found[0].remedy


# Limits that no line can meet are errors of ``check``, with the sum; those that are close are warnings.


SLOW = edited(("baudrate = 115200", "baudrate = 9600"), ("baudrate = 38400", "baudrate = 9600"))
"""Drives 9600 8E1 (11 bits), controller 9600 8N1 (10 bits)."""


def with_timeout(timeout_ms: float) -> str:
    return edited(
        (
            '[[line.xyz.controllers]]\nname = "cnc"',
            f'[[line.xyz.controllers]]\nname = "cnc"\ntimeout_ms = {timeout_ms}',
        ),
        text=SLOW,
    )


def test_a_time_out_that_no_gateway_can_meet_is_refused_with_the_sum(tmp_path: Path) -> None:
    text = with_timeout(32.0)
    problem = refusal(tmp_path, text, "line.xyz.controllers[1].timeout_ms", at="timeout_ms = 32")
    # 13 × 11 / 9600 + 8 × 11 / 9600 + 8 × 10 / 9600 = 32.396 ms, and 1 ms for the gateway.
    assert problem.found == (
        "timeout_ms = 32, but the reply to write target of axis x comes 33.4 ms after its request "
        "(1.00 gateway + 14.9 to the drive + 9.17 from the drive + 8.33 to the controller)"
    )
    # Then the reading is the longest: 3.5 × 10 / 9600 of silence and 9 × 10 / 9600 back.
    assert problem.remedy.startswith("drives at 115200 Bd: from 33.4 to 13.0 ms; ")


# With the read of the position for the direction, 23.490 ms: 56.885 ms.
@pytest.mark.parametrize(("timeout_ms", "warned"), [(33.0, True), (56.8, True), (56.9, False)])
def test_a_time_out_that_is_close_is_warned_of(tmp_path: Path, timeout_ms: float, warned: bool) -> None:
    found = [
        each for each in loaded(tmp_path, with_timeout(timeout_ms)).warnings if "controllers[1]" in each.key
    ]
    assert len(found) == warned


def test_a_deadline_that_cannot_be_met_is_refused(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", "deadline_ms = 0.5"))
    problem = refusal(tmp_path, text, "axis.x.deadline_ms", at="deadline_ms")
    assert "1.00 ms after it came (1.00 gateway (budget_us))" in problem.found
    faster = edited(("max_speed = 200.0", "deadline_ms = 5\nbudget_us = 400"))
    assert loaded(tmp_path, faster).warnings == ()


def test_one_silent_drive_on_a_line_of_two_is_warned_of_with_the_defaults(tmp_path: Path) -> None:
    second = GOOD[GOOD.index("[axis.x]") :].replace("axis.x", "axis.y").replace("unit_id = 1", "unit_id = 2")
    text = GOOD + second.replace('table = "cnc10x.tab"\ncompensation = "on"\n', "")
    [warning] = loaded(tmp_path, text).warnings
    assert (warning.key, warning.line) == (
        "line.xyz.controllers[1].timeout_ms",
        line_of(text, 'name = "cnc"') - 1,
    )
    assert "1000 response_timeout_ms + 1000 drain_ms" in warning.found


def test_a_line_with_other_problems_is_not_reckoned_with(tmp_path: Path) -> None:
    text = edited(("unit_id = 1", "unit_id = 300"), text=with_timeout(32.0))
    refusal(tmp_path, text, "axis.x.unit_id")
    text = edited(("baudrate = 9600, ", "baudrate = 1, "), text=with_timeout(32.0))
    refusal(tmp_path, text, "line.xyz.drives.baudrate")


def test_a_good_line_is_reckoned_with_beside_a_bad_one(tmp_path: Path) -> None:
    text = with_timeout(32.0) + '\n[line.b]\ndrives = { tcp = "no address" }\ncontrollers = []\n'
    keys = [problem.key for problem in refused(tmp_path, text)]
    assert "line.xyz.controllers[1].timeout_ms" in keys
    assert "line.b.drives.tcp" in keys


def test_a_gap_that_only_a_pause_makes_room_for_is_warned_of_with_the_sum(tmp_path: Path) -> None:
    """Drives on TCP that want 60 ms: each exchange behind another waits for them."""
    text = edited(
        (
            'drives = { rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }',
            'drives = { tcp = "10.0.0.2:502" }\ngap_ms = 60',
        ),
        ('name = "hmi"', 'name = "hmi"\ntimeout_ms = 50'),
    )
    key = "line.xyz.controllers[2].timeout_ms"
    # The display may also have to wait for motion: that is another warning of the same key.
    [problem] = [
        each for each in loaded(tmp_path, text).warnings if each.key == key and "reply" in each.found
    ]
    assert problem.line == line_of(text, "timeout_ms = 50")
    # The display on TCP: half of the gateway's 1 ms hides on the way back, half on the way there.
    assert problem.found == (
        "timeout_ms = 50, and the reply to read position of axis x comes 60.0 ms after its request "
        "(1.00 gateway + 59.0 silence since the exchange before)"
    )
    assert problem.remedy.endswith("let the controller wait longer than 61 ms, if it can")
    good = loaded(tmp_path, text.replace("timeout_ms = 50", "timeout_ms = 60"))
    assert not [each for each in good.warnings if each.key == key and "reply" in each.found]
