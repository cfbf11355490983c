"""``pitch-gateway``: from a command line to a command, and its end."""

import gc
import sys
from typing import Final

from gateway.cli.standard_streams import Output, OutputLostError
from gateway.cli.version import version_line

NEW_OBJECTS: Final = 50_000
"""Python searches for garbage after so many of them; by default after 700."""


def main() -> None:
    """Run the command line; ``gateway.catalogue.starts`` has the exit codes.

    If output cannot be written, stderr gets one line and the exit code is 1. A closed pipe (``| head``) needs
    no message: its reader closed it.
    """
    output = Output()
    try:
        try:
            _run()
        finally:
            output.finish()
            gc.freeze()  # the process ends: Python would search all that is loaded for garbage once more
    except OutputLostError as error:
        if not error.is_closed_pipe:
            sys.stderr.write(f"standard output cannot be written to: {error}\n")
        sys.exit(1)


def _run() -> None:
    if sys.argv[1:] == ["--version"]:  # typer takes longer to load than everything else here
        sys.stdout.write(version_line())
        return
    # Loaded modules are never garbage, and a command loads more of them: searching them costs a tenth of it.
    gc.set_threshold(NEW_OBJECTS)
    from gateway.cli.app import app

    app()
