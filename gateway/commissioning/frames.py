"""The last minutes of the lines, read from a running gateway without any work of the gateway.

with LineFrames(load(path)) as frames:
    for frame in frames.new():
        print(frame.words)
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Final, Self

import msgspec

from gateway.config.load import Loaded
from gateway.config.recording_header import header_of
from gateway.ipc.address import SocketError, socket_path
from gateway.ipc.client import ask
from gateway.ipc.messages import Ping, Pong
from gateway.plain import JsonObject
from gateway.recording import traffic
from gateway.recording.capture import Capture, Timed, write_recording
from gateway.recording.pcapng import PcapNg
from gateway.recording.readable import Reader
from gateway.state.plan import shape_of
from gateway.times import NS_PER_S, span

FRAMES: Final = (traffic.Request, traffic.Answered, traffic.Sent, traffic.Reply)
ERROR_KINDS: Final = frozenset({"abandoned", "stray", "down"})


class NothingTakenError(Exception):
    """Nothing could be read or written; the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class LineEntry:
    """A frame, or another event on a line."""

    wall_s: float
    """Seconds since 1970."""
    entry: traffic.Entry
    words: str

    @property
    def kind(self) -> str:
        """Return its kind in a word."""
        return traffic.kind_of(self.entry)

    @property
    def is_error(self) -> bool:
        """Whether it is an error."""
        return "exception" in self.words or self.kind in ERROR_KINDS

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        when = datetime.fromtimestamp(self.wall_s, UTC).isoformat(timespec="microseconds")
        return {"time": when, **msgspec.to_builtins(self.entry), "words": self.words.split(None, 2)[-1]}


@dataclass(frozen=True, slots=True)
class Taken:
    """The files that were written."""

    frames: int
    seconds: float
    files: tuple[str, ...]

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        return {"frames": self.frames, "seconds": round(self.seconds, 6), "files": list(self.files)}

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        for path in self.files:
            yield f"{self.frames} frames of {span(self.seconds)} in {path}"


@contextmanager
def _naming(out: BinaryIO) -> Iterator[None]:
    """Name the file that cannot be written, for example on a full disk; a pipe without a reader is none."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise NothingTakenError(f"{out.name}: cannot be written ({error.strerror or error})") from None


class LineFrames:
    """The frames in a gateway's trace buffer, of one line or of all; entering it borrows them.

    Raises:
        NoGatewayError, NoCaptureError: there is no buffer; also on entering.
        NothingTakenError: the state folder cannot have a socket.
    """

    def __init__(self, loaded: Loaded, line: str | None = None) -> None:
        try:
            self._socket = socket_path(loaded.state_folder)
        except SocketError as error:
            raise NothingTakenError(f"gateway.state: {error}") from None
        pong = ask(self._socket, Ping())
        self.is_of_another = isinstance(pong, Pong) and pong.shape != shape_of(loaded.plan)
        """Whether the gateway was started with another configuration: names may then be wrong."""
        self._loaded = loaded
        self._line = line
        self._reader = Reader(loaded.plan)
        self._pcapng = PcapNg(loaded.plan, line)
        self._capture: Capture | None = None
        self.is_lost = False
        """Whether frames were overwritten before the last call could read them."""

    def __enter__(self) -> Self:
        """Borrow the memory of the frames."""
        self._capture = Capture(self._socket, self._line)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Return it."""
        if self._capture is not None:
            self._capture.close()

    def skip(self) -> None:
        """Skip the frames so far."""
        self._new()

    def new(self) -> list[LineEntry]:
        """Return the frames since the last call."""
        return [
            LineEntry(self._wall_ns(t_ns) / NS_PER_S, entry, self._reader.line(entry))
            for t_ns, entry in self._new()
            if not isinstance(entry, traffic.Header | traffic.End | traffic.Port | traffic.Beginning)
        ]

    def begin_packets(self, out: BinaryIO) -> None:
        """Write the beginning of a file that Wireshark reads. Raises NothingTakenError: it is not written."""
        with _naming(out):
            out.write(self._pcapng.head())
            out.flush()

    def write_packets(self, out: BinaryIO) -> None:
        """Write the frames since the last call to such a file. Raises NothingTakenError: see above."""
        self._write_packets(out, self._new())

    def take(self, file: Path | None, out: BinaryIO | None, name: str | None) -> Taken:
        """Write all frames to a new file for ``replay``, and to one for Wireshark.

        ``name`` is the name of the latter, None if it is not a file.

        Raises:
            NothingTakenError: the file exists, or cannot be written.
        """
        timed = self._new()
        files = []
        if file is not None:
            self._write_recording(file, timed)
            files.append(str(file))
        if out is not None:
            self.begin_packets(out)
            self._write_packets(out, timed)
            files += [] if name is None else [name]
        frames = sum(isinstance(entry, FRAMES) for _, entry in timed)
        seconds = (timed[-1][0] - timed[0][0]) / NS_PER_S if timed else 0.0
        return Taken(frames, seconds, tuple(files))

    def _new(self) -> list[Timed]:
        assert self._capture is not None, "enter it first"
        timed, self.is_lost = self._capture.new()
        return timed

    def _wall_ns(self, t_ns: int) -> int:
        assert self._capture is not None
        return self._capture.wall_ns(t_ns)

    def _write_packets(self, out: BinaryIO, timed: list[Timed]) -> None:
        if timed:
            with _naming(out):
                out.writelines(self._pcapng.packet(entry, self._wall_ns(t_ns)) for t_ns, entry in timed)
                out.flush()

    def _write_recording(self, file: Path, timed: list[Timed]) -> None:
        try:
            write_recording(file, header_of(self._loaded, traffic.CAPTURED), (entry for _, entry in timed))
        except FileExistsError:
            raise NothingTakenError(f"{file}: exists already; name a new file, or remove this one") from None
        except OSError as error:
            raise NothingTakenError(f"{file}: cannot be written ({error.strerror or error})") from None
