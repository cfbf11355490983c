"""``enable``, ``disable``, ``reference``, ``record`` and ``replay`` as a person types them."""

import contextlib
import json
import os
import pty
import signal
import socket
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from gateway.modbus.mbap import encode_mbap
from tests.support.commands import typed
from tests.support.config import RAMP, axis, gateway_toml, line, written
from tests.support.ports import free_port
from tests.support.processes import COMMAND, ROOT, SECONDS, Running, running, started, typed_apart

WRITE = bytes.fromhex("10 0064 0002 04 0000C350")


def acknowledge(drive: socket.socket) -> None:
    """Be a drive that acknowledges FC16, for one connection."""
    try:
        connection, _ = drive.accept()
    except OSError:
        return  # nobody came before the test was over
    with connection, contextlib.suppress(OSError):
        while data := connection.recv(300):
            connection.sendall(data[:4] + bytes((0, 6)) + data[6:12])


@contextlib.contextmanager
def machine_in(parent: Path) -> Iterator[Path]:
    """Lay out a configuration, with a drive behind it and its tables somewhere else."""
    tables = parent / "elsewhere"
    tables.mkdir()
    (tables / "x.tab").write_text(RAMP)
    folder = parent / "machine"
    folder.mkdir()
    with socket.create_server(("127.0.0.1", 0)) as drive:
        text = gateway_toml(
            line(drive.getsockname()[1], {"cnc": free_port()}, response_timeout_ms=500),
            axis(compensation="on", table="x.tab"),
            axis("y", unit_id=2),
            tables=str(tables),
        )
        threading.Thread(target=acknowledge, args=(drive,), daemon=True).start()
        yield written(folder, text, {})


@pytest.fixture
def config(tmp_path: Path) -> Iterator[Path]:
    with machine_in(tmp_path) as config:
        yield config


@contextlib.contextmanager
def up(command: str, config: Path, *more: str) -> Iterator[Running]:
    """Run the gateway; yields it when the drive is reached."""
    with running(command, str(config), *more) as program:
        ready = program.until("ready")
        assert ready["socket"] == str(config.parent / "state" / "relay.sock")
        program.until("line-up")
        yield program


def exchange(port: int, pdu: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=SECONDS) as controller:
        controller.sendall(encode_mbap(1, 1, pdu))
        return controller.recv(300)[7:]


def test_a_gateway_that_runs_is_commanded(config: Path) -> None:
    with up("run", config) as program:
        off = typed("disable", str(config), "x")
        assert (off.returncode, off.stderr) == (0, "")
        assert off.stdout == "x: compensation is off; the correction is removed at the next motion\n"
        on = typed("enable", str(config), "x", "--json")
        assert json.loads(on.stdout) == {"changed": ["x"], "problems": []}
        wrong = typed("enable", str(config), "z", "x")
        assert wrong.returncode == 1
        assert f"{config}: axis z: there is none of that name; there are x, y" in wrong.stderr
        assert program.end() == 0
    assert not (config.parent / "state" / "relay.sock").exists()


def test_an_axis_in_shadow_mode_is_named_when_it_is_enabled(config: Path) -> None:
    config.write_text(config.read_text().replace('compensation = "on"', 'compensation = "shadow"', 1))
    with up("run", config):
        typed("disable", str(config), "x")
        on = typed("enable", str(config), "x")
        assert on.stdout.startswith("x: compensation is on, but not applied: the axis is in shadow mode")
        assert (
            f"{config}: axis x is in shadow mode: corrections are shown, positions pass unchanged"
            in on.stderr
        )


@pytest.mark.parametrize("command", ["enable {}", "disable {} x", "reference {} x --yes"])
def test_without_a_gateway_the_socket_and_the_remedy_are_said(config: Path, command: str) -> None:
    result = typed(*command.format(config).split())
    assert result.returncode == 1
    assert result.stderr == (
        f"{config}: no gateway runs: nothing listens at {config.parent}/state/relay.sock; "
        f"start it with: pitch-gateway run {config}\n"
    )


@pytest.mark.parametrize("command", ["enable {}", "disable {} x", "reference {} x --yes"])
def test_without_a_gateway_a_script_gets_its_json_too(config: Path, command: str) -> None:
    result = typed(*command.format(config).split(), "--json")
    assert result.returncode == 1
    assert json.loads(result.stdout)["changed"] == []
    (problem,) = json.loads(result.stdout)["problems"]
    assert problem.startswith("no gateway runs: nothing listens at")
    assert result.stderr == f"{config}: {problem}\n"


def test_a_gateway_is_commanded_while_its_configuration_is_being_edited(config: Path) -> None:
    with up("run", config):
        config.write_text(config.read_text() + "\n[axis.half]\nline = 1\n")
        assert typed("disable", str(config), "x").returncode == 0


def test_a_second_gateway_on_the_same_folder_is_refused(config: Path) -> None:
    with up("run", config):
        second = typed_apart("run", str(config))
        assert second.returncode == 1
        assert json.loads(second.stderr.splitlines()[-1])["detail"].startswith(
            f"{config}: gateway.state: {config.parent}/state/relay.sock belongs to a gateway that runs"
        )


def test_a_reference_is_not_given_without_being_asked(config: Path) -> None:
    result = typed("reference", str(config), "x")
    assert result.returncode == 2
    assert "give --yes" in result.stderr


@pytest.mark.parametrize(("answer", "said"), [(b"n\n", b"nothing was changed"), (b"y\n", b"no gateway runs")])
def test_on_a_terminal_a_reference_is_asked_for(config: Path, answer: bytes, said: bytes) -> None:
    controlling, terminal = pty.openpty()
    with started(
        [*COMMAND, "reference", str(config), "x"], cwd=ROOT, stdin=terminal, stderr=subprocess.PIPE
    ) as process:
        os.write(controlling, answer)
        assert process.stderr is not None
        text = process.stderr.read()
        assert process.wait(SECONDS) == 1
    os.close(controlling)
    os.close(terminal)
    assert b"Has axis x been homed" in text
    assert said in text


def recorded(config: Path, path: Path) -> Path:
    """Record one corrected target and a command."""
    with up("record", config, str(path)) as program:
        assert exchange(program.port("xyz/cnc"), WRITE) == WRITE[:5]
        assert typed("disable", str(config)).returncode in (0, 1)
        program.process.send_signal(signal.SIGTERM)
        assert program.process.wait(SECONDS) == 0
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording for those that read it, beside its machine."""
    folder = tmp_path_factory.mktemp("recorded")
    with machine_in(folder) as config:
        return recorded(config, folder / "record.jsonl")


def test_a_recording_replays_where_nothing_of_the_machine_is_left(config: Path, tmp_path: Path) -> None:
    recording = recorded(config, tmp_path / "record.jsonl")
    (tmp_path / "elsewhere" / "x.tab").unlink()
    config.unlink()
    result = typed("replay", str(recording))
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout.endswith("outputs: all as recorded\n")
    report = json.loads(typed("replay", str(recording), "--json").stdout)
    assert report["different"] == 0
    assert report["inputs"] >= 3
    assert report["is_cut_off"] is False


def test_traffic_is_shown_with_names_and_positions(recording: Path) -> None:
    result = typed("replay", str(recording), "--show", "--line", "xyz")
    shown = result.stdout
    assert (result.returncode, result.stderr) == (0, "")
    asked = next(line for line in shown.splitlines() if "controller → cnc#1" in line)
    assert "unit 1  write multiple registers  10 00 64 00 02 04 00 00 c3 50  [x command 50 mm]" in asked
    sent = next(line for line in shown.splitlines() if "→ drive" in line)
    assert "10 00 64 00 02 04 00 00 c3 82  [x command 50.05 mm]" in sent
    assert "command disable x" in shown
    assert "* line-up" in shown


def test_another_configuration_exits_with_1_and_the_first_difference(recording: Path, tmp_path: Path) -> None:
    config, text = tmp_path / "gateway.toml", (recording.parent / "machine" / "gateway.toml").read_text()
    config.write_text(text.replace('compensation = "on"', 'compensation = "off"', 1))
    result = typed("replay", str(recording), "--config", str(config))
    assert result.returncode == 1
    first = result.stderr.splitlines()[0]
    file, number, _ = first.split(":", 2)
    assert file == str(recording)
    recorded = recording.read_text().splitlines()[int(number) - 1]
    assert '"kind":"sent"' in recorded
    assert "c382" in recorded
    assert "on line xyz: expected to drive unit 1: write multiple registers" in first
    assert "c3 82, got to drive unit 1: write multiple registers 10 00 64 00 02 04 00 00 c3 50" in first


def test_a_recording_that_was_cut_in_the_middle_of_a_line_is_replayed_so_far(
    recording: Path, tmp_path: Path
) -> None:
    whole = recording.read_bytes()
    cut = tmp_path / "cut.jsonl"
    cut.write_bytes(whole[:-40])
    result = typed("replay", str(cut))
    assert result.returncode == 0
    assert "is truncated: only its complete part is replayed" in result.stderr


def test_a_recording_that_a_power_cut_left_with_zeros_is_replayed(recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.jsonl"
    path.write_bytes(recording.read_bytes() + bytes(300))
    result = typed("replay", str(path))
    assert result.returncode == 0, result.stderr


@pytest.mark.parametrize("last", [b"[]", b"{}", b"no JSON", b'{"other'])
def test_a_last_line_that_is_no_part_of_an_entry_is_refused_with_file_and_line(
    recording: Path, tmp_path: Path, last: bytes
) -> None:
    path = tmp_path / "odd.jsonl"
    whole = recording.read_bytes()
    path.write_bytes(whole + last)
    result = typed("replay", str(path))
    assert result.returncode == 1
    number = whole.count(b"\n") + 1
    assert result.stderr.startswith(f"{path}: line {number}: not an entry of a recording: ")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "not a recording: it does not begin with a header"),
        (b"no JSON\n", "line 1: not an entry of a recording"),
        (b'{"kind":"tick","line":"x","t":1}\n', "not a recording: it does not begin with a header"),
    ],
)
def test_a_file_that_is_no_recording_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "file"
    path.write_bytes(content)
    result = typed("replay", str(path))
    assert result.returncode == 1
    assert said in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_recording_is_never_written_over_another_file(config: Path, tmp_path: Path) -> None:
    path = tmp_path / "precious"
    path.write_text("precious")
    result = typed_apart("record", str(config), str(path))
    assert result.returncode == 1
    assert result.stderr == f"{path}: exists already; name a new file, or remove this one\n"
    assert path.read_text() == "precious"


def test_a_recording_that_cannot_be_made_is_said_before_anything_starts(config: Path, tmp_path: Path) -> None:
    path = tmp_path / "missing" / "record.jsonl"
    result = typed_apart("record", str(config), str(path))
    assert result.returncode == 1
    assert result.stderr == (
        f"{path}: cannot be written (No such file or directory); name a file in your own folder\n"
    )


def test_a_gateway_that_cannot_start_leaves_no_recording(config: Path, tmp_path: Path) -> None:
    path = tmp_path / "record.jsonl"
    with up("run", config):
        assert typed_apart("record", str(config), str(path)).returncode == 1
    assert not path.exists()
