"""Programs that a test starts, and that never outlive the test."""

import contextlib
import subprocess
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def started(command: list[str], **options: Any) -> "Iterator[subprocess.Popen[Any]]":
    """``subprocess.Popen`` as a context that kills what still runs at its end.

    ``Popen``'s own context waits for the program, for ever if need be: a failed assertion would hang the run
    where this one shows the failure.
    """
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()
