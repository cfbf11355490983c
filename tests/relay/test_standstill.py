"""A relay that stood still sends nothing that its controllers gave up meanwhile, but for stops (W5)."""

import signal
import socket
import time
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.exchange.line_bench import write
from tests.relay.test_kill_and_restart import COMMAND
from tests.relay.test_kills_at_any_instant import Machine, machine

STOP = bytes.fromhex("06 0082 0008")
PATIENCE_S = 1.0
"""The controller's ``timeout_ms``."""


def stopped(each: Machine, seconds: float, frames: list[bytes], *, closes: bool) -> None:
    """Stop the relay, send frames, wait, close or not, and let it go on."""
    assert each.process is not None
    assert each.connection is not None
    each.process.send_signal(signal.SIGSTOP)
    for number, frame in enumerate(frames):
        each.connection.sendall(encode_mbap(number, 1, frame))
    time.sleep(seconds)  # as long as the controller waits
    if closes:
        each.connection.close()
    each.process.send_signal(signal.SIGCONT)


def wait_for(each: Machine, words: str) -> None:
    """Wait for words in the log, which is written by and by."""
    until_s = time.monotonic() + 30.0
    while words not in each.log.read_text():
        assert time.monotonic() < until_s
        time.sleep(0.01)


def again(each: Machine) -> list[bytes]:
    """Connect anew, ask something, and return every write that the drive got so far."""
    if each.connection is not None:
        each.connection.close()
    time.sleep(0.05)  # who comes just now may have come while nobody looked, and is sent away
    each.connection = socket.create_connection(("127.0.0.1", each.port), timeout=20)
    for number in (98, 99):
        each.connection.sendall(encode_mbap(number, 1, bytes.fromhex("03 0078 0001")))
        assert each.connection.recv(11, socket.MSG_WAITALL)[1] == number
    return each.drive.writes


@pytest.mark.parametrize("closes", [True, False])
def test_w5_what_waited_longer_than_its_controller_is_not_sent(tmp_path: Path, closes: bool) -> None:
    with machine(tmp_path, None, "homing") as each:
        assert each.follow(50_000)
        before = len(each.drive.writes)
        frames = [write(COMMAND, 90_000), STOP, write(COMMAND, 91_000)]
        stopped(each, PATIENCE_S + 0.4, frames, closes=closes)
        if not closes:
            assert each.connection is not None
            while each.connection.recv(300):  # whatever it says, it ends
                pass
        assert again(each)[before:] == [STOP]
        wait_for(each, "the relay stood still for 1.")


def test_w5_what_its_controller_has_closed_behind_it_is_not_sent(tmp_path: Path) -> None:
    with machine(tmp_path, None, "homing") as each:
        assert each.follow(50_000)
        before = len(each.drive.writes)
        stopped(each, 0.3, [write(COMMAND, 90_000), STOP], closes=True)
        assert again(each)[before:] == [STOP]
        wait_for(each, "its controller closed the connection")


def test_a_short_standstill_delays_and_loses_nothing(tmp_path: Path) -> None:
    with machine(tmp_path, None, "homing") as each:
        assert each.follow(50_000)
        before = len(each.drive.writes)
        stopped(each, 0.3, [write(COMMAND, 50_040)], closes=False)
        assert each.connection is not None
        assert each.connection.recv(12, socket.MSG_WAITALL)[7:8] == b"\x10"
        assert [pdu[0] for pdu in each.drive.writes[before:]] == [16]
        assert "stood-still" not in each.log.read_text()
