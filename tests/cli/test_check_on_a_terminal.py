"""``check --resolved`` on a terminal."""

import os
import pty
from pathlib import Path

from tests.support.config import one_axis, written
from tests.support.processes import COMMAND, started


def test_resolved_has_colours_on_a_terminal_and_no_line_is_cut(tmp_path: Path) -> None:
    path = written(tmp_path, one_axis(1, 2))
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "40"}
    environment.pop("NO_COLOR", None)
    command = [*COMMAND, "check", "--resolved", str(path)]
    with started(command, stdout=theirs, env=environment) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                part = os.read(ours, 65536)
            except OSError:  # the other end is closed
                break
            if not part:
                break
            shown += part
        assert process.wait(60) == 0
    os.close(ours)
    first = shown.splitlines()[0]
    assert b'\x1b[1mgateway.name\x1b[0m = \x1b[32m"trial"\x1b[0m' in first
    assert f"{path}:3".encode() in first
