"""sd_notify(3): what goes out, byte for byte, and that nothing is waited for."""

import contextlib
import os
import socket
from pathlib import Path

import pytest

from gateway.ipc.service_manager import ServiceManager, handed_over, manager_of


@pytest.fixture
def ear() -> "socket.socket":
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.settimeout(5.0)
    return heard


@pytest.mark.parametrize("is_abstract", [False, True])
def test_each_message_is_one_datagram(ear: socket.socket, tmp_path: Path, *, is_abstract: bool) -> None:
    name = f"@{tmp_path}/abstract" if is_abstract else f"{tmp_path}/notify"
    with ear, contextlib.closing(ServiceManager(name, 4_000_000_000)) as manager:
        ear.bind(name.replace("@", "\0"))
        manager.ready("2 of 2 lines up")
        manager.alive("2 of 2 lines up")
        manager.show_status("1 of 2\nlines up")
        manager.show_status("1 of 2 lines up")
        manager.stopping(1.5)
        manager.drop("tcp-1")
        told = [ear.recv(300) for _ in range(5)]
        assert told == [
            b"READY=1\nSTATUS=2 of 2 lines up",
            b"WATCHDOG=1",  # the same sentence is not said again
            b"STATUS=1 of 2 lines up",
            b"STOPPING=1\nEXTEND_TIMEOUT_USEC=1500000",
            b"FDSTOREREMOVE=1\nFDNAME=tcp-1",
        ]


def test_a_descriptor_goes_along(ear: socket.socket, tmp_path: Path) -> None:
    manager = ServiceManager(str(tmp_path / "notify"))
    with ear, contextlib.closing(manager), (tmp_path / "kept").open("w") as file:
        ear.bind(str(tmp_path / "notify"))
        manager.store("tty-1", file.fileno())
        message, [descriptor], _, _ = socket.recv_fds(ear, 300, 4)
        assert message == b"FDSTORE=1\nFDNAME=tty-1"
        assert os.path.sameopenfile(descriptor, file.fileno())
        os.close(descriptor)


def test_a_manager_that_does_not_read_or_is_gone_costs_nothing(ear: socket.socket, tmp_path: Path) -> None:
    with ear:
        ear.bind(str(tmp_path / "notify"))
        manager = ServiceManager(str(tmp_path / "notify"))
        for _ in range(5000):  # far more than its queue takes; a call that waits hangs here for ever
            manager.alive()
        kept = 0
        ear.setblocking(False)
        while True:
            try:
                ear.recv(300)
            except BlockingIOError:
                break
            kept += 1
        assert 0 < kept < 5000
    manager.alive()
    (tmp_path / "notify").unlink()
    manager.stopping()
    manager.close()
    manager.alive()


@pytest.mark.parametrize("is_watched", [False, True])
def test_that_it_is_ready_reaches_a_manager_that_did_not_read_at_first(
    ear: socket.socket, tmp_path: Path, *, is_watched: bool
) -> None:
    with ear, contextlib.closing(ServiceManager(str(tmp_path / "notify"))) as manager:
        ear.bind(str(tmp_path / "notify"))
        for _ in range(5000):
            manager.drop("tcp-1")  # its queue is full
        manager.ready("1 of 1 lines up")
        ear.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                assert b"READY" not in ear.recv(300)
        for _ in range(2):
            manager.alive("1 of 1 lines up") if is_watched else manager.show_status("1 of 1 lines up")
        assert ear.recv(300) == (b"READY=1\nWATCHDOG=1" if is_watched else b"READY=1")
        with contextlib.suppress(BlockingIOError):
            assert ear.recv(300) == b"WATCHDOG=1"  # once is enough


def test_the_environment_names_it_once_and_for_this_process_only() -> None:
    own, other = str(os.getpid()), str(os.getpid() + 1)
    environment = {"NOTIFY_SOCKET": "/run/none", "WATCHDOG_USEC": "5000000", "WATCHDOG_PID": own, "HOME": "/"}
    assert _named_by(environment) == (True, 5_000_000_000)
    assert environment == {"HOME": "/"}
    assert _named_by({"NOTIFY_SOCKET": "/run/none", "WATCHDOG_USEC": "5", "WATCHDOG_PID": other}) == (True, 0)
    assert _named_by({}) == (False, 0)
    assert _named_by({"NOTIFY_SOCKET": "vsock:2:1"}) == (False, 0)
    assert list(handed_over({"LISTEN_PID": other, "LISTEN_FDS": "2", "LISTEN_FDNAMES": "a:b"})) == []
    assert list(handed_over({"LISTEN_PID": own, "LISTEN_FDS": "x"})) == []


def _named_by(environment: dict[str, str]) -> tuple[bool, int]:
    with contextlib.closing(manager_of(environment)) as manager:
        return manager.is_there, manager.watchdog_ns
