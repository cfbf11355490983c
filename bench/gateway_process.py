"""The gateway as a process: how it is started, in one place, and which of its processes is which."""

import contextlib
import functools
import socket
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from bench.errors import BenchError
from bench.gateway_setup import GatewaySetup, write_setup
from bench.places import BUILD, ROOT
from bench.processes import LOGS, Process, Processes, children, command_line, environment

_MAIN: Final = "from gateway.cli.main import main; main()"
_RELAY_MODULE: Final = "gateway.relay"
_SUPERVISOR_MODULE: Final = "gateway.supervisor"
WHOLE_S: Final = 60.0
RETRY_S: Final = 0.1


def gateway_command(*words: str | Path) -> list[str]:
    """Return the command line of ``pitch-gateway WORDS``."""
    return [sys.executable, "-c", _MAIN, *map(str, words)]


@dataclass(frozen=True, slots=True)
class Gateway:
    """A gateway that runs."""

    process: Process
    config: Path
    command: str
    """What it was started as, without ``pitch-gateway``: ``relay`` or ``run``."""

    def pids_once_whole(self, page_port: int) -> tuple[int, ...]:
        """Wait until its page is served; returns all its processes.

        Raises:
            BenchError: it is not.
        """
        until = time.monotonic() + WHOLE_S
        while time.monotonic() < until:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", page_port), 1.0):
                return (self.process.pid, *children(self.process.pid))
            time.sleep(RETRY_S)
        raise BenchError(f"the gateway does not serve its page (see {LOGS})")

    @property
    def relay_pid(self) -> int:
        """Process that carries the traffic."""
        return _child(self.process.pid, _RELAY_MODULE) or self.process.pid

    @property
    def supervisor_pid(self) -> int | None:
        """Process that does the rest; None where there is none."""
        return _child(self.process.pid, _SUPERVISOR_MODULE)


def _child(parent: int, module: str) -> int | None:
    return next((pid for pid in children(parent) if module in command_line(pid).split()), None)


def start_gateway(
    processes: Processes,
    name: str,
    setup: GatewaySetup,
    *,
    is_whole: bool = False,
    cpus: Iterable[int] | None = None,
    packages: Path = ROOT,
    under: Sequence[str] = (),
) -> Gateway:
    """Start a gateway: the relay alone where there is such a command, with ``is_whole`` both processes.

    ``packages``: the folder from which it is imported. ``under``: a program that runs it.

    Raises:
        BenchError: its configuration is refused.
    """
    config = write_setup(BUILD / "setups" / name, setup)
    is_alone = not is_whole and has_command("relay")
    _ask(gateway_command("check", *(["--compile"] if is_alone else []), config))
    command = "relay" if is_alone else "run"
    words = [*under, *gateway_command(command, config)]
    return Gateway(processes.start(name, words, cpus=cpus, packages=packages), config, command)


@functools.cache
def has_command(name: str) -> bool:
    """Whether this version of the gateway has a command."""
    return _run(gateway_command(name, "--help")).returncode == 0


def refusal(setup: GatewaySetup) -> str:
    """Return why this version of the gateway refuses a configuration; empty where it takes it."""
    config = write_setup(BUILD / "setups" / "asked", setup)
    done = _run(gateway_command("check", config))
    return (done.stderr or done.stdout).strip().replace(f"{config}:", "") if done.returncode else ""


def _ask(command: Sequence[str]) -> None:
    done = _run(command)
    if done.returncode:
        raise BenchError(f"the gateway refuses the bench's configuration:\n{done.stderr or done.stdout}")


def _run(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        command, capture_output=True, text=True, check=False, cwd=ROOT, env=environment(), timeout=120
    )
