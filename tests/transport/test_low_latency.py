"""What makes bytes wait in a serial driver: read, lowered, read back, and said.

The folder tree of the kernel is built of real files under the number of a real pseudo terminal, whose driver
knows none of the ioctls. Values: Linux 6 sysfs and ``linux/serial.h``.
"""

import fcntl
import os
import struct
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from gateway.status.line import LatencySettings, Rs485
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import RefusedError
from gateway.transport.low_latency import flag_note, remarks, set_rs485, tty_folder, tune
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from tests.support.lesser import nobody
from tests.support.status_models import plain

NOBODY = 65534
KEYS = ("ftdi_latency_timer_ms", "async_low_latency", "rx_trig_bytes", "rs485")


@dataclass
class Tree:
    """An open terminal, and the kernel's folder of it: ``dev/char/MAJ:MIN`` leads to ``…/tty/ttyUSB0``."""

    handle: int
    sysfs: Path
    port: Path

    @property
    def timer(self) -> Path:
        return self.port / "latency_timer"

    @property
    def trigger(self) -> Path:
        return self.port / "tty" / "ttyUSB0" / "rx_trig_bytes"

    def tuned(self, *, is_low: bool = True) -> tuple[LatencySettings, tuple[str, ...]]:
        return tune(self.handle, is_low=is_low, sysfs=self.sysfs)


@pytest.fixture
def tree() -> Iterator[Tree]:
    with tempfile.TemporaryDirectory() as folder:  # not tmp_path: nobody else may look into that
        sysfs = Path(folder)
        sysfs.chmod(0o755)
        master, handle = os.openpty()
        port = sysfs / "devices" / "usb1" / "1-1:1.0" / "ttyUSB0"
        tty = port / "tty" / "ttyUSB0"
        tty.mkdir(parents=True)
        (tty / "device").symlink_to("../..")
        number = os.fstat(handle).st_rdev
        link = sysfs / "dev" / "char" / f"{os.major(number)}:{os.minor(number)}"
        link.parent.mkdir(parents=True)
        link.symlink_to(f"../../{tty.relative_to(sysfs)}")
        yield Tree(handle, sysfs, port)
        os.close(master)
        os.close(handle)


def test_a_port_without_any_of_it_has_nothing_and_costs_nothing(tree: Tree) -> None:
    assert tree.tuned() == (LatencySettings(None, None, None, None), ())
    assert not tree.timer.exists()
    assert not tree.trigger.exists()


def test_a_terminal_that_the_kernel_shows_nowhere_is_no_error(tmp_path: Path, tree: Tree) -> None:
    assert tune(tree.handle, sysfs=tmp_path) == (LatencySettings(), ())


@pytest.mark.parametrize(
    ("is_low", "before", "after"), [(True, (16, 8), (1, 1)), (False, (16, 14), (16, 14))]
)
def test_an_ftdi_timer_and_a_fifo_trigger_are_lowered_and_read_back_or_left_alone(
    tree: Tree, before: tuple[int, int], after: tuple[int, int], *, is_low: bool
) -> None:
    files = tree.timer, tree.trigger
    for file, value in zip(files, before, strict=True):
        file.write_text(f"{value}\n")
    settings, slow = tree.tuned(is_low=is_low)
    assert (settings.ftdi_latency_timer_ms, settings.rx_trig_bytes) == after
    assert slow == ()
    assert tuple(file.read_text() for file in files) == tuple(f"{value}\n" for value in after)


def test_what_is_low_already_is_not_written(tree: Tree) -> None:
    tree.timer.write_text("1\n")
    tree.timer.chmod(0o444)
    before_ns = tree.timer.stat().st_mtime_ns
    with nobody():
        assert tree.tuned()[1] == ()
    assert tree.timer.stat().st_mtime_ns == before_ns


def test_without_permission_the_value_stays_and_the_rule_for_udev_is_said(tree: Tree) -> None:
    tree.timer.write_text("16\n")
    tree.trigger.write_text("8\n")
    for path in (tree.timer, tree.trigger):
        path.chmod(0o444)
    with nobody():
        settings, (timer, trigger) = tree.tuned()
    assert (settings.ftdi_latency_timer_ms, settings.rx_trig_bytes) == (16, 8)
    assert timer.startswith(
        "ftdi latency timer is 16 ms: each reply waits up to 16 ms in the adapter"
        " (setting it: Permission denied); let udev set it: "
    )
    assert 'DRIVER=="ftdi_sio", ATTR{latency_timer}="1"' in timer
    assert trigger.startswith("rx_trig_bytes is 8: ")
    assert "(setting it: Permission denied)" in trigger
    assert 'KERNEL=="ttyUSB0", ATTR{rx_trig_bytes}="1"' in trigger


def test_a_trigger_that_only_root_may_read_is_said_to_be_unknown(tree: Tree) -> None:
    """As older kernels have it, mode 0640."""
    tree.trigger.write_text("8\n")
    tree.trigger.chmod(0o600)
    with nobody():
        if os.access(tree.trigger, os.R_OK, effective_ids=True):
            tree.trigger.chmod(0)  # it is nobody's own file where the tests do not run as root
        settings, [said] = tree.tuned()
    assert settings.rx_trig_bytes is None
    assert said.startswith(
        "rx_trig_bytes is unknown; the default is 8 (setting it: Permission denied); let udev"
    )
    assert tree.trigger.stat().st_size == 2


def test_a_value_that_was_set_and_is_not_low_has_no_rule_as_its_remedy() -> None:
    """A 16650 has no trigger below 8: the kernel takes the nearest and shows it."""
    [timer, trigger] = remarks(LatencySettings(ftdi_latency_timer_ms=2, rx_trig_bytes=8), "ttyS1")
    assert timer.startswith("ftdi latency timer is 2 ms: each reply waits up to 2 ms in the adapter")
    assert timer.endswith("(the driver accepts no lower value)")
    assert trigger.endswith("(the driver accepts no lower value)")
    assert "udev" not in trigger


def test_a_value_that_the_kernel_will_not_show_counts_as_none(tree: Tree) -> None:
    """A UART without a FIFO answers a read of its trigger with EINVAL; so does a folder in its place here."""
    tree.trigger.mkdir()
    tree.timer.write_text("not a number\n")
    settings, slow = tree.tuned()
    assert (settings.ftdi_latency_timer_ms, settings.rx_trig_bytes, slow) == (None, None, ())


def test_the_folder_is_found_through_any_link_to_the_device(tree: Tree, tmp_path: Path) -> None:
    link = tmp_path / "usb-FTDI_A-if00-port0"
    link.symlink_to(os.ttyname(tree.handle))
    again = os.open(link, os.O_RDWR | os.O_NOCTTY)
    assert tty_folder(again, tree.sysfs).resolve() == (tree.port / "tty" / "ttyUSB0").resolve()
    os.close(again)


def test_a_delay_of_the_kernels_rs485_is_remarked_on() -> None:
    quiet = Rs485(True, True, False, False, 0, 0)
    assert list(remarks(LatencySettings(rs485=quiet), "ttyS1")) == []
    late = Rs485(True, True, False, False, 0, 5)
    [said] = remarks(LatencySettings(rs485=late), "ttyS1")
    assert "the kernel keeps the RS-485 line for 5 ms after each frame" in said
    off = Rs485(False, True, False, False, 0, 5)
    assert list(remarks(LatencySettings(rs485=off), "ttyS1")) == []


def test_a_flag_that_was_not_taken_is_noted_and_costs_nothing() -> None:
    assert flag_note(LatencySettings(async_low_latency=True)) == ""
    assert flag_note(LatencySettings(async_low_latency=False)) == "the driver has no low-latency mode"
    assert list(remarks(LatencySettings(async_low_latency=False), "ttyACM0")) == []


def test_settings_as_plain_data_have_every_key() -> None:
    assert plain(LatencySettings()) == dict.fromkeys(KEYS)
    full = plain(LatencySettings(1, True, 1, Rs485(True, True, False, True, 2, 3)))
    assert full == {
        "ftdi_latency_timer_ms": 1,
        "async_low_latency": True,
        "rx_trig_bytes": 1,
        "rs485": {
            "enabled": True,
            "rts_on_send": True,
            "rts_after_send": False,
            "rx_during_tx": True,
            "delay_before_send_ms": 2,
            "delay_after_send_ms": 3,
        },
    }


async def test_a_pseudo_terminal_is_open_with_nothing_to_report() -> None:
    cable = NullModem()
    said: list[str] = []
    receiver = _Nobody()
    port = SerialPort(SerialEndpoint(cable.near), receiver, said.append, said.append)
    await port.open()
    assert port.latency == LatencySettings()
    assert port.notes == ("a pseudo terminal has no low-latency mode",)
    assert said == []
    await port.close()
    cable.close()


async def test_a_port_to_be_left_alone_opens_like_any_other() -> None:
    cable = NullModem()
    port, opened = open_port(SerialEndpoint(cable.near, low_latency=False))
    assert opened.settings == LatencySettings()
    port.close()
    cable.close()


class _Nobody:
    def opened(self, channel: object, now_ns: int) -> None: ...
    def received(self, data: bytes, now_ns: int) -> None: ...
    def closed(self, reason: str, now_ns: int) -> None: ...


async def test_what_is_slow_is_said_once_until_it_changes() -> None:
    said: list[str] = []
    port = SerialPort(SerialEndpoint("/dev/ttyNONE"), _Nobody(), said.append, said.append)
    for slow in (("timer",), ("timer",), (), (), ("timer", "trigger")):
        port._report_slow(slow)
    assert said == ["timer", "timer; trigger"]


async def test_a_driver_without_rs485_mode_refuses_it_and_says_what_to_do() -> None:
    cable = NullModem()
    try:
        with pytest.raises(RefusedError, match=rf"driver of {cable.near} has no RS-485 mode: remove rs485"):
            open_port(SerialEndpoint(cable.near, 19200, rs485=True))
        port, _ = open_port(SerialEndpoint(cable.near, 19200))  # it was given back
        port.close()
    finally:
        cable.close()


class Driver:
    """A driver with an RS-485 mode: what it was told last, and what it makes of that."""

    def __init__(self, content: bytes, *, takes: bool = True) -> None:
        self.content = content
        self.takes = takes

    def ioctl(self, handle: int, number: int, argument: bytearray | bytes) -> int:
        if number == 0x542F:  # TIOCSRS485
            self.content = bytes(argument) if self.takes else self.content
        elif number == 0x542E and isinstance(argument, bytearray):  # TIOCGRS485
            argument[:] = self.content
        return 0


def test_the_rs485_mode_is_set_and_its_delays_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    # RTS after sending (4), 1 ms before and 2 ms behind a frame, and a word that is not ours.
    driver = Driver(struct.pack("=8I", 0x04, 1, 2, 0, 0, 0, 0, 9))
    monkeypatch.setattr(fcntl, "ioctl", driver.ioctl)
    found = set_rs485(3, hears_itself=False)
    assert driver.content == struct.pack("=8I", 0x03, 1, 2, 0, 0, 0, 0, 9)  # enabled, RTS on send
    assert found == Rs485(True, True, False, False, 1, 2)
    assert set_rs485(3, hears_itself=True) == Rs485(True, True, False, True, 1, 2)


def test_a_driver_that_takes_the_mode_and_does_nothing_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fcntl, "ioctl", Driver(bytes(32), takes=False).ioctl)
    found = set_rs485(3, hears_itself=False)
    assert found is not None
    assert not found.enabled
