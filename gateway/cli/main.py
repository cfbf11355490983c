"""``pitch-gateway``: from the words of a command line to a command, and how it ends."""

import sys

from gateway.cli.standard_streams import Output, OutputLostError
from gateway.cli.version import version_line


def main() -> None:
    """Run the command line; exit codes: 0 good, 1 the input is bad, 2 wrong usage.

    Output that cannot be written is one line on stderr and exit code 1; a closed pipe (``| head``) needs no
    words, for whoever closed it knows.
    """
    output = Output()
    try:
        try:
            _run()
        finally:
            output.finish()
    except OutputLostError as error:
        if not error.is_closed_pipe:
            sys.stderr.write(f"standard output cannot be written to: {error}\n")
        sys.exit(1)


def _run() -> None:
    if sys.argv[1:] == ["--version"]:  # typer takes longer to load than all the rest of it
        sys.stdout.write(version_line())
        return
    from gateway.cli.app import app

    app()
