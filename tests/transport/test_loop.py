"""The relay's loop: what is watched is worked on inside its waiting, and everything else has its turn too."""

import asyncio
import os
import socket
from collections.abc import Iterator

import pytest

from gateway.clock import boot_ns
from gateway.transport.loop import RelayLoop

PATIENCE_S = 30.0


@pytest.fixture
def pair() -> Iterator[tuple[socket.socket, socket.socket]]:
    near, far = socket.socketpair()
    near.setblocking(False)
    with near, far:
        yield near, far


class Busy:
    """A descriptor that always can be read: whoever reads it leaves one byte behind."""

    def __init__(self, loop: RelayLoop, near: socket.socket, far: socket.socket) -> None:
        self.reads = 0
        self._near, self._far = near, far
        far.send(b".")
        loop.add_reader(near, self.read)

    def read(self) -> None:
        self.reads += 1
        self._near.recv(1)
        self._far.send(b".")


def run(loop: RelayLoop, until: "asyncio.Future[object]") -> None:
    try:
        loop.run_until_complete(asyncio.wait_for(until, PATIENCE_S))
    finally:
        loop.close()


def test_a_timer_is_due_while_bytes_come_without_end(pair: tuple[socket.socket, socket.socket]) -> None:
    loop = RelayLoop()
    busy = Busy(loop, *pair)
    done = loop.create_future()
    loop.call_later(0.02, done.set_result, None)
    run(loop, done)
    assert busy.reads > 1


def test_a_transport_has_its_turn_while_bytes_come(pair: tuple[socket.socket, socket.socket]) -> None:
    loop = RelayLoop()
    busy = Busy(loop, *pair)
    near, far = socket.socketpair()
    near.setblocking(False)
    far.sendall(b"hello")
    run(loop, loop.create_task(loop.sock_recv(near, 5)))
    near.close()
    far.close()
    assert busy.reads >= 1


def test_another_thread_is_heard_while_bytes_come(pair: tuple[socket.socket, socket.socket]) -> None:
    loop = RelayLoop()
    busy = Busy(loop, *pair)
    run(loop, loop.run_in_executor(None, int))
    assert busy.reads >= 1


def test_what_a_reader_asks_the_loop_for_is_done(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    loop = RelayLoop()
    done = loop.create_future()

    def read() -> None:
        loop.call_soon(done.set_result, near.recv(5))

    loop.add_reader(near, read)
    far.sendall(b"hello")
    loop.run_until_complete(asyncio.wait_for(done, PATIENCE_S))
    assert done.result() == b"hello"
    loop.close()


def test_a_reader_that_fails_is_told_of_and_ends_nothing(pair: tuple[socket.socket, socket.socket]) -> None:
    near, far = pair
    loop = RelayLoop()
    told: list[object] = []
    loop.set_exception_handler(lambda _, context: told.append(context["exception"]))
    done = loop.create_future()

    def read(word: str) -> None:
        if near.recv(1) == b"a":
            raise ValueError(word)
        done.set_result(None)

    loop.add_reader(near, read, "a word")
    far.sendall(b"ab")
    run(loop, done)
    assert [repr(each) for each in told] == ["ValueError('a word')"]


def test_who_closes_another_one_s_descriptor_is_the_last_to_read_it() -> None:
    loop = RelayLoop()
    done = loop.create_future()
    read: list[int] = []
    pairs = [socket.socketpair() for _ in range(2)]

    def first_of_them(number: int) -> None:
        read.append(number)
        other = pairs[1 - number][0]
        assert loop.remove_reader(other)
        assert not loop.remove_reader(other)
        other.close()
        loop.remove_reader(pairs[number][0])
        loop.call_soon(done.set_result, None)

    for number, (near, far) in enumerate(pairs):
        loop.add_reader(near, first_of_them, number)
        far.send(b".")
    run(loop, done)
    assert len(read) == 1
    for near, far in pairs:
        near.close()
        far.close()


def test_a_reader_may_be_another_one_and_a_descriptor_another_file() -> None:
    loop = RelayLoop()
    first, second = os.pipe(), os.pipe()
    read: list[str] = []

    def reads(word: str) -> None:
        os.read(first[0], 1)
        read.append(word)
        loop.stop()

    loop.add_reader(first[0], reads, "never")
    loop.add_reader(first[0], reads, "first")
    os.write(first[1], b".")
    loop.run_forever()
    loop.remove_reader(first[0])
    os.close(first[0])
    os.dup2(second[0], first[0])  # the same number again
    loop.add_reader(first[0], reads, "second")
    os.write(second[1], b".")
    loop.call_later(PATIENCE_S, loop.stop)
    loop.run_forever()
    loop.close()
    assert read == ["first", "second"]
    for descriptor in (*first, *second):
        os.close(descriptor)


def test_it_waits_as_long_as_it_is_told_to() -> None:
    loop = RelayLoop()
    began_ns = boot_ns()
    loop.run_until_complete(asyncio.sleep(0.02))
    loop.close()
    assert boot_ns() - began_ns >= 20_000_000
