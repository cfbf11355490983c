"""Baud rates that are none, unit ids that a drive cannot have, two controllers that would move one axis."""

from pathlib import Path

import pytest

from gateway.config.checks.lines import USUAL_RATES
from gateway.drives import library
from tests.config.config_bench import GOOD, edited, line_of, loaded

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
