"""Errors of standard output, distinguished from all other errors of a command."""

import errno
import io
import os
import sys
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

STDOUT: Final = 1


class OutputLostError(Exception):
    """Standard output cannot be written. Not an OSError, so that no command handles it as its own."""

    def __init__(self, error: OSError) -> None:
        super().__init__(error.strerror or str(error))
        self.is_closed_pipe = error.errno == errno.EPIPE


class _Output(io.FileIO):
    """Standard output; after the first failure it discards the rest, so that nothing fails twice."""

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
    """Replaces ``sys.stdout``; closed streams are opened first.

    Otherwise the first opened socket or port would get the free descriptor.
    """

    def __init__(self) -> None:
        for descriptor in range(3):
            _occupy(descriptor)
        if sys.stderr is None:  # Without a reader, stderr is lost; the command continues.
            sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115
        self._raw = _Output(STDOUT, "w", closefd=False)
        before = sys.stdout
        sys.stdout = io.TextIOWrapper(
            io.BufferedWriter(self._raw),
            encoding="utf-8" if before is None else before.encoding,
            errors="backslashreplace",  # file names may contain bytes that are not text
            line_buffering=self._raw.isatty(),
        )

    def finish(self) -> None:
        """Write the remaining output.

        Raises:
            OutputLostError: a write failed, now or before.
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
