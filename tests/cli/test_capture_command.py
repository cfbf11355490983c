"""``capture`` as a person types it; what it writes, read by ``replay`` and by tshark."""

import json
import os
import pty
import re
import resource
import signal
import socket
import stat
import subprocess
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode_mbap
from gateway.modbus.rtu import encode_rtu
from tests.support.commands import typed
from tests.support.config import Keys, axis, gateway_toml, line, registers, section, tcp, written
from tests.support.ports import free_port
from tests.support.processes import COMMAND, ROOT, running, started

SECONDS = 60
WRITE = bytes.fromhex("10 0064 0002 04 0000 C350")
READ = bytes.fromhex("03 006E 0002")
COILS = bytes.fromhex("01 0000 0018")
"""24 coils: the answer is as long as the request, and Wireshark may not tell them apart by that."""
UNKNOWN = bytes.fromhex("41 00")


def reply_to(pdu: bytes) -> bytes:
    """A drive that stands where 50 mm are, with its correction: 50 050 counts."""
    if pdu[0] == 3:
        return bytes.fromhex("03 04 0000 C382")
    if pdu[0] == 16:
        return pdu[:5]
    return bytes.fromhex("01 03 FF FF FF") if pdu[0] == 1 else bytes((pdu[0] | 0x80, 1))


def serve(drive: socket.socket) -> None:
    """Be that drive over Modbus/TCP, for one connection."""
    try:
        connection, _ = drive.accept()
    except OSError:
        return
    with connection:
        while data := connection.recv(300):
            number, unit_id, pdu = int.from_bytes(data[:2], "big"), data[6], data[7:]
            connection.sendall(encode_mbap(number, unit_id, reply_to(pdu)))


def serve_rtu(device: int) -> None:
    """Be that drive on a serial line, whose frames arrive whole."""
    try:
        while data := os.read(device, 300):
            os.write(device, encode_rtu(data[0], reply_to(data[1:-2])))
    except OSError:
        return


def configured(folder: Path, drives: int | Keys) -> Path:
    """Write the configuration of an axis whose traffic is kept."""
    text = gateway_toml(
        section("[capture]", {"size_mb": 0.5}),
        line(drives, {"cnc": free_port()}, response_timeout_ms=500),
        axis(registers=registers(command=100, actual=110), compensation="on", table="x.tab"),
    )
    return written(folder, text)


@dataclass
class Site:
    """A gateway that runs, with the controller's end of its cable."""

    config: Path
    port: int
    number: int = 0

    def ask(self, pdu: bytes) -> bytes:
        self.number += 1
        with socket.create_connection(("127.0.0.1", self.port), timeout=SECONDS) as controller:
            controller.sendall(encode_mbap(self.number, 1, pdu))
            return controller.recv(300)[7:]


@contextmanager
def site(folder: Path, *, serial: bool = False) -> Iterator[Site]:
    device, cable = pty.openpty()
    with socket.create_server(("127.0.0.1", 0)) as drive:
        way: Keys = tcp(drive.getsockname()[1])
        if serial:
            tty.setraw(cable)
            way = {"rtu": os.ttyname(cable), "baudrate": 115200}
            threading.Thread(target=serve_rtu, args=(device,), daemon=True).start()
        else:
            threading.Thread(target=serve, args=(drive,), daemon=True).start()
        config = configured(folder, way)
        assert typed("check", "--compile", str(config)).returncode == 0
        with running("relay", str(config)) as program:
            program.until_each("ready", "line-up")
            try:
                yield Site(config, program.port("xyz/cnc"))
            finally:
                program.process.kill()
                os.close(cable)
                os.close(device)


def test_what_was_captured_is_replayed(tmp_path: Path) -> None:
    file = tmp_path / "monday.jsonl"
    with site(tmp_path) as made:
        for pdu in (WRITE, READ, COILS, UNKNOWN):
            made.ask(pdu)
        result = typed("capture", str(made.config), str(file), "--json")
        assert result.stderr == ""
        said = json.loads(result.stdout)
        # Four frames each: from the controller, to the drive, and back.
        assert (said["frames"], said["files"]) == (16, [str(file)])
        assert typed("capture", str(made.config), str(file)).returncode == 1
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    result = typed("replay", str(file))
    # That the drives can be reached comes first, and is part of what holds at the first request.
    assert result.stderr == f"{file}: 1 entry could not be compared: the state before them is unknown\n"
    assert result.returncode == 0
    assert re.fullmatch(r"\d+ inputs, 8 outputs: all as recorded\n", result.stdout)


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process can grow: a write gets EFBIG where a full disk gives ENOSPC."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_leaves_no_empty_file(tmp_path: Path) -> None:
    taken, packets = tmp_path / "monday.jsonl", tmp_path / "monday.pcapng"
    with site(tmp_path) as made:
        made.ask(WRITE)
        with full_disk():
            of_file = typed("capture", str(made.config), str(taken))
            of_packets = typed("capture", str(made.config), "--pcapng", str(packets))
    assert (of_file.returncode, of_packets.returncode) == (1, 1)
    assert of_file.stderr == f"{made.config}: {taken}: cannot be written (File too large)\n"
    assert of_packets.stderr == f"{made.config}: {packets}: cannot be written (File too large)\n"
    assert not taken.exists()
    assert not packets.exists()


def test_what_is_left_of_a_long_run_is_replayed_from_where_it_begins(tmp_path: Path) -> None:
    file = tmp_path / "monday.jsonl"
    with site(tmp_path) as made, socket.create_connection(("127.0.0.1", made.port), timeout=SECONDS) as cnc:
        for number in range(1000):  # 250 bytes for both: four of the eight parts of the tape
            for pdu in (WRITE, READ):
                cnc.sendall(encode_mbap(number, 1, pdu))
                cnc.recv(300)
        assert typed("capture", str(made.config), str(file)).returncode == 0
    header, *entries = file.read_bytes().splitlines(keepends=True)
    beginnings = [at for at, entry in enumerate(entries) if b'"kind":"beginning"' in entry]
    left = entries[beginnings[1] - 5 :]  # as if the part before it had been written over
    file.write_bytes(header + b"".join(left))
    outputs = sum(entry.startswith((b'{"kind":"sent"', b'{"kind":"answered"')) for entry in left[5:])
    result = typed("replay", str(file))
    assert result.returncode == 0
    assert result.stderr == f"{file}: 5 entries could not be compared: the state before them is unknown\n"
    assert result.stdout.endswith(f" inputs, {outputs} outputs: all as recorded\n")
    assert outputs > 1000


def test_frames_in_words_and_as_json(tmp_path: Path) -> None:
    with site(tmp_path) as made:
        made.ask(WRITE)
        made.ask(UNKNOWN)
        words = typed("capture", str(made.config), "--line", "xyz")
        lines = typed("capture", str(made.config), "--json").stdout.splitlines()
        wrong = typed("capture", str(made.config), "--line", "abc")
    assert words.returncode == 0
    assert (
        "controller → cnc#1  unit 1  write multiple registers  10 00 64 00 02 04 00 00 c3 50" in words.stdout
    )
    assert "[x command 50 mm]" in words.stdout
    assert "[x command 50.05 mm]" in words.stdout
    assert "exception 1 (illegal function)" in words.stdout
    frames = [entry for line in lines if (entry := json.loads(line))["kind"] in ("request", "sent")]
    assert [entry["pdu"] for entry in frames] == [
        WRITE.hex(),
        "10006400020400 00c382".replace(" ", ""),
        UNKNOWN.hex(),
        UNKNOWN.hex(),
    ]
    assert all(re.fullmatch(r"20\d\d-\d\d-\d\dT.*\+00:00", entry["time"]) for entry in frames)
    assert wrong.returncode == 1
    assert "there is no line abc; there are xyz" in wrong.stderr


def test_who_follows_sees_what_comes_and_ends_it_with_ctrl_c(tmp_path: Path) -> None:
    with site(tmp_path) as made:
        made.ask(WRITE)
        arguments = [*COMMAND, "capture", str(made.config), "--follow", "--json"]
        with started(arguments, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            # Until it looks nothing of what is asked is new to it.
            stop = threading.Event()

            def go_on() -> None:
                with socket.create_connection(("127.0.0.1", made.port), timeout=SECONDS) as controller:
                    while not stop.is_set():
                        controller.sendall(encode_mbap(1, 1, READ))
                        assert controller.recv(300)

            asking = threading.Thread(target=go_on)
            asking.start()
            try:
                first = json.loads(process.stdout.readline())
            finally:
                stop.set()
                asking.join()
            process.send_signal(signal.SIGINT)
            process.stdout.read()
            assert process.wait(SECONDS) == 0
    assert first["line"] == "xyz"
    assert first.get("pdu") != WRITE.hex()


def test_nobody_to_look_at_and_nothing_kept(tmp_path: Path) -> None:
    config = configured(tmp_path, 1)
    result = typed("capture", str(config))
    assert result.returncode == 1
    assert "no gateway runs" in result.stderr
    result = typed("capture", str(config), str(tmp_path / "file"), "--follow")
    assert result.returncode == 2


@pytest.mark.parametrize("serial", [False, True], ids=["tcp", "rtu"])
def test_wireshark_reads_both_sides_and_finds_nothing_malformed(tmp_path: Path, serial: bool) -> None:
    file = tmp_path / "monday.pcapng"
    with site(tmp_path, serial=serial) as made:
        for pdu in (WRITE, READ, COILS, UNKNOWN):
            made.ask(pdu)
        assert typed("capture", str(made.config), "--pcapng", str(file)).returncode == 0
        made.ask(READ)
        piped = subprocess.run(
            [*COMMAND, "capture", str(made.config), "--pcapng", "-"],
            capture_output=True,
            timeout=SECONDS,
            check=True,
            cwd=ROOT,
        )
    assert piped.stdout.startswith(file.read_bytes())

    def tshark(*arguments: str) -> list[str]:
        environment = {**os.environ, "LC_ALL": "C.UTF-8", "HOME": str(tmp_path)}
        result = subprocess.run(
            ["tshark", "-r", str(file), *arguments],
            capture_output=True,
            text=True,
            timeout=SECONDS,
            check=True,
            env=environment,
        )
        return result.stdout.splitlines()

    fields = ("frame.interface_name", "_ws.col.Protocol", "modbus.func_code", "_ws.col.Info")
    rows = tshark("-T", "fields", *(part for each in fields for part in ("-e", each)))
    seen = [
        (name, protocol, int(function), info.split(":")[0].strip())
        for name, protocol, function, info in (row.split("\t") for row in rows)
    ]
    back = "Modbus RTU" if serial else "Modbus/TCP"
    expected = [
        frame
        for function in (16, 3, 1)
        for frame in (
            ("xyz: cnc", "Modbus/TCP", function, "Query"),
            ("xyz: drives", back, function, "Query"),
            ("xyz: drives", back, function, "Response"),
            ("xyz: cnc", "Modbus/TCP", function, "Response"),
        )
    ]
    assert seen[:12] == expected
    assert [row[:3] for row in seen[12:]] == [
        (name, protocol, 65)
        for name, protocol in (
            ("xyz: cnc", "Modbus/TCP"),
            ("xyz: drives", back),
            ("xyz: drives", back),
            ("xyz: cnc", "Modbus/TCP"),
        )
    ]
    assert tshark("-Y", "_ws.malformed") == []
    bad = "ip.checksum.status == 0 or tcp.checksum.status == 0 or mbrtu.crc16.status == 0"
    checks = ("ip.check_checksum", "tcp.check_checksum", "mbrtu.crc_verification")
    assert tshark(*(part for each in checks for part in ("-o", f"{each}:TRUE")), "-Y", bad) == []
