"""An upgrade from release 1.0.0 and the way back (docs/upgrade.md), on a state folder that 1.0.0 wrote.

``tests/data/state_of_1.0.0/README.md`` says how. Axis x came up to 50.000 mm: its table adds 0.05 mm there.
Axis y came down to 40.000 mm: the table adds -0.032 mm and the lost motion -0.01 mm, of which it has half.
"""

import contextlib
import io
import os
import shutil
import socket
import subprocess
import sys
import tarfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest

import gateway
from gateway.cli.configuration import compile_for_start_or_exit
from gateway.modbus.mbap import encode_mbap
from tests.support.ports import free_port
from tests.support.processes import COMMAND, ROOT, SECONDS, running

LEFT: Final = ROOT / "tests" / "data" / "state_of_1.0.0"
RELEASE: Final = "cb9e670d"
"""The commit of release 1.0.0."""
STANDS_AT: Final = {(1, 200): 0xC382, (1, 201): 0, (2, 200): 0, (2, 201): 0x9C2B}
"""Registers by unit id and address: 50 050 counts, low word first, and 39 979."""


class Drives:
    """Two drives that go to each position at once, and were under power all the time."""

    def __init__(self, listening: socket.socket) -> None:
        self.told: list[tuple[int, str]] = []
        self._words = dict(STANDS_AT)
        self._listening = listening
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                connection, _ = self._listening.accept()
                threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with contextlib.suppress(OSError), connection:
            while data := connection.recv(300):  # the gateway asks again when it has its answer
                reply = self._reply(data[6], data[7:])
                connection.sendall(data[:4] + (len(reply) + 1).to_bytes(2, "big") + data[6:7] + reply)

    def _reply(self, unit_id: int, pdu: bytes) -> bytes:
        address, count = int.from_bytes(pdu[1:3], "big"), int.from_bytes(pdu[3:5], "big")
        if pdu[0] == 3:
            words = (self._words.get((unit_id, address + n), 0) for n in range(count))
            return bytes((3, 2 * count)) + b"".join(word.to_bytes(2, "big") for word in words)
        self.told.append((unit_id, pdu[6:].hex()))
        for n in range(count):
            self._words[unit_id, address + 100 + n] = int.from_bytes(pdu[6 + 2 * n : 8 + 2 * n], "big")
        return pdu[:5]


class Controller:
    """Asks, and returns the answer."""

    def __init__(self, port: int) -> None:
        self._connection = socket.create_connection(("127.0.0.1", port), timeout=SECONDS)

    def ask(self, unit_id: int, pdu: str) -> str:
        """Send a request, in hexadecimal digits; return what comes back."""
        self._connection.sendall(encode_mbap(7, unit_id, bytes.fromhex(pdu)))
        return self._connection.recv(300)[7:].hex()

    def close(self) -> None:
        self._connection.close()


class Mill:
    """The configuration of the state folder, with drives behind it."""

    def __init__(self, folder: Path, drives: Drives, drives_port: int) -> None:
        shutil.copytree(LEFT, folder, dirs_exist_ok=True)
        (folder / "written").rename(folder / "state")
        self.config = folder / "gateway.toml"
        self.state = folder / "state"
        self.tables = folder / "tables"
        self.drives = drives
        self.port = free_port()
        text = self.config.read_text()
        for was, is_now in ((15502, drives_port), (11502, self.port), (11503, free_port())):
            text = text.replace(f"127.0.0.1:{was}", f"127.0.0.1:{is_now}")
        self.config.write_text(text)

    @contextlib.contextmanager
    def controller(self) -> Iterator[Controller]:
        """A connection to the gateway."""
        controller = Controller(self.port)
        try:
            yield controller
        finally:
            controller.close()


@pytest.fixture
def mill(tmp_path: Path) -> Iterator[Mill]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        yield Mill(tmp_path, Drives(listening), listening.getsockname()[1])


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_this_release_goes_on_from_where_the_axes_stood(mill: Mill) -> None:
    with running("run", str(mill.config)) as program:
        seen: set[tuple[str, str]] = set()
        while not {("restored", "x"), ("restored", "y")} <= seen:
            note = program.next()
            seen.add((note["event"], str(note.get("axis", ""))))
        assert not [note for note in program.notes if note["event"] == "record-not-used"]
        with mill.controller() as cnc:
            assert cnc.ask(1, "03 00C8 0002") == "0304" + "c3500000"  # 50 000, low word first
            assert cnc.ask(2, "03 00C8 0002") == "0304" + "00009c40"  # 40 000
            assert mill.drives.told == []
            # x down to 40.000 mm: the other branch adds 0.04 mm · 40 / 50 = 0.032 mm, so 40 032 counts.
            assert cnc.ask(1, "10 0064 0002 04 9C40 0000") == "1000640002"
            # y up to 50.000 mm: the newer table adds -0.04 mm, the lost motion 0.01 mm, so 49 970 counts.
            assert cnc.ask(2, "10 0064 0002 04 0000 C350") == "1000640002"
        assert mill.drives.told == [(1, "9c600000"), (2, "0000c332")]
        assert program.end() == 0


def test_this_release_starts_with_the_table_of_the_old_one_where_the_file_is_bad(mill: Mill) -> None:
    (mill.tables / "y.tab").write_text("CNC10 TAB FILE VERSION 3\nAXIS Y\nnothing more\n")
    with running("run", str(mill.config)) as program:
        program.until("restored", axis="y")
        with mill.controller() as cnc:
            assert cnc.ask(2, "10 0064 0002 04 0000 C350") == "1000640002"
        assert mill.drives.told == [(2, "0000c332")]
        assert program.end() == 0


@pytest.fixture(scope="module")
def release(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources of release 1.0.0."""
    git = shutil.which("git")
    archived = git and subprocess.run(
        [git, "archive", RELEASE, "gateway"], cwd=ROOT, capture_output=True, check=False
    )
    if not archived or archived.returncode:
        pytest.skip(f"git has no commit {RELEASE} here")
    folder = tmp_path_factory.mktemp("release")
    with tarfile.open(fileobj=io.BytesIO(archived.stdout)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def typed_in(release: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Type a command of an older release."""
    environment = {**os.environ, "PYTHONPATH": str(release)}
    command = [sys.executable, "-P", *COMMAND[1:], *words]
    return subprocess.run(
        command, cwd=release, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )


def test_the_old_release_leaves_a_newer_state_as_it_is_and_names_both_ways_out(
    mill: Mill, release: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gateway, "__version__", "1.0.1")
    compile_for_start_or_exit(mill.config)
    before = files_in(mill.state)
    refused = typed_in(release, "check", "--compile", str(mill.config))
    assert refused.returncode == 1
    assert f"{mill.state} was written by a newer release, 1.0.1 (state version " in refused.stderr
    assert "this is release 1.0.0, which knows versions up to 5): install that release again, or" in (
        refused.stderr
    )
    assert files_in(mill.state) == before
    mill.state.rename(mill.state.with_name("state.newer"))
    assert typed_in(release, "check", "--compile", str(mill.config)).returncode == 0
    assert (mill.state / "plan.msgpack").is_file()


def test_the_old_release_does_not_run_the_plan_of_a_build_between_two_releases(
    mill: Mill, release: Path
) -> None:
    compile_for_start_or_exit(mill.config)
    refused = typed_in(release, "relay", str(mill.config), "--log-format", "console")
    assert refused.returncode == 1
    assert refused.stderr.endswith(f"run: pitch-gateway check --compile {mill.config}\n")
    assert typed_in(release, "check", "--compile", str(mill.config)).returncode == 0
    assert typed_in(release, "check", str(mill.config)).returncode == 0
