"""``pitch-gateway listen`` on three simulated lines, and as a proxy in front of a drive."""

import json
import os
import re
import signal
import socket
import subprocess
import threading
import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gateway.cli.app import app
from gateway.commissioning.listen.serial_line import PortSettings, Sniffer
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
from gateway.transport.errors import RefusedError
from tests.listen.lines import Frames, Registers, SimulatedLine
from tests.support.processes import COMMAND, started

LISTEN = [*COMMAND, "listen"]
TARGETS = (10000, -2500, 71234, 1)


def oriental() -> Frames:
    """Unit 3: targets into the block of direct data, a trigger, a look at the status; unit 4 is refused."""
    drive = Registers(0x005C, 0x00CC)
    for frames in (drive.goes(3, (target,)) for target in TARGETS[:3]):
        yield from frames
        yield 3, bytes.fromhex("10 0066 0002 04 0000 0001")
        yield 3, bytes.fromhex("10 0066 0002")
        yield 3, bytes.fromhex("03 007F 0001")
        yield 3, bytes.fromhex("03 02 4000")
        yield 4, bytes.fromhex("03 00CC 0002")
        yield 4, bytes.fromhex("83 02")


def unheard_of() -> Frames:
    """Unit 7: a drive that nobody knows, low word first."""
    return Registers(0x7606, 0x7520, is_low_first=True).goes(7, TARGETS)


def leadshine() -> Frames:
    """Units 1 and 2: path 0 and its trigger."""
    for unit_id in (1, 2):
        for target in TARGETS[:3]:
            yield from Registers(0x6201, 0x602C).goes(unit_id, (target,))
            yield unit_id, bytes.fromhex("06 6002 0010")
            yield unit_id, bytes.fromhex("06 6002 0010")


def test_three_lines_are_understood(tmp_path: Path) -> None:
    """Each listened to by a process, all at once: nothing but the bytes tells them how a line is set."""
    heard: list[dict[str, Any]] = []
    with ExitStack() as exits:
        speakers = ((115200, oriental), (9600, unheard_of), (38400, leadshine))
        lines = [exits.enter_context(SimulatedLine(rate, frames)) for rate, frames in speakers]
        ears = [
            exits.enter_context(
                started(
                    [*LISTEN, line.path, "--for", "12", "--json", "--out", str(tmp_path / f"{n}.toml")],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )
            for n, line in enumerate(lines)
        ]
        for sniffer in ears:
            out, errors = sniffer.communicate(timeout=120)
            assert sniffer.returncode == 0, errors
            assert "whole frames received" in errors
            heard.append(json.loads(out))
    assert [line.was_sent for line in lines] == [b"", b"", b""]
    assert [each["serial"]["baudrate"] for each in heard] == [115200, 9600, 38400]
    assert [each["serial"]["is_sure"] for each in heard] == [True, True, True]

    first, second, third = (each["units"] for each in heard)
    assert list(first) == ["3", "4"]
    assert first["3"]["sounds_like"] == ["oriental-az", "oriental-blv-r"]
    assert first["4"]["exceptions"]["2"] == first["4"]["answered"] > 0
    assert list(second) == ["7"]
    assert second["7"]["sounds_like"] == []
    guess = second["7"]["positions"][0]
    assert (guess["command"], guess["actual"], guess["words"]) == (0x7606, 0x7520, "low-first")
    assert all("leadshine-pr" in third[unit_id]["sounds_like"] for unit_id in ("1", "2"))

    proposals = [tomllib.loads((tmp_path / f"{n}.toml").read_text()) for n in range(3)]
    assert proposals[0]["axis"]["x"]["drive"] == "oriental-az"
    assert list(proposals[0]["axis"]) == ["x"]  # unit 4 was told no target
    assert proposals[0]["line"]["main"]["drives"]["baudrate"] == 115200
    command = {"address": 0x7606, "type": "int32", "words": "low-first"}
    assert proposals[1]["axis"]["x"]["registers"]["command"] == [command]
    assert [proposals[2]["axis"][name]["unit_id"] for name in "xy"] == [1, 2]


def filled_in(text: str) -> str:
    """Fill in what nobody can hear."""
    for key, value in (
        ("counts_per_unit", "1000.0"),
        ("referenced", '"absolute"'),
        ("travel", "[0.0, 100.0]"),
    ):
        text = re.sub(rf"^# {key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
    return text


class DriveServer:
    """A Modbus/TCP drive: FC16 is acknowledged, a read answered with the last target."""

    def __init__(self) -> None:
        self.heard = b""
        self.server = socket.create_server(("127.0.0.1", 0))
        self.port = self.server.getsockname()[1]
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def _serve(self) -> None:
        connection, _ = self.server.accept()
        target = b"\x00\x00\x00\x00"
        with connection:
            while data := connection.recv(1024):
                self.heard += data
                if data[7] == 0x10:
                    target = data[13:17]
                    connection.sendall(data[:4] + b"\x00\x06" + data[6:12])
                else:
                    connection.sendall(data[:4] + b"\x00\x07" + data[6:8] + b"\x04" + target)

    def close(self) -> None:
        self._thread.join()
        self.server.close()


def test_a_proxy_passes_everything_on_and_listens(tmp_path: Path) -> None:
    drive = DriveServer()
    out = tmp_path / "gateway.toml"
    command = [*LISTEN, "127.0.0.1:0", "--to", f"127.0.0.1:{drive.port}", "--out", str(out), "--json"]
    with started(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as proxy:
        assert proxy.stderr is not None
        found = re.search(r"127\.0\.0\.1:(\d+) in place of", proxy.stderr.readline())
        assert found is not None
        sent = got = b""
        with socket.create_connection(("127.0.0.1", int(found[1])), timeout=30) as controller:
            for number, target in enumerate(TARGETS):
                for pdu in (
                    b"\x10\x62\x01\x00\x02\x04" + target.to_bytes(4, "big", signed=True),
                    bytes.fromhex("03 602C 0002"),
                ):
                    request = number.to_bytes(2, "big") + b"\x00\x00" + (len(pdu) + 1).to_bytes(2, "big")
                    sent += request + b"\x01" + pdu
                    controller.sendall(request + b"\x01" + pdu)
                    got += controller.recv(1024)
        drive.close()
        proxy.send_signal(signal.SIGINT)
        stdout, _ = proxy.communicate(timeout=60)
    assert proxy.returncode == 0
    assert drive.heard == sent
    assert got.hex().count("0003000000070103040000") == 1  # the last reply: 1, as told
    heard = json.loads(stdout)
    unit = heard["units"]["1"]
    assert (unit["requests"], unit["answered"]) == (8, 8)
    assert "leadshine-pr" in unit["sounds_like"]
    assert unit["uses"][0] == {
        "function": 16,
        "is_write": True,
        "address": 0x6201,
        "quantity": 2,
        "count": 4,
    }
    text = out.read_text(encoding="utf-8")
    assert f'drives = {{ tcp = "127.0.0.1:{drive.port}" }}' in text


def test_what_is_proposed_lacks_what_nobody_can_hear_and_nothing_else(tmp_path: Path) -> None:
    from gateway.commissioning.listen.overhearing import Overhearing
    from gateway.commissioning.listen.proposal import ListenPoint, proposed
    from gateway.commissioning.listen.traffic import TrafficStatistics
    from gateway.modbus.rtu import encode_rtu

    for frames in (oriental, unheard_of, leadshine):
        line, statistics = Overhearing(), TrafficStatistics()
        for unit_id, pdu in frames():
            statistics.add(line.feed(encode_rtu(unit_id, pdu)))
        text = proposed(ListenPoint(setting=PortSettings(9600, "E")), statistics.units)
        file = tmp_path / "gateway.toml"
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigErrors) as caught:
            load(file)
        missing = {problem.key.rpartition(".")[2] for problem in caught.value.problems}
        assert missing <= {"counts_per_unit", "referenced", "travel"}, str(caught.value)
        file.write_text(filled_in(text), encoding="utf-8")
        load(file)


def test_a_port_is_opened_for_reading_only() -> None:
    with SimulatedLine(9600, unheard_of) as line, Sniffer(line.path) as sniffer:
        sniffer.set(PortSettings(9600, "N"))
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.write(sniffer._fd, b"\x01")


def test_a_port_in_use_is_not_listened_to() -> None:
    with SimulatedLine(9600, unheard_of) as line, Sniffer(line.path):  # noqa: SIM117 - the second may not open
        with pytest.raises(RefusedError, match="in use by another program"):
            Sniffer(line.path).__enter__()


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["/dev/nowhere"], 1, "/dev/nowhere is not there"),
        (["/dev/null"], 1, "/dev/null is not a serial port"),
        (["nonsense", "--to", "127.0.0.1:502"], 2, 'found "nonsense"; allowed: HOST:PORT'),
        (["127.0.0.1:0", "--to", "127.0.0.1:502", "--parity", "even"], 2, "TCP has neither"),
        (["/dev/null", "--parity", "mark"], 2, "allowed: none, even, odd"),
        (["/dev/null", "--baudrate", "12345"], 2, "found 12345; allowed: 50, 75, 110, "),
    ],
)
def test_what_is_wrong_is_said(arguments: list[str], code: int, said: str) -> None:
    result = CliRunner().invoke(app, ["listen", *arguments], env={"COLUMNS": "200"})
    assert result.exit_code == code
    assert said in result.output


def test_a_line_that_says_nothing_is_said_to() -> None:
    master, slave = os.openpty()
    result = CliRunner().invoke(app, ["listen", os.ttyname(slave), "--for", "0.2", "--baudrate", "9600"])
    os.close(master)
    os.close(slave)
    assert result.exit_code == 1
    assert "9600 8N: 0 bytes, 0 whole frames" in result.output
    assert "no frame was understood" in result.output
