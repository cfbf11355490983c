"""Limits that no line can meet are errors of ``check``, with the sum; those that are close are warnings."""

from pathlib import Path

import pytest

from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused

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
