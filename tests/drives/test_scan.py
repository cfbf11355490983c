"""``init --scan``: which setting and which unit ids answer on a line on which nobody speaks."""

import os
import struct
import termios
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gateway.cli.app import app
from gateway.modbus.rtu import encode_rtu
from tests.drives.test_init_command import OWN

REQUEST_BYTES = 8


class Drives:
    """Unit ids 3 and 11 at 38 400 baud, behind a pseudo terminal: it has a baud rate, and no parity."""

    def __init__(self) -> None:
        self._controlling, self._terminal = os.openpty()
        self.port = os.ttyname(self._terminal)
        self.asked: list[bytes] = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        heard = b""
        try:
            while data := os.read(self._controlling, 256):
                heard += data
                while len(heard) >= REQUEST_BYTES:
                    frame, heard = heard[:REQUEST_BYTES], heard[REQUEST_BYTES:]
                    self.asked.append(frame)
                    is_heard = termios.tcgetattr(self._controlling)[5] == termios.B38400
                    if is_heard and frame[0] == 3:
                        os.write(self._controlling, encode_rtu(3, bytes.fromhex("03 02 12 34")))
                    if is_heard and frame[0] == 11:  # it refuses, and so it is there
                        os.write(self._controlling, encode_rtu(11, bytes.fromhex("83 02")))
        except OSError:
            return

    def close(self) -> None:
        os.close(self._terminal)
        self._thread.join(10)
        os.close(self._controlling)


@pytest.fixture
def drives() -> Iterator[Drives]:
    there = Drives()
    yield there
    there.close()


def answers(folder: Path, port: str, *given: str) -> tuple[int, str]:
    (folder / "mine.toml").write_text(OWN)
    arguments = ["init", str(folder / "gateway.toml"), "--controller-compensation-off", "--scan", *given]
    typed = [
        "",
        port,
        "y",
        "",
        "127.0.0.1:1502",
        "",
        "mm",
        "1000",
        "absolute",
        "0",
        "12",
        "none",
        "",
        "n",
        "n",
    ]
    fixed = ["--name", "desk", "--drive", "./mine.toml"]
    result = CliRunner().invoke(app, [*arguments, *fixed], input="\n".join(typed) + "\n")
    return result.exit_code, result.stderr


def test_it_finds_the_setting_and_everybody_who_answers_and_only_reads(
    tmp_path: Path, drives: Drives
) -> None:
    code, said = answers(tmp_path, drives.port, "--ask")
    assert code == 0, said
    assert "This reads register 0x0020 of unit ids 1 to 247" in said
    assert "  57600 8E2: no answer\n" in said  # how the drive is when it is new comes first
    assert "  38400 8E2: unit id 3 answers; trying the others up to 247\n" in said
    assert "  unit ids that reply: 3, 11\n" in said
    assert "stop bits of the drives [38400 8E2]" in said
    assert "Modbus unit id of the drive [3]" in said
    written = tomllib.loads((tmp_path / "gateway.toml").read_text())
    drives_ = written["line"]["main"]["drives"]
    assert (drives_["baudrate"], drives_["parity"]) == (38400, "even")
    assert written["axis"]["x"]["unit_id"] == 3
    # Function code 3, register 0x0020, one register.
    assert {frame[1:6] for frame in drives.asked} == {struct.pack(">BHH", 3, 0x20, 1)}
    assert {frame[0] for frame in drives.asked} == set(range(1, 248))


def test_where_nobody_can_be_asked_nothing_is_sent(tmp_path: Path, drives: Drives) -> None:
    code, said = answers(tmp_path, drives.port, "--no-ask")
    assert code == 2
    assert "confirmation is needed before reading" in " ".join(said.replace("│", " ").split())
    assert drives.asked == []
