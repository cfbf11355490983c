"""The system calls of a frame: in Python and in C the same results, the same errors."""

import errno
import importlib.util
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import ModuleType

import pytest

from gateway import system

SOURCE = Path(system.__file__).with_name("_system.c")
TOOL = Path(__file__).parents[2] / "tools" / "compiled.py"


class Calls:
    """One of the two kinds."""

    def __init__(self, module: ModuleType | None) -> None:
        self.boot_ns: Callable[[], int] = partial(time.clock_gettime_ns, system.CLOCK)
        self.read: Callable[[int, int], bytes] = os.read
        self.write: Callable[[int, bytes], int] = os.write
        self.set_at: Callable[[int, int], None] = system.set_in_python
        self._module = module
        if module is not None:
            self.boot_ns, self.read, self.write = module.boot_ns, module.read, module.write
            self.set_at = module.set_at

    def waiting(self, epoll: select.epoll) -> system.Wait:
        if self._module is None:
            return epoll.poll
        wait: system.Wait = self._module.waiting(epoll.fileno())
        return wait


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> ModuleType:
    """The module that a compiled gateway has, made from its source."""
    lacking = subprocess.run([sys.executable, TOOL, "--missing"], capture_output=True, text=True, check=True)
    if lacking.stdout.strip():
        pytest.skip(lacking.stdout.strip())
    library = tmp_path_factory.mktemp("c") / f"_system{sysconfig.get_config_var('EXT_SUFFIX')}"
    compiler = shlex.split(sysconfig.get_config_var("CC") or "cc")
    include = f"-I{sysconfig.get_path('include')}"
    warnings = ("-Wall", "-Wextra", "-Werror")
    command = [
        *compiler,
        *warnings,
        "-O2",
        "-shared",
        "-fPIC",
        include,
        "-o",
        str(library),
        str(SOURCE),
        "-lm",
    ]
    subprocess.run(command, check=True)
    spec = importlib.util.spec_from_file_location("gateway._system", library)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(params=["python", "c"])
def calls(request: pytest.FixtureRequest) -> Calls:
    return Calls(None if request.param == "python" else request.getfixturevalue("in_c"))


@pytest.fixture
def ends() -> Iterator[tuple[socket.socket, socket.socket]]:
    one, other = socket.socketpair()
    for end in (one, other):
        end.setblocking(False)
    yield one, other
    one.close()
    other.close()


def test_bytes_there_and_back(calls: Calls, ends: tuple[socket.socket, socket.socket]) -> None:
    one, other = ends
    assert calls.write(one.fileno(), b"\x01\x00\xff") == 3
    assert calls.read(other.fileno(), 2) == b"\x01\x00"
    assert calls.read(other.fileno(), 4096) == b"\xff"
    with pytest.raises(BlockingIOError):
        calls.read(other.fileno(), 10)
    one.close()
    assert calls.read(other.fileno(), 10) == b""
    with pytest.raises(BrokenPipeError):
        calls.write(other.fileno(), b"1")


def test_what_is_not_taken_is_told(calls: Calls, ends: tuple[socket.socket, socket.socket]) -> None:
    one, other = ends
    written = 0
    with suppress(BlockingIOError):
        while True:
            written += calls.write(one.fileno(), bytes(100_000))
    got = 0
    with suppress(BlockingIOError):
        while True:
            got += len(calls.read(other.fileno(), 4096))
    assert got == written > 0


def test_a_descriptor_that_is_none(calls: Calls) -> None:
    with pytest.raises(OSError, match="Bad file descriptor") as read:
        calls.read(10_000, 1)
    with pytest.raises(OSError, match="Bad file descriptor") as written:
        calls.write(10_000, b"1")
    assert read.value.errno == written.value.errno == errno.EBADF
    with pytest.raises(OverflowError):
        calls.read(1 << 33, 1)
    for call in (calls.read, calls.write):
        with pytest.raises(TypeError):
            call("1", b"")  # type: ignore[arg-type]


def test_what_is_ready_is_named_with_events(calls: Calls, ends: tuple[socket.socket, socket.socket]) -> None:
    one, other = ends
    with select.epoll() as epoll:
        wait = calls.waiting(epoll)
        epoll.register(one.fileno(), select.EPOLLIN | select.EPOLLRDHUP)
        epoll.register(other.fileno(), select.EPOLLIN)
        assert wait(0, 64) == []
        other.send(b"1")
        assert wait(-1, 64) == [(one.fileno(), select.EPOLLIN)]
        one.send(b"1")
        assert sorted(wait(-1, 64)) == sorted((end.fileno(), select.EPOLLIN) for end in ends)
        assert len(wait(-1, 1)) == 1
        other.close()
        told = dict(wait(-1, 64))[one.fileno()]
        assert told & (select.EPOLLIN | select.EPOLLRDHUP) == select.EPOLLIN | select.EPOLLRDHUP
    with pytest.raises((OSError, ValueError)):  # an epoll of Python knows that it is closed
        wait(0, 64)


def test_a_signal_is_heard_while_it_waits(calls: Calls) -> None:
    """That of Python goes on waiting afterwards, that in C leaves it to the loop."""
    heard: list[int] = []
    reading, writing = os.pipe()

    def hear(number: int, _frame: object) -> None:
        heard.append(number)
        os.write(writing, b"1")

    before = signal.signal(signal.SIGALRM, hear)
    try:
        with select.epoll() as epoll:
            epoll.register(reading, select.EPOLLIN)
            signal.setitimer(signal.ITIMER_REAL, 0.01)
            assert calls.waiting(epoll)(-1, 64) in ([], [(reading, select.EPOLLIN)])
    finally:
        os.close(reading)
        os.close(writing)
        signal.signal(signal.SIGALRM, before)
    assert heard == [signal.SIGALRM]


def test_the_clock_is_that_of_the_machine(calls: Calls) -> None:
    before_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    now_ns = calls.boot_ns()
    assert before_ns <= now_ns <= time.clock_gettime_ns(time.CLOCK_BOOTTIME)


def test_a_timer_is_set_to_an_instant_and_taken_back(calls: Calls) -> None:
    timer = system.create_timer()
    try:
        calls.set_at(timer, 1)  # long ago
        assert calls.read(timer, 8) == (1).to_bytes(8, sys.byteorder)
        at_ns = calls.boot_ns() + 3_000_000
        calls.set_at(timer, at_ns)
        with select.epoll() as epoll:
            epoll.register(timer, select.EPOLLIN)
            assert calls.waiting(epoll)(-1, 64) == [(timer, select.EPOLLIN)]
        assert calls.boot_ns() >= at_ns
        calls.set_at(timer, 0)
        with pytest.raises(BlockingIOError):
            calls.read(timer, 8)
        with pytest.raises(OSError, match="Invalid argument"):
            calls.set_at(timer, -1)
    finally:
        os.close(timer)
    with pytest.raises(OSError, match="Bad file descriptor"):
        calls.set_at(10_000, 1)


def test_numbers_that_cannot_be_are_refused(in_c: ModuleType) -> None:
    wait = in_c.waiting(0)
    for call, arguments in ((in_c.read, (0, 4097)), (in_c.read, (0, -1)), (wait, (0, 65)), (wait, (0, 0))):
        with pytest.raises(ValueError, match=r"to (4096|64)$"):
            call(*arguments)
    with pytest.raises(ValueError, match=r"wait\(\) of 5: -1 or 0"):
        wait(5, 64)
    for call in (in_c.read, in_c.write, in_c.set_at, wait):
        with pytest.raises(TypeError, match="arguments"):
            call()
