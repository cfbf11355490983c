"""What a user may not open is named before anything starts; whoever only checks is warned."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from gateway.transport import permissions
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.config.config_bench import GOOD, edited, written
from tests.support.processes import ROOT

NOBODY = 65_534
AS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
LOAD = """
import os, sys
from pathlib import Path
from gateway.config.load import load
from gateway.config.problems import ConfigErrors
if sys.argv[3:]:
    load(Path(sys.argv[1]))  # what that imports another user may not be able to read
    os.setgroups([])
    os.setresgid(*[int(sys.argv[3])] * 3)
    os.setresuid(*[int(sys.argv[3])] * 3)
try:
    found, word = load(Path(sys.argv[1]), is_start=sys.argv[2] == "start").warnings, "warned"
except ConfigErrors as errors:
    found, word = errors.problems, "refused"
for one in found:
    print(f"{word}: {one.key}: {one.found}; {one.remedy}")
"""
PORT = (
    "line.xyz.controllers[2].tcp: no permission to listen on 127.0.0.1:{port}; ports below {first} need "
    "CAP_NET_BIND_SERVICE: pitch-gateway service CONFIG --systemd /etc/systemd/system gives it to the unit; "
    "or choose a higher port"
)
TTY = "line.xyz.drives.rtu: no permission for {device}; add the user to the group dialout "


def said(config: Path, purpose: str, user: int | None) -> list[str]:
    """What a user hears who may open nothing special."""
    command = [sys.executable, "-c", LOAD, str(config), purpose, *([] if user is None else [str(user)])]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, cwd=ROOT)
    return done.stdout.splitlines()


@pytest.fixture
def config() -> Iterator[Path]:
    """A configuration that everybody may read, with a low port and a serial port of a group."""
    with TemporaryDirectory() as name:  # those of pytest are for its own user, whatever their mode was
        folder = Path(name)
        folder.chmod(0o755)
        device = folder / "ttyUSB0"
        device.touch(0o660)
        device.chmod(0o660)
        os.chown(device, 0, 20)  # dialout, Debian's group of serial ports
        changes = (("127.0.0.1:1502", "127.0.0.1:1"), ("/dev/serial/by-id/usb-B", str(device)))
        yield written(folder, edited(*changes))


@AS_ROOT
@pytest.mark.parametrize(("purpose", "word"), [("check", "warned"), ("start", "refused")])
def test_another_user_is_told_of_ports_and_devices(config: Path, purpose: str, word: str) -> None:
    first = permissions.first_free_port()
    if first <= 1:
        pytest.skip("this system lets everybody listen everywhere")
    ports = [line for line in said(config, purpose, NOBODY) if "tcp" in line]
    ttys = [line for line in said(config, purpose, NOBODY) if "rtu" in line]
    assert ports == [f"{word}: {PORT.format(port=1, first=first)}"]
    assert len(ttys) == 1
    assert ttys[0].startswith(f"{word}: {TTY.format(device=config.parent / 'ttyUSB0')}")


@AS_ROOT
def test_root_checks_what_another_user_will_run(config: Path) -> None:
    assert said(config, "check", None) == []


def test_a_capability_is_read_from_the_system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    status, first = tmp_path / "status", tmp_path / "first"
    monkeypatch.setattr(permissions, "STATUS", status)
    monkeypatch.setattr(permissions, "FIRST_FREE_PORT", first)
    first.write_text("80\n")
    status.write_text("CapPrm:\tffffffffffffffff\nCapEff:\t0000000000000000\n")
    assert permissions.why_no_port(TcpEndpoint("::", 80)) is None
    assert permissions.why_no_port(TcpEndpoint("::", 79)) == (
        "no permission to listen on [::]:79",
        PORT.partition("; ")[2].format(first=80),
    )
    status.write_text("CapEff:\t0000000000000400\n")  # bit 10
    assert permissions.why_no_port(TcpEndpoint("::", 79)) is None


def test_a_device_that_is_not_there_is_waited_for(tmp_path: Path) -> None:
    assert permissions.why_no_device(SerialEndpoint(str(tmp_path / "ttyUSB0"))) is None
    assert "usb-B" in GOOD
