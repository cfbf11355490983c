"""Listening on a line that works, as one call: a serial line, or the way between a controller and a drive.

    heard = hear_serial("/dev/ttyUSB0", 60.0)
    print(heard.configuration)

Nothing is ever sent. What is heard depends on what the machine does meanwhile.
"""

import asyncio
import signal
import termios
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from gateway.clock import boot_ns
from gateway.commissioning.first_configuration import PARITIES
from gateway.commissioning.listen.proposal import Place, proposed, unit_data, unit_lines
from gateway.commissioning.listen.proxy import Proxy
from gateway.commissioning.listen.serial_line import SILENCE_MS, Ear, Trial, find_setting, settings_to_try
from gateway.commissioning.listen.traffic import Tally
from gateway.plain import JsonObject
from gateway.times import NS_PER_S
from gateway.transport.endpoints import TcpEndpoint

PROGRESS_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Heard:
    """What passed, by unit id, and where."""

    tally: Tally
    place: Place
    where: dict[str, Any]
    """The same for a program: the port and how it is set, or both ends of the proxy."""

    @property
    def is_understood(self) -> bool:
        """Whether there was a whole frame."""
        return bool(self.tally.units)

    @property
    def configuration(self) -> str:
        """A configuration to begin with; empty where no unit id was told a target."""
        return proposed(self.place, self.tally.units)

    def as_data(self) -> JsonObject:
        """Return everything as plain data."""
        units = {str(unit_id): unit_data(unit_id, unit) for unit_id, unit in sorted(self.tally.units.items())}
        return {**self.where, "units": units, "configuration": self.configuration}

    def lines(self) -> Iterator[str]:
        """Yield it in words, without the configuration."""
        for unit_id, unit in sorted(self.tally.units.items()):
            yield from unit_lines(unit_id, unit)


def hear_serial(
    device: str,
    seconds: float,
    *,
    baudrate: int | None = None,
    parity: str | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> Heard:
    """Listen on a serial port that is opened for reading only, at one setting after the other.

    ``parity``: N, E or O; what is given is not guessed. ``say`` gets a sentence for each setting that was
    tried, and how far it is. Ctrl-C ends it early; so does a port that goes away.

    Raises:
        TransportError: the port is not there, in use, or none.
    """
    tally = Tally()
    trial: Trial | None = None
    until_ns = boot_ns() + int(seconds * NS_PER_S)
    try:
        with Ear(device) as ear, suppress(KeyboardInterrupt):
            if ear.is_pty:
                say(f"{device}: a pseudo terminal has no parity: only baud rates are tried")
            settings = settings_to_try(baudrate, parity, has_parity=not ear.is_pty)
            trial, heard = find_setting(ear, settings, until_ns, say)
            tally.hear(heard)
            if trial is not None and trial.is_right:
                say(f"{trial.setting}: whole frames come")
                _go_on(ear, trial, tally, until_ns, say)
    except (OSError, termios.error) as error:
        say(f"{device}: {error}; what was heard until then follows")
    if trial is None:
        return Heard(tally, Place(), {"port": device, "serial": None})
    return Heard(tally, Place(setting=trial.setting), {"port": device, "serial": _serial_data(trial)})


def hear_proxy(
    near: TcpEndpoint,
    far: TcpEndpoint,
    seconds: float | None = None,
    *,
    say: Callable[[str], None] = lambda _: None,
) -> Heard:
    """Listen on ``near`` in the place of the drive at ``far``, and pass every byte on untouched.

    ``seconds``: None is until SIGINT or SIGTERM. ``say`` gets a sentence when somebody connects, and how far
    it is.

    Raises:
        TransportError: the address is not here, or in use.
    """
    tally = Tally()
    asyncio.run(_serve(near, far, tally, seconds, say))
    return Heard(tally, Place(near=near, far=far), {"port": str(near), "to": str(far)})


def _go_on(ear: Ear, trial: Trial, tally: Tally, until_ns: int, say: Callable[[str], None]) -> None:
    said_ns = boot_ns()
    while (now_ns := boot_ns()) < until_ns:
        data = ear.read(SILENCE_MS)
        tally.hear(trial.feed(data) if data else trial.line.silent())
        if now_ns - said_ns >= PROGRESS_S * NS_PER_S:
            said_ns = now_ns
            left = f"{(until_ns - now_ns) / NS_PER_S:.0f} s to go (Ctrl-C ends)"
            say(f"{_progress(tally)}, {trial.line.bad_bytes} bytes damaged; {left}")


def _progress(tally: Tally) -> str:
    ids = ", ".join(str(unit_id) for unit_id in sorted(tally.units)) or "none yet"
    return f"{tally.requests} requests, unit ids {ids}"


def _serial_data(trial: Trial) -> JsonObject:
    return {
        "baudrate": trial.setting.baudrate,
        "parity": PARITIES[trial.setting.parity],
        "is_sure": trial.is_right,
        "frames": trial.line.frames,
        "damaged_bytes": trial.line.bad_bytes,
        "wrong_characters": trial.unmarking.errors,
    }


async def _serve(
    near: TcpEndpoint, far: TcpEndpoint, tally: Tally, seconds: float | None, say: Callable[[str], None]
) -> None:
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, ended.set)
    if seconds is not None:
        loop.call_later(seconds, ended.set)
    proxy = Proxy(near, far, tally, say)
    await proxy.open()
    say(f"connect the controller to {near.host}:{proxy.port} in place of {far}; Ctrl-C ends it")
    last = ""
    try:
        while not ended.is_set():
            with suppress(TimeoutError):
                async with asyncio.timeout(PROGRESS_S):
                    await ended.wait()
            if (now := _progress(tally)) != last:
                last = now
                say(now)
    finally:
        await proxy.close()
