"""Many coils in one frame: a jog or a start coil that is let go of stops nothing that the frame starts."""

import pytest

from gateway.exchange.axis.reference import ReferenceState
from gateway.exchange.plan import ControllerPlan, Reference, Role
from tests.drives.test_public_traffic import Machine
from tests.exchange.line_bench import Port

DRIVE_IMAGE = "0F 0018 0007 01 06"
"""LEC: servo on (0x19) and DRIVE (0x1A), HOLD, RESET, SETUP and both jogs off."""
SETUP_IMAGE = "0F 0019 0006 01 09"
"""LEC: servo on and SETUP (0x1C)."""
START_0 = "0F 0418 0008 01 80"
"""IAI: the start coil of position 0 (0x041F), those of 1 to 7 off."""


def frame(text: str) -> bytes:
    return bytes.fromhex(text)


@pytest.mark.parametrize(
    ("drive", "pdu"),
    [
        ("smc-lec", DRIVE_IMAGE),
        ("smc-lec", "0F 001A 0005 01 01"),  # DRIVE, both jogs off
        ("iai-robo-cylinder", START_0),
        ("iai-robo-cylinder", "0F 0416 000A 02 00 02"),  # the same with both jogs off
    ],
)
def test_m9_a_stored_move_is_refused_among_coils_that_are_let_go_of(drive: str, pdu: str) -> None:
    machine = Machine(drive)
    assert machine.ask(frame(pdu)) == bytes((0x8F, 4))
    assert frame(pdu) not in machine.seen


@pytest.mark.parametrize(
    ("drive", "pdu"),
    [
        ("smc-lec", "0F 001D 0002 01 02"),  # jog forward, backward off
        ("smc-lec", "0F 001A 0005 01 01"),
        ("iai-robo-cylinder", "0F 0416 0002 01 01"),
        ("iai-robo-cylinder", START_0),
    ],
)
def test_m3_what_starts_a_move_is_no_stop_for_an_operator(drive: str, pdu: str) -> None:
    machine = Machine(drive)
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    machine.send(frame(pdu), operator)
    machine.serve()
    assert operator.take() == bytes((0x8F, 1))
    assert frame(pdu) not in machine.seen


@pytest.mark.parametrize(
    ("drive", "pdu"),
    [
        ("smc-lec", "05 001D 0000"),
        ("smc-lec", "0F 001D 0002 01 00"),
        ("iai-robo-cylinder", "05 0416 0000"),
        ("iai-robo-cylinder", "0F 0416 000A 02 00 00"),
    ],
)
def test_m3_letting_go_alone_is_a_stop_for_everybody(drive: str, pdu: str) -> None:
    machine = Machine(drive)
    operator = Port(ControllerPlan("panel", role=Role.OPERATOR))
    machine.send(frame(pdu), operator)
    machine.serve()
    assert operator.take() == frame(pdu)[:5]
    assert frame(pdu) in machine.seen


def test_m3_servo_off_is_a_stop_whatever_else_the_frame_sets() -> None:
    machine = Machine("smc-lec")
    off = frame("0F 0018 0007 01 04")  # DRIVE on, servo on taken away
    assert machine.ask(off) == off[:5]
    assert machine.seen[-1] == off


def test_m9_homing_is_seen_among_coils_that_are_let_go_of() -> None:
    machine = Machine("smc-lec", referenced=Reference.HOMING)
    assert machine.ask(frame(SETUP_IMAGE)) == frame(SETUP_IMAGE)[:5]
    [axis] = machine.line.axes
    assert axis.reference.state is ReferenceState.HOMING
