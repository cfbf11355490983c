"""Standard output that cannot be written to, told apart from every other error of a command."""

import errno
import io
import os
import sys
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

STDOUT: Final = 1


class OutputLostError(Exception):
    """Standard output cannot be written to. Not an OSError: no command takes it for one of its own."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error.strerror or str(error))
        self.is_closed_pipe = error.errno == errno.EPIPE


class _Output(io.FileIO):
    """Standard output; after the first failure it swallows the rest, so that nothing fails a second time."""

    failure: OutputLostError | None = None

    def write(self, data: "ReadableBuffer", /) -> int:
        if self.failure is None:
            try:
                return super().write(data)
            except OSError as error:
                self.failure = OutputLostError(error)
                raise self.failure from error
        return memoryview(data).nbytes


class Output:
    """Takes the place of ``sys.stdout``; streams that were closed are opened first.

    A descriptor that is free would otherwise go to the first socket or port that is opened.
    """

    def __init__(self) -> None:
        for descriptor in range(3):
            _occupy(descriptor)
        if sys.stderr is None:  # What nobody reads is lost; that is no reason to stop.
            sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        self._raw = _Output(STDOUT, "w", closefd=False)
        before = sys.stdout
        sys.stdout = io.TextIOWrapper(
            io.BufferedWriter(self._raw),
            encoding="utf-8" if before is None else before.encoding,
            errors="backslashreplace",  # a name of a file may hold bytes that are no text
            line_buffering=self._raw.isatty(),
        )

    def finish(self) -> None:
        """Write what is left.

        Raises:
            OutputLostError: something could not be written, now or before.
        """
        sys.stdout.flush()
        if self._raw.failure is not None:
            raise self._raw.failure


def _occupy(descriptor: int) -> None:
    """Open a closed descriptor in such a way that writing to it fails."""
    try:
        os.fstat(descriptor)
    except OSError:
        opened = os.open(os.devnull, os.O_RDONLY)
        if opened != descriptor:
            os.dup2(opened, descriptor)
            os.close(opened)
