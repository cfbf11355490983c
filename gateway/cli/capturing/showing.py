"""What was captured: into files, or before somebody's eyes."""

import json
import os
import sys
import time
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec
import typer
from rich.console import Console
from rich.text import Text

from gateway.config.load import Loaded
from gateway.config.recording_header import header_of
from gateway.ipc.client import ask
from gateway.ipc.messages import Ping, Pong
from gateway.ipc.place import SocketError, socket_path
from gateway.recording import traffic
from gateway.recording.capture import Capture, Timed, write_recording
from gateway.recording.pcapng import PcapNg
from gateway.recording.readable import Reader
from gateway.state.plan import shape_of
from gateway.times import NS_PER_S, span

EVERY_S: Final = 0.1
STANDARD_OUTPUT: Final = "-"
FRAMES: Final = (traffic.Request, traffic.Answered, traffic.Sent, traffic.Reply)
COLOURS: Final = {"request": "cyan", "answered": "cyan", "sent": "green", "reply": "green"}
"""The side of the controllers, and that of the drives."""
TROUBLE: Final = "red"
LOST: Final = "frames were lost: they came faster than they could be looked at"


class NothingTakenError(Exception):
    """Nothing could be written; why, and what to do."""


@dataclass(frozen=True, slots=True)
class Taken:
    """What was written."""

    frames: int
    seconds: float
    files: tuple[str, ...]

    @property
    def span(self) -> str:
        """How long it lasted, in words."""
        return span(self.seconds)

    def as_data(self) -> dict[str, Any]:
        """Return it for scripts."""
        return {"frames": self.frames, "seconds": round(self.seconds, 6), "files": list(self.files)}


def take(
    loaded: Loaded,
    file: Path | None,
    pcapng: str | None,
    line: str | None,
    *,
    is_following: bool,
    as_json: bool,
) -> Taken | None:
    """Look into the gateway that runs a configuration; return what was written, None where it was printed.

    Raises:
        NoGatewayError, NoCaptureError: there is nothing to look into.
        NothingTakenError: a file cannot be written.
    """
    try:
        socket = socket_path(loaded.state_folder)
    except SocketError as error:
        raise NothingTakenError(f"gateway.state: {error}") from None
    pong = ask(socket, Ping())
    if isinstance(pong, Pong) and pong.shape != shape_of(loaded.plan):
        typer.echo(f"{loaded.path}: is not what the gateway was started with: names may be wrong", err=True)
    capture = Capture(socket, line)
    with ExitStack() as stack:
        stack.callback(capture.close)
        out = _opened(pcapng, stack)
        if is_following:
            with suppress(KeyboardInterrupt):
                _follow(loaded, capture, out, line, as_json=as_json)
            return None
        timed, _ = capture.new()
        if file is None and out is None:
            _print(loaded, capture, timed, as_json=as_json)
            return None
        files = []
        if file is not None:
            _write(loaded, file, timed)
            files.append(str(file))
        if out is not None:
            made = PcapNg(loaded.plan, line)
            out.write(made.head())
            out.writelines(made.packet(entry, capture.wall_ns(t_ns)) for t_ns, entry in timed)
            out.flush()
            files += [] if pcapng in (None, STANDARD_OUTPUT) else [str(pcapng)]
        frames = sum(isinstance(entry, FRAMES) for _, entry in timed)
        seconds = (timed[-1][0] - timed[0][0]) / NS_PER_S if timed else 0.0
        return Taken(frames, seconds, tuple(files))


def _follow(
    loaded: Loaded, capture: Capture, out: BinaryIO | None, line: str | None, *, as_json: bool
) -> None:
    """Go on until somebody ends it, or the gateway its tape."""
    capture.new()  # what was before is for those who do not follow
    made, show = PcapNg(loaded.plan, line), _Showing(loaded, capture, as_json=as_json)
    if out is not None:
        out.write(made.head())
        out.flush()
    while True:
        timed, is_lost = capture.new()
        if is_lost:
            typer.echo(LOST, err=True)
        if out is None:
            for t_ns, entry in timed:
                show.show(t_ns, entry)
            sys.stdout.flush()
        elif timed:
            out.writelines(made.packet(entry, capture.wall_ns(t_ns)) for t_ns, entry in timed)
            out.flush()
        time.sleep(EVERY_S)


def _print(loaded: Loaded, capture: Capture, timed: list[Timed], *, as_json: bool) -> None:
    show = _Showing(loaded, capture, as_json=as_json)
    for t_ns, entry in timed:
        show.show(t_ns, entry)


class _Showing:
    """Prints entries, in words or as JSON lines."""

    def __init__(self, loaded: Loaded, capture: Capture, *, as_json: bool) -> None:
        self._reader = Reader(loaded.plan)
        self._capture = capture
        self._as_json = as_json
        self._console = Console(highlight=False, soft_wrap=True)

    def show(self, t_ns: int, entry: traffic.Entry) -> None:
        if isinstance(entry, traffic.Header | traffic.End | traffic.Port | traffic.Beginning):
            return
        text = self._reader.line(entry)
        if self._as_json:
            time_s = self._capture.wall_ns(t_ns) / NS_PER_S
            when = datetime.fromtimestamp(time_s, UTC).isoformat(timespec="microseconds")
            says = {"time": when, **msgspec.to_builtins(entry), "words": text.split(None, 2)[-1]}
            sys.stdout.write(json.dumps(says, ensure_ascii=False) + "\n")
            return
        kind = traffic.kind_of(entry)
        is_wrong = "exception" in text or kind in ("abandoned", "stray", "down")
        self._console.print(Text(text, TROUBLE if is_wrong else COLOURS.get(kind, "yellow")))


def _write(loaded: Loaded, file: Path, timed: list[Timed]) -> None:
    try:
        write_recording(file, header_of(loaded, traffic.CAPTURED), (entry for _, entry in timed))
    except FileExistsError:
        raise NothingTakenError(
            f"{file}: exists already; write into a new file, or remove this one"
        ) from None
    except OSError as error:
        raise NothingTakenError(f"{file}: cannot be written ({error.strerror or error})") from None


def _opened(pcapng: str | None, stack: ExitStack) -> BinaryIO | None:
    if pcapng is None:
        return None
    if pcapng == STANDARD_OUTPUT:
        return sys.stdout.buffer
    try:
        descriptor = os.open(pcapng, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
    except FileExistsError:
        raise NothingTakenError(f"{pcapng}: exists already; write into a new file, or remove it") from None
    except OSError as error:
        raise NothingTakenError(f"{pcapng}: cannot be written ({error.strerror or error})") from None
    return stack.enter_context(os.fdopen(descriptor, "wb"))
