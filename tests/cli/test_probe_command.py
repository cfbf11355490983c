"""``pitch-gateway probe`` in front of drives that answer, and of nothing."""

import json
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.ipc.address import SocketFile
from gateway.modbus.crc import is_intact
from gateway.modbus.rtu import encode_rtu
from gateway.simulator.pty import Pty
from gateway.transport.devices import open_port
from gateway.transport.endpoints import SerialEndpoint
from tests.support.commands import Typed, typed
from tests.support.config import axis, gateway_toml, line, registers, written


def answer(drive: socket.socket, asked: list[bytes], counts: int, looks_at_unit_ids: bool = False) -> None:
    """Be a drive whose every 32-bit position is ``counts``, high word first."""
    try:
        connection, _ = drive.accept()
    except OSError:
        return  # nobody came before the test was over
    with connection:
        while data := connection.recv(300):
            asked.append(data[6:])
            if looks_at_unit_ids and data[6] != 1:
                continue
            connection.sendall(data[:4] + bytes((0, 7)) + data[6:8] + b"\x04" + counts.to_bytes(4, "big"))


@pytest.fixture
def drive(request: pytest.FixtureRequest) -> Iterator[tuple[str, list[bytes]]]:
    asked: list[bytes] = []
    counts = getattr(request, "param", 50_000)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=answer, args=(listening, asked, counts), daemon=True).start()
        yield f'tcp = "127.0.0.1:{listening.getsockname()[1]}"', asked


def answer_reads(port: int, asked: list[bytes], on_wrong_crc: bytes) -> None:
    """Be a drive on a serial line, at position 50 000; ``on_wrong_crc``: PDU of what it says to that."""
    while True:
        try:
            frame = os.read(port, 8)
        except OSError:
            return  # the test is over
        while len(frame) < 8:
            frame += os.read(port, 8 - len(frame))
        asked.append(frame)
        pdu = b"\x03\x04\x00\x00\xc3\x50" if is_intact(frame) else on_wrong_crc
        if pdu:
            os.write(port, encode_rtu(1, pdu))


@pytest.fixture
def serial_drive(request: pytest.FixtureRequest) -> Iterator[tuple[str, list[bytes]]]:
    asked: list[bytes] = []
    pty = Pty()
    os.set_blocking(pty.master_fd, True)
    thread = threading.Thread(target=answer_reads, args=(pty.master_fd, asked, request.param), daemon=True)
    thread.start()
    yield f'rtu = "{pty.path}", baudrate = 115200', asked
    pty.close()


def configured(folder: Path, drives: str, words: str = "high-first") -> Path:
    """Write the configuration of an axis; ``drives`` and what follows are TOML."""
    actual = [{"address": 110, "type": "int32", "words": words}]
    text = gateway_toml(
        line(1, {"cnc": 1502}, response_timeout_ms=500),
        axis(registers={**registers(command=100), "actual": actual}, travel=[0.0, 300.0]),
    )
    return written(folder, text.replace('tcp = "127.0.0.1:1"', drives), {})


def test_a_good_axis_is_shown_and_the_code_is_0(tmp_path: Path, drive: tuple[str, list[bytes]]) -> None:
    result = typed("probe", str(configured(tmp_path, drive[0])))
    assert (result.returncode, result.stderr) == (0, "")
    assert "axis x, unit id 1: answers" in result.stdout
    assert "actual     raw 50000, machine position 50 mm; nominal 50 forward, 50 backward" in result.stdout
    assert "all values that were read are plausible" in result.stdout
    assert "Before the first move:" in result.stdout
    assert {frame[1] for frame in drive[1]} == {3}


@pytest.mark.parametrize("drive", [809_042_123], indirect=True)
def test_large_counts_are_shown_to_the_last_digit(tmp_path: Path, drive: tuple[str, list[bytes]]) -> None:
    result = typed("probe", str(configured(tmp_path, drive[0])))
    assert "actual     raw 809042123, machine position 809042.123 mm; nominal 809042.123" in result.stdout


def test_a_drive_that_does_not_look_at_unit_ids_is_told_of(
    tmp_path: Path, drive: tuple[str, list[bytes]]
) -> None:
    result = typed("probe", str(configured(tmp_path, drive[0])))
    assert result.returncode == 0
    assert "note: the drive answers also for unit id 247: it ignores unit ids" in result.stdout
    assert [frame.hex() for frame in drive[1]][-1] == "f703006e0002"


def test_where_unit_ids_are_looked_at_other_units_is_proposed(tmp_path: Path) -> None:
    asked: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as listening:
        threading.Thread(target=answer, args=(listening, asked, 50_000, True), daemon=True).start()
        place = f'tcp = "127.0.0.1:{listening.getsockname()[1]}" }}\nother_units = [247, 246]\n#{{'
        result = typed("probe", str(configured(tmp_path, place)), "--json")
    findings = json.loads(result.stdout)["axes"]["x"]["findings"]
    assert (result.returncode, [finding["weight"] for finding in findings]) == (0, ["note", "note"])
    assert "Unit id 245, which has no axis, does not answer" in findings[1]["text"]
    assert "name their unit ids in the line, as in other_units = [7, 8]" in findings[1]["text"]
    assert [frame[0] for frame in asked] == [1, 1, 1, 245]


def be_a_converter(listening: socket.socket, asked: list[bytes]) -> None:
    """Be a converter with drives at unit ids 1 and 3; of 3 the register is another one."""
    connection, _ = listening.accept()
    with connection:
        while data := connection.recv(300):
            asked.append(data[6:])
            pdu = {1: b"\x03\x04\x00\x00\xc3\x50", 3: b"\x83\x02"}.get(data[6], b"\x83\x0b")
            connection.sendall(data[:4] + bytes((0, len(pdu) + 1)) + data[6:7] + pdu)


def probe_a_converter(tmp_path: Path, *options: str) -> tuple[Typed, list[bytes]]:
    asked: list[bytes] = []
    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=be_a_converter, args=(listening, asked), daemon=True)
        thread.start()
        config = configured(tmp_path, f'tcp = "127.0.0.1:{listening.getsockname()[1]}"')
        config.write_text(config.read_text().replace("unit_id = 1", "unit_id = 2"))
        result = typed("probe", str(config), *options)
        thread.join(10)
    return result, asked


def test_behind_a_converter_a_wrong_unit_id_is_said_to_be_nobody(tmp_path: Path) -> None:
    result, asked = probe_a_converter(tmp_path)
    assert result.returncode == 1
    assert result.stdout.startswith("axis x, unit id 2: no answer\n")
    assert "error: no drive answers as unit id 2 here: exception 11" in result.stdout
    assert "use pitch-gateway probe --scan to find the unit ids that answer" in result.stdout
    assert {frame[0] for frame in asked} == {2}


def test_a_scan_says_which_unit_ids_answer_and_only_reads(tmp_path: Path) -> None:
    result, asked = probe_a_converter(tmp_path, "--scan", "--json")
    report = json.loads(result.stdout)["axes"]["x"]
    assert (result.returncode, report["answers"], report["answering_unit_ids"]) == (1, False, [1, 3])
    assert "unit ids 1, 3 answer instead" in report["findings"][0]["text"]
    assert "reads from unit ids 1 to 247, for 2 min 3 s at most; Ctrl-C ends it" in result.stderr
    assert [frame[0] for frame in asked] == [2, 2, *range(1, 248)]
    assert {frame[1] for frame in asked} == {3}


def test_a_wrong_word_order_ends_with_code_1(tmp_path: Path, drive: tuple[str, list[bytes]]) -> None:
    result = typed("probe", str(configured(tmp_path, drive[0], "low-first")), "--axis", "x", "--json")
    assert result.returncode == 1
    report = json.loads(result.stdout)["axes"]["x"]
    assert report["wrong"] is True
    assert report["positions"]["command"]["machine_position"] == 50.0
    assert 'try words = "high-first"' in report["findings"][0]["text"]


OBEYS = b"\x03\x04\x00\x00\xc3\x50"
FORBIDDEN = "\nregisters.checks_crc = false\n"


@pytest.mark.parametrize(
    ("serial_drive", "mapped", "did", "said"),
    [
        (b"", "", "silent", ""),
        (b"", FORBIDDEN, "silent", "note: it does not answer frames with a wrong CRC, although its map says"),
        (b"\x83\x08", "", "refused", "error: it answers a read with a wrong CRC, but the standard"),
        (b"\x83\x08", FORBIDDEN, "refused", ""),
        (OBEYS, "", "answered", "error: it executes a read with a wrong CRC: noise can move it; write"),
        (OBEYS, FORBIDDEN, "answered", "warning: it executes a read with a wrong CRC: noise can move it"),
    ],
    indirect=["serial_drive"],
)
def test_a_drive_on_a_serial_line_is_asked_once_with_a_wrong_check_sum(
    tmp_path: Path, serial_drive: tuple[str, list[bytes]], mapped: str, did: str, said: str
) -> None:
    config = configured(tmp_path, serial_drive[0])
    config.write_text(config.read_text().rstrip("\n") + mapped)
    result = typed("probe", str(config), "--json")
    report = json.loads(result.stdout)["axes"]["x"]
    assert report["on_wrong_crc"] == did
    weight, _, text = said.partition(": ")
    found = [
        (each["weight"], each["text"].startswith(text))
        for each in report["findings"]
        if "travel is" not in each["text"]
    ]
    assert found == ([(weight, True)] if said else [])
    assert result.returncode == (1 if weight == "error" else 0)
    # 03 006E 0002 of unit 1 has the check sum 0xD6A5, low byte first; the last one has it inverted.
    assert serial_drive[1][0] == bytes.fromhex("01 03 00 6E 00 02 A5 D6")
    assert serial_drive[1][-1] == bytes.fromhex("01 03 00 6E 00 02 5A 29")
    assert [is_intact(frame) for frame in serial_drive[1]] == [True] * (len(serial_drive[1]) - 1) + [False]


def test_drives_that_cannot_be_reached_are_named(tmp_path: Path, unused_tcp_port: int) -> None:
    config = configured(tmp_path, f'tcp = "127.0.0.1:{unused_tcp_port}"')
    result = typed("probe", str(config))
    assert result.returncode == 1
    assert result.stderr == (
        f"{config}: line.xyz.drives.tcp: 127.0.0.1:{unused_tcp_port} cannot be reached: Connection refused\n"
    )


def test_a_serial_port_that_another_program_holds_is_not_taken(tmp_path: Path) -> None:
    controlling, terminal = os.openpty()
    device = os.ttyname(terminal)
    port, _ = open_port(SerialEndpoint(device))
    config = configured(tmp_path, f'rtu = "{device}"')
    result = typed("probe", str(config))
    port.close()
    os.close(controlling)
    os.close(terminal)
    assert result.returncode == 1
    assert f"line.xyz.drives.rtu: {device} is in use by another program; stop it" in result.stderr


def test_an_axis_that_is_not_there_is_said(tmp_path: Path, drive: tuple[str, list[bytes]]) -> None:
    config = configured(tmp_path, drive[0])
    result = typed("probe", str(config), "--axis", "q")
    assert result.returncode == 1
    assert result.stderr == f"{config}: there is no axis q; there are x\n"
    assert drive[1] == []


@pytest.mark.parametrize("version", [1, 2])
def test_beside_its_own_gateway_it_does_not_probe(
    tmp_path: Path, drive: tuple[str, list[bytes]], version: int
) -> None:
    """Of whatever release it is."""
    config = configured(tmp_path, drive[0])
    place = SocketFile(tmp_path / "state")
    with place.take() as listening:
        listening.setblocking(True)

        def pong() -> None:
            try:
                connection, _ = listening.accept()
            except OSError:
                return  # nobody asked
            with connection:
                connection.recv(300)
                connection.sendall(
                    b'{"kind":"pong","version":%d,"name":"t","gateway_version":"0","pid":1}\n' % version
                )

        threading.Thread(target=pong, daemon=True).start()
        result = typed("probe", str(config))
    place.leave()
    assert result.returncode == 1
    assert "its gateway is running and uses the drives. To probe, stop the gateway first." in result.stderr
    assert drive[1] == []
