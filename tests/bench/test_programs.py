"""The programs in C: their frames against the project's own, and what they do when a reply is wrong."""

import json
import os
import re
import select
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

import pytest

from bench.building import Programs, build_programs
from bench.instructions import counted, counter_refusal
from bench.processes import cpu_ns
from gateway.modbus.mbap import MbapDecoder, encode_mbap
from gateway.modbus.rtu import encode_rtu
from gateway.simulator.pty import Pty
from tests.support.processes import started

PATIENCE_S = 20.0


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Programs:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed: the bench's programs cannot be built")
    return build_programs(tmp_path_factory.mktemp("programs"))


@contextmanager
def drive(programs: Programs, *at: str, fds: tuple[int, ...] = ()) -> Iterator[list[int]]:
    """Run drives; gives the ports of those that listen."""
    command = [str(programs.drive), "--seconds", "60", *at]
    with started(command, stdout=subprocess.PIPE, text=True, pass_fds=fds) as process:
        assert process.stdout is not None
        ports: list[int] = []
        while (line := process.stdout.readline().strip()) != "ready":
            ports.append(int(re.fullmatch(r"port (\d+)", line)[1]))  # type: ignore[index]
        yield ports


def load(programs: Programs, *words: str, fds: tuple[int, ...] = ()) -> "subprocess.CompletedProcess[str]":
    command = [str(programs.load), "--warmup", "0", "--timeout-ms", "300", *words]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, pass_fds=fds, timeout=PATIENCE_S
    )


def asked(port: int, request: bytes, length: int) -> bytes:
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as connection:
        connection.sendall(request)
        reply = b""
        while len(reply) < length:
            reply += connection.recv(300)
        return reply


def asked_on(fd: int, request: bytes, length: int) -> bytes:
    os.write(fd, request)
    reply = b""
    while len(reply) < length:
        assert select.select([fd], [], [], PATIENCE_S)[0], "no reply"
        reply += os.read(fd, 300)
    return reply


PDUS = [
    # request, reply: written by hand after Modbus application protocol V1.1b3, 6.3, 6.6, 6.12 and 7
    ("10 0064 0002 04 0001 86A0", "10 0064 0002"),
    ("03 0064 0002", "03 04 0001 86A0"),
    ("06 0065 1234", "06 0065 1234"),
    ("03 0064 0003", "03 06 0001 1234 0000"),
    ("03 03FF 0002", "83 02"),
    ("03 0064 0000", "83 03"),
    ("2B 0E 01 00 00", "AB 01"),
]


def test_the_drive_speaks_modbus_tcp(programs: Programs) -> None:
    with drive(programs, "listen:0") as (port,):
        for number, (request, reply) in enumerate(PDUS):
            wanted = encode_mbap(number, 7, bytes.fromhex(reply))
            assert asked(port, encode_mbap(number, 7, bytes.fromhex(request)), len(wanted)) == wanted


def test_the_drive_speaks_rtu(programs: Programs) -> None:
    with closing(Pty()) as port, drive(programs, f"fd:{port.master_fd}", fds=(port.master_fd,)):
        fd = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
        try:
            for request, reply in PDUS[:-1]:  # the length of function 43 is not known to it
                wanted = encode_rtu(7, bytes.fromhex(reply))
                assert asked_on(fd, encode_rtu(7, bytes.fromhex(request)), len(wanted)) == wanted
        finally:
            os.close(fd)


@contextmanager
def answering(answer: Callable[[int, int, bytes], bytes]) -> Iterator[tuple[int, list[bytes]]]:
    """A Modbus/TCP server in which a test decides about the replies; gives its port and the PDUs it got."""
    seen: list[bytes] = []
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        connection, _ = server.accept()
        decoder = MbapDecoder()
        # A controller that gives up leaves replies unread, which resets the connection.
        with connection, suppress(ConnectionResetError, BrokenPipeError):
            while data := connection.recv(300):
                for transaction, unit, pdu in decoder.feed(data):
                    seen.append(pdu)
                    connection.sendall(answer(transaction, unit, pdu))

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield server.getsockname()[1], seen
    finally:
        thread.join(PATIENCE_S)
        server.close()


def test_the_controller_writes_a_position_that_changes_each_time(programs: Programs) -> None:
    with answering(lambda transaction, unit, pdu: encode_mbap(transaction, unit, pdu[:5])) as (port, seen):
        done = load(programs, "--count", "3", f"tcp:127.0.0.1:{port}")
    assert done.returncode == 0, done.stderr
    # function 16, two registers at 100, steps of 50 counts
    assert [pdu.hex() for pdu in seen] == [f"100064000204{counts:08x}" for counts in (50, 100, 150)]


def right(pdu: bytes) -> bytes:
    """The reply to the first write, and to the read that follows it: 50 counts."""
    return pdu[:5] if pdu[0] == 16 else bytes.fromhex("03 04 0000 0032")


WRONG = {
    "another position back": lambda t, u, p: encode_mbap(t, u, right(p)[:-1] + b"\x33"),
    "another transaction": lambda t, u, p: encode_mbap(t + 1, u, right(p)),
    "another unit": lambda t, u, p: encode_mbap(t, u + 1, right(p)),
    "an exception": lambda t, u, p: encode_mbap(t, u, bytes([p[0] | 0x80, 4])),
    "two replies": lambda t, u, p: 2 * encode_mbap(t, u, right(p)),
    "silence": lambda t, u, p: b"",
}


def test_right_replies_are_taken(programs: Programs) -> None:
    with answering(lambda transaction, unit, pdu: encode_mbap(transaction, unit, right(pdu))) as (port, _):
        done = load(programs, "--count", "2", "--kind", "cycle", f"tcp:127.0.0.1:{port}")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("answer", WRONG.values(), ids=WRONG)
def test_a_reply_that_is_wrong_or_missing_fails_the_run(
    programs: Programs, answer: Callable[[int, int, bytes], bytes]
) -> None:
    with answering(answer) as (port, _):
        done = load(programs, "--count", "2", "--kind", "cycle", f"tcp:127.0.0.1:{port}")
    assert done.returncode == 1
    assert done.stderr.startswith(f"tcp:127.0.0.1:{port}: ")


@pytest.mark.parametrize(
    "words", [[], ["--kind", "dance", "tcp:127.0.0.1:1"], ["nowhere"], ["--pace", "1", "x"]]
)
def test_wrong_usage_is_code_2(programs: Programs, words: list[str]) -> None:
    done = load(programs, *words)
    assert done.returncode == 2
    assert done.stderr != ""


def test_the_relay_in_c_converts_between_tcp_and_rtu(programs: Programs) -> None:
    with (
        closing(Pty()) as far,
        started(
            [str(programs.relay), "--convert", "listen:0", f"tty:{far.path}"],
            stdout=subprocess.PIPE,
            text=True,
        ) as relay,
    ):
        assert relay.stdout is not None
        port = int(relay.stdout.readline().split()[1])
        with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as near:
            request, reply = bytes.fromhex("10 0064 0002 04 0001 86A0"), bytes.fromhex("10 0064 0002")
            near.sendall(encode_mbap(0x1234, 3, request))
            wanted = encode_rtu(3, request)
            assert asked_on(far.master_fd, b"", len(wanted)) == wanted
            os.write(far.master_fd, encode_rtu(3, reply))
            answer = encode_mbap(0x1234, 3, reply)
            near.settimeout(PATIENCE_S)
            assert near.recv(len(answer), socket.MSG_WAITALL) == answer


def test_a_hundred_exchanges_direct_and_through_the_relay_in_c(programs: Programs, tmp_path: Path) -> None:
    latencies = tmp_path / "latencies.bin"
    with (
        drive(programs, "listen:0") as (port,),
        started(
            [str(programs.relay), "listen:0", f"tcp:127.0.0.1:{port}"], stdout=subprocess.PIPE, text=True
        ) as relay,
    ):
        assert relay.stdout is not None
        middle = int(relay.stdout.readline().split()[1])
        for way in (port, middle):
            words = ["--count", "100", "--kind", "cycle", "--out", str(latencies), f"tcp:127.0.0.1:{way}"]
            done = load(programs, *words)
            assert done.returncode == 0, done.stderr
            assert latencies.stat().st_size == 100 * 16


def test_the_wire_carries_bytes_both_ways_and_says_where_it_was_silent_inside_of_a_frame(
    programs: Programs,
) -> None:
    with closing(Pty()) as left, closing(Pty()) as right:
        fds = (left.master_fd, right.master_fd)
        command = [str(programs.wire), "115200", *map(str, fds)]
        ends = [os.open(each.path, os.O_RDWR | os.O_NOCTTY) for each in (left, right)]
        try:
            with started(command, stdout=subprocess.PIPE, text=True, pass_fds=fds) as wire:
                for near, far in (ends, ends[::-1]):
                    sent = bytes(range(256))
                    assert asked_on(near, sent, 0) == b""
                    assert asked_on(far, b"", len(sent)) == sent
                wire.terminate()
                said, _ = wire.communicate(timeout=PATIENCE_S)
        finally:
            for end in ends:
                os.close(end)
    # Half of 1.75 ms stands between two frames.
    assert all(at_ns > 0 and 0 < pause_ns < 875_000 for at_ns, pause_ns in json.loads(said))


def test_how_fast_system_calls_are(programs: Programs) -> None:
    done = subprocess.run(
        [str(programs.calls), "3"], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    taken_ns = json.loads(done.stdout)
    assert list(taken_ns) == ["getppid", "pipe", "epoll", "process"]
    # Two calls take longer than one that does nothing, and another process longer than two calls.
    assert 0 < taken_ns["getppid"] < taken_ns["pipe"] < taken_ns["process"]
    assert taken_ns["getppid"] < taken_ns["epoll"]


def test_the_counter_counts_what_a_process_does_meanwhile(programs: Programs) -> None:
    spinning = [sys.executable, "-c", "print('here', flush=True)\nwhile True: pass"]
    with started(spinning, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()

        def wait() -> None:
            before_ns = cpu_ns(process.pid)
            give_up_s = time.monotonic() + PATIENCE_S
            while cpu_ns(process.pid) < before_ns + 20_000_000:
                assert time.monotonic() < give_up_s, "it does not run"

        # Processor time, which every machine counts: of its instructions a virtual one often knows nothing.
        assert counted(programs.counter, [process.pid], wait, "task-clock") >= 20_000_000
    refusal = counter_refusal(programs.counter)
    assert refusal == "" or refusal.startswith("perf_event_open: ")


def waits_of(pid: int) -> int:
    """How often a process has waited for something so far."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(re.search(r"^voluntary_ctxt_switches:\s*(\d+)", status, re.MULTILINE)[1])  # type: ignore[index]


def test_the_witness_says_when_it_came_late(programs: Programs) -> None:
    command = [str(programs.witness), "1000", "-1", "0"]  # late is what came after its time: each
    with started(command, stdout=subprocess.PIPE, text=True) as witness:
        give_up_s = time.monotonic() + PATIENCE_S
        while waits_of(witness.pid) < 20:
            assert time.monotonic() < give_up_s, "it does not wait"
        witness.terminate()
        said, _ = witness.communicate(timeout=PATIENCE_S)
    noted = json.loads(said)
    assert noted
    assert all(late_ns >= 0 for _, late_ns in noted)
    assert [due_ns for due_ns, _ in noted] == sorted(due_ns for due_ns, _ in noted)
