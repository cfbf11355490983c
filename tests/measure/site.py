"""A simulated machine on a real socket, the gateway as a process before it, and ``measure`` as a process."""

import asyncio
import contextlib
import json
import os
import signal
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Self

from gateway.ipc.address import SUPERVISOR_SOCKET_NAME, socket_path
from gateway.simulator.bus import DriveBus
from gateway.simulator.clock import scaled_clock
from gateway.simulator.drive import DEFAULT_REGISTERS, SimulatedAxis, SimulatedDrive
from gateway.simulator.drives.catalogue import DRIVES
from gateway.simulator.drives.motor_drive import Motor
from gateway.simulator.endpoints import TcpDriveServer
from gateway.simulator.gauge import Laser
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.motion import Dynamics
from gateway.simulator.screw import PeriodicError, Screw
from gateway.simulator.server import RegisterServer
from tests.support.commands import typed
from tests.support.ports import free_port
from tests.support.processes import COMMAND, ROOT

SECONDS = 120.0
COUNTS_PER_MM = 10_000.0
WORN = Screw(
    length_mm=100.0,
    progressive_um_per_m=400.0,
    bow_um=8.0,
    periodic=(PeriodicError(amplitude_um=2.0, period_mm=20.0, phase_turns=0.1),),
)
"""40 µm of progressive error over 100 mm, a bow, and 4 µm from top to bottom with each turn of the screw."""
CONFIG = """
[gateway]
name = "trial"
tables = "."

[http]
listen = ""

[line.main]
drives = {{ tcp = "127.0.0.1:{drives}" }}

[[line.main.controllers]]
name = "cnc"
{controller}
timeout_ms = 5000

[axis.x]
line = "main"
unit_id = 1
units = "mm"
counts_per_unit = 10000.0
travel = [-5.0, 105.0]
{axis}
"""
REGISTERS = """
referenced = "drive-bit"
home_approach = "forward"
registers.command = [{ address = 0x0100, type = "int32" }]
registers.actual = [{ address = 0x0200, type = "int32" }]
[axis.x.registers.bits]
homed = { address = 0x0204, bit = 0 }
done = { address = 0x0204, bit = 1 }
moving = { address = 0x0204, bit = 2 }
alarm = { address = 0x0204, bit = 3 }
"""


def written_alone(folder: Path, axis: str) -> Path:
    """Write the configuration of a machine that is not there, with these lines of its axis."""
    path = folder / "gateway.toml"
    path.write_text(CONFIG.format(drives=5020, controller='tcp = "127.0.0.1:5021"', axis=axis))
    return path


class Machine:
    """One axis, its drive behind TCP, a laser that sees the nut, and the configuration of its gateway."""

    def __init__(
        self,
        folder: Path,
        *,
        screw: Screw = WORN,
        speed_up: float = 50.0,
        noise_um: float = 0.0,
        axis: str = REGISTERS,
        make: str = "",
    ) -> None:
        self.folder = folder
        self.clock = scaled_clock(speed_up)
        self.mechanics = Mechanics(
            screw,
            Encoder(COUNTS_PER_MM),
            backlash_mm=0.020,
            dynamics=Dynamics(speed_mm_s=100.0, acceleration_mm_s2=2000.0),
        )
        self.laser = Laser(self.mechanics, noise_um=noise_um, seed=7)
        self.drive: RegisterServer = (
            DRIVES[make](1, [Motor("x", self.mechanics)])
            if make
            else SimulatedDrive(1, [SimulatedAxis("x", DEFAULT_REGISTERS, self.mechanics)])
        )
        self.port = free_port()
        self.controller = f'tcp = "127.0.0.1:{self.port}"'
        """Where the gateway listens for the controller, as in its configuration."""
        self._axis = axis
        self._server = TcpDriveServer(DriveBus([self.drive]), self.clock)

    async def __aenter__(self) -> Self:
        await self._server.start()
        self.configure()
        return self

    async def __aexit__(self, *exc_info: object) -> None:
        await self._server.stop()

    @property
    def config(self) -> Path:
        return self.folder / "gateway.toml"

    def configure(self, more: str = "") -> None:
        """Write the configuration; ``more`` are further lines of the axis. It is corrected by default."""
        lines = more + self._axis
        mode = "" if "compensation = " in lines else 'compensation = "on"\n'
        text = CONFIG.format(drives=self._server.port, controller=self.controller, axis=mode + lines)
        self.config.write_text(text)

    async def lose_drive(self) -> None:
        """Take the drive off its network."""
        await self._server.stop()

    def commanded(self) -> list[float]:
        """Positions that the plain drive was sent to, in mm, as they came."""
        field = DEFAULT_REGISTERS.command[0]
        return [
            field.unpack(write.words) / COUNTS_PER_MM
            for write in self.drive.ledger.writes_to(1, field.address)
        ]

    def reading(self) -> float:
        """What the laser shows now, in mm."""
        return self.laser.read_mm(self.clock())


@contextlib.asynccontextmanager
async def gateway(
    machine: Machine, *, has_supervisor: bool = False
) -> AsyncIterator[asyncio.subprocess.Process]:
    """The gateway that runs the machine's configuration, until it reaches the drive and then to the end.

    ``measure`` asks the relay alone, which starts in half the time.
    """
    if not has_supervisor:
        assert typed("check", "--compile", str(machine.config)).returncode == 0
    command = [*COMMAND, "run" if has_supervisor else "relay", str(machine.config), "--log-format", "json"]
    process = await asyncio.create_subprocess_exec(*command, cwd=ROOT, stderr=asyncio.subprocess.PIPE)
    try:
        assert process.stderr is not None
        ready: set[str] = set()
        said = b""
        async with asyncio.timeout(SECONDS):
            while not {"ready", "line-up"} <= ready:
                line = await process.stderr.readline()
                said += line
                assert line, f"the gateway has ended: {said.decode()}"
                if line.startswith(b"{"):  # others warn of the configuration
                    ready.add(json.loads(line)["event"])
        draining = asyncio.create_task(process.stderr.read())
        yield process
        with contextlib.suppress(ProcessLookupError):  # a test has ended it
            process.terminate()
        await asyncio.wait_for(process.wait(), SECONDS)
        await draining
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def supervisor_answers(state: Path) -> None:
    """Wait until the supervisor of a gateway answers; before, a reload is none of its business."""
    path = socket_path(state, SUPERVISOR_SOCKET_NAME)
    async with asyncio.timeout(SECONDS):
        while True:
            with contextlib.suppress(OSError):
                _, writer = await asyncio.open_unix_connection(path)
                writer.close()
                return
            await asyncio.sleep(0.02)  # another process: nothing tells when its socket is there


class Typed:
    """A command that runs: its events as they come, what it says, and its end."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self.process = process
        self.events: list[dict[str, Any]] = []
        self.stderr = ""
        self.stdout = ""

    async def until(
        self, event: str, answer: Callable[[dict[str, Any]], None] | None = None
    ) -> dict[str, Any]:
        """Wait for an event; ``answer`` sees each one that comes meanwhile."""
        assert self.process.stdout is not None
        async with asyncio.timeout(SECONDS):
            while line := await self.process.stdout.readline():
                found: dict[str, Any] = json.loads(line)
                self.events.append(found)
                if answer is not None:
                    answer(found)
                if found["event"] == event:
                    return found
        raise AssertionError(f"it ended without {event}: {await self.end()}: {self.stderr}")

    async def end(self) -> int:
        """Wait for the end; returns the exit code."""
        async with asyncio.timeout(SECONDS):
            stdout, stderr = await self.process.communicate()
        self.stdout += stdout.decode()
        self.stderr += stderr.decode()
        assert self.process.returncode is not None
        return self.process.returncode

    def press_ctrl_c(self) -> None:
        """What a terminal sends for Ctrl-C."""
        self.process.send_signal(signal.SIGINT)

    def of(self, event: str) -> list[dict[str, Any]]:
        return [found for found in self.events if found["event"] == event]


@contextlib.asynccontextmanager
async def measuring(machine: Machine, *arguments: str, stdin: int | None = None) -> AsyncIterator[Typed]:
    """``pitch-gateway measure`` of the machine's axis, in its folder."""
    process = await asyncio.create_subprocess_exec(
        *COMMAND, "measure", str(machine.config), "--axis", "x", *arguments,
        cwd=machine.folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=asyncio.subprocess.DEVNULL if stdin is None else stdin,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        limit=1 << 20,
    )  # fmt: skip
    try:
        yield Typed(process)
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()


async def run_command(*arguments: str) -> None:
    """Run another command of ours, which has to be good."""
    process = await asyncio.create_subprocess_exec(
        *COMMAND, *arguments, cwd=ROOT, stdout=asyncio.subprocess.DEVNULL
    )
    assert await asyncio.wait_for(process.wait(), SECONDS) == 0


class Gauge:
    """The other end of a gauge's cable: a pty that speaks Sylvac's ASCII and shows what the laser sees."""

    def __init__(self, machine: Machine, answer: Callable[[float], bytes] | None = None) -> None:
        from gateway.simulator.pty import Pty

        self._machine = machine
        self._pty = Pty()
        self._answer = answer or (lambda value: f"{value:+.6f}\r".encode())
        self.path = self._pty.path
        self.asked = 0

    def __enter__(self) -> Self:
        asyncio.get_running_loop().add_reader(self._pty.master_fd, self._readable)
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.unplug()

    def unplug(self) -> None:
        with contextlib.suppress(OSError):
            asyncio.get_running_loop().remove_reader(self._pty.master_fd)
        self._pty.close()

    def send(self, data: bytes) -> None:
        os.write(self._pty.master_fd, data)

    def _readable(self) -> None:
        data = os.read(self._pty.master_fd, 100)
        for _ in range(data.count(b"?\r")):
            self.asked += 1
            self.send(self._answer(self._machine.reading()))
