"""Serial ports, on pseudo terminals: adapters that come and go, and ports that cannot be had."""

import asyncio
import fcntl
import os
import tempfile
import termios
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from gateway.status.line import LatencySettings
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint
from gateway.transport.errors import AbsentError, RefusedError
from gateway.transport.null_modem import NullModem
from gateway.transport.serial import SerialPort
from gateway.transport.serial_channel import character_ns
from tests.support.lesser import nobody

if TYPE_CHECKING:
    from tests.transport.conftest import Eventually, Recorder


NOBODY = 65534


def ignore(why: str) -> None:
    pass


def test_a_character_takes_eleven_bits_with_parity() -> None:
    # 11 / 9600 = 1.145833 ms
    assert character_ns(SerialEndpoint("x", 9600, "E")) == 1_145_833
    assert character_ns(SerialEndpoint("x", 115200, "N")) == 86_805  # 10 bits


async def test_a_pseudo_terminal_that_ignores_parity_is_taken_and_reported() -> None:
    cable = NullModem()
    port, opened = open_port(SerialEndpoint(cable.near, 38400, "E"))
    assert any("parity" in note for note in opened.notes)
    assert any("low-latency" in note for note in opened.notes)
    assert opened.settings == LatencySettings()
    assert opened.slow == ()
    port.close()
    cable.close()


async def test_a_port_is_raw_and_blocks_nobody() -> None:
    cable = NullModem()
    port, _ = open_port(SerialEndpoint(cable.near))
    lflag = termios.tcgetattr(port.fileno())[3]
    assert not lflag & (termios.ICANON | termios.ECHO | termios.ISIG)
    with pytest.raises(BlockingIOError):
        os.read(port.fileno(), 1)  # nothing there is not the end
    port.close()
    cable.close()


async def test_a_port_is_opened_once_only() -> None:
    cable = NullModem()
    port, _ = open_port(SerialEndpoint(cable.near))
    with pytest.raises(RefusedError, match="in use by another program"):
        open_port(SerialEndpoint(cable.near))
    port.close()
    again, _ = open_port(SerialEndpoint(cable.near))
    again.close()
    cable.close()


def test_a_missing_device_is_absent(tmp_path: Path) -> None:
    with pytest.raises(AbsentError, match="ttyNONE is not there"):
        open_port(SerialEndpoint(str(tmp_path / "ttyNONE")))


@pytest.mark.parametrize("kind", ["file", "folder", "null"])
def test_what_is_no_serial_port_is_named(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "thing"
    if kind == "file":
        path.write_text("no port")
    elif kind == "folder":
        path.mkdir()
    else:
        path = Path("/dev/null")
    with pytest.raises(RefusedError, match="is not a serial port"):
        open_port(SerialEndpoint(str(path)))


def test_no_permission_is_named() -> None:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        path = Path(folder) / "ttyX"
        path.write_text("")
        path.chmod(0)
        with nobody(), pytest.raises(RefusedError, match="no permission"):
            open_port(SerialEndpoint(str(path)))


async def test_an_adapter_that_comes_later_is_opened(
    make_recorder: "type[Recorder]", eventually: "Eventually", tmp_path: Path
) -> None:
    near = make_recorder()
    failures: list[str] = []
    link = tmp_path / "by-id"
    port = SerialPort(SerialEndpoint(str(link)), near, failures.append)
    await port.open()
    assert "by-id is not there" in failures[0]
    assert port.failure == failures[0]
    cable = NullModem()
    link.symlink_to(cable.near)
    await near.until(lambda end: end.opens == 1)
    await eventually(lambda: not port.failure)
    await port.close()
    cable.close()


async def test_an_adapter_in_another_socket_is_found(make_recorder: "type[Recorder]", tmp_path: Path) -> None:
    near, far = make_recorder(), make_recorder()
    link = tmp_path / "by-id"
    cable = NullModem()
    spare = NullModem()  # so that the second one cannot get the first one's number
    link.symlink_to(cable.near)
    port = SerialPort(SerialEndpoint(str(link)), near, ignore)
    await port.open()
    assert near.opens == 1
    cable.close()
    await near.until(lambda end: len(end.reasons) == 1)
    assert near.reasons == ["unplugged"]
    link.unlink()
    link.symlink_to(spare.near)
    await near.until(lambda end: end.opens == 2)
    other = SerialPort(SerialEndpoint(spare.far), far, ignore)
    await other.open()
    far.write(b"here again")
    await near.until(lambda end: end.data == b"here again")
    await port.close()
    await other.close()
    spare.close()


async def test_losing_a_port_while_writing_is_told_after_the_call(make_recorder: "type[Recorder]") -> None:
    near = make_recorder()
    cable = NullModem()
    port = SerialPort(SerialEndpoint(cable.near), near, ignore)
    await port.open()
    cable.close()
    near.write(b"into the void")  # fails with EIO
    assert near.reasons == []
    await near.until(lambda end: len(end.reasons) == 1)
    await port.close()


async def test_bytes_that_do_not_fit_are_sent_when_there_is_room(make_recorder: "type[Recorder]") -> None:
    near = make_recorder()
    master, slave = os.openpty()
    os.set_blocking(master, False)
    port = SerialPort(SerialEndpoint(os.ttyname(slave)), near, ignore)
    await port.open()
    block = bytes(range(256)) * 64  # 16 KiB; the terminal takes 4
    near.write(block)
    near.write(b"end")
    arrived = b""
    async with asyncio.timeout(30):
        while len(arrived) < len(block) + 3:
            await asyncio.sleep(0)
            try:
                arrived += os.read(master, 512)
            except BlockingIOError:
                continue
    assert arrived == block + b"end"
    await port.close()
    os.close(master)
    os.close(slave)


async def test_the_lock_is_given_back_on_close(make_recorder: "type[Recorder]") -> None:
    cable = NullModem()
    port = SerialPort(SerialEndpoint(cable.near), make_recorder(), ignore)
    await port.open()
    await port.close()
    handle = os.open(cable.near, os.O_RDWR | os.O_NOCTTY)
    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    os.close(handle)
    cable.close()
