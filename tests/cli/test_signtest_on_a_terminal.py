"""``pitch-gateway signtest`` with a person at the keyboard."""

import os
import subprocess
from pathlib import Path

from tests.cli.test_signtest_command import configured
from tests.support.processes import COMMAND


def test_on_a_terminal_it_asks_for_the_move_first(tmp_path: Path) -> None:
    config = configured(tmp_path)
    controlling, terminal = os.openpty()
    command = [*COMMAND, "signtest", str(config), "--axis", "x"]
    with subprocess.Popen(command, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as asking:
        os.write(controlling, b"10\n")
        said, asked = asking.communicate(timeout=60)
    os.close(controlling)
    os.close(terminal)
    assert (asking.returncode, "command one move up, then 1 mm more" in asked.decode()) == (1, True), asked
    assert b"counts_per_unit should be about 100, not 1000" in said
