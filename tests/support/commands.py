"""``pitch-gateway``, typed in the process of the test: what a command says and ends with needs no other one.

What a process has besides, its streams and signals, is tested where it is started as one.
"""

from typing import NamedTuple

from typer.testing import CliRunner

from gateway.cli.app import app


class Typed(NamedTuple):
    """What came of a command."""

    returncode: int
    stdout: str
    stderr: str


def typed(*arguments: str) -> Typed:
    """Type a command, but none that becomes another program or logs (run, relay, supervise, record)."""
    result = CliRunner().invoke(app, arguments)
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return Typed(result.exit_code, result.stdout, result.stderr)
