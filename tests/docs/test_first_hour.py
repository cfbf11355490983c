"""The first hour step by step: its files and commands as they stand, with the numbers that it promises."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

from tests.docs.pages import assert_promised, blocks, is_promised
from tests.support.ports import free_port
from tests.support.processes import started

_, _, _, SETUP, *STEPS = blocks("first-hour.md")
STARTS = {
    "pitch-gateway simulate gateway.toml": "Ctrl-C ends it.",
    "pitch-gateway run gateway.toml": '"http-ready"',
}
"""What runs in a terminal of its own, and the words by which its reader knows that all of it is there: the
supervisor reads the configuration as it starts, which on a busy machine may be after the page changed it."""
PORTS = ("5020", "1502", "8480")
LOOK = "pitch-gateway status gateway.toml"
ROOT = Path(__file__).parents[2]
LOOKS = 20
"""What it says is a second old at most (docs/operations.md): a hand on a keyboard is slower than that."""


class Desk:
    """The folder of these steps and its terminals. It has ports of its own: the page's may be taken here."""

    def __init__(self, folder: Path, programs: ExitStack) -> None:
        self.folder = folder
        shutil.copytree(ROOT / "deploy/desk", folder, dirs_exist_ok=True)
        shutil.copytree(ROOT / "deploy/tables", folder / "tables")
        self._programs = programs
        self._ports = {port: str(free_port()) for port in PORTS}
        configuration = folder / "gateway.toml"
        configuration.write_text(self.own(configuration.read_text()))
        path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
        self._environment = os.environ | {"PATH": path, "PYTHONUNBUFFERED": "1"}
        self.running: dict[str, subprocess.Popen[str]] = {}

    def own(self, shown: str) -> str:
        """Return a text of the page with the ports of this desk."""
        for port, own in self._ports.items():
            shown = shown.replace(f"127.0.0.1:{port}", f"127.0.0.1:{own}")
            shown = shown.replace(f"controller.py {port}", f"controller.py {own}")
        return shown

    def type(self, command: str) -> str:
        """Type a command that comes to its end; return what it says."""
        done = subprocess.run(
            ["bash", "-c", self.own(command)],
            cwd=self.folder,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stderr == ""
        return done.stdout

    def start(self, command: str, words: str) -> str:
        """Start a command in a terminal of its own; return what it says up to a line with these words."""
        process = self._programs.enter_context(
            started(
                ["bash", "-c", f"exec {command}"],
                cwd=self.folder,
                env=self._environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        self.running[command] = process
        assert process.stdout is not None
        said: list[str] = []
        for line in process.stdout:
            said.append(line)
            if words in line:
                return "".join(said)
        raise AssertionError(f"{command} ended: {said}")

    def end(self, command: str) -> None:
        """Press Ctrl-C in the terminal of a command."""
        process = self.running.pop(command)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        assert process.returncode == 0


def test_the_first_block_leads_a_terminal_to_the_folder_of_the_five_commands() -> None:
    """What the five commands put there, ``Desk`` has put into its own folder."""
    assert SETUP.language == "sh"
    assert SETUP.text == 'export PATH="$PWD/.venv/bin:$PATH"\ncd ~/desk\n'


def test_everything_that_the_steps_say_happens(tmp_path: Path) -> None:
    with ExitStack() as programs:
        desk = Desk(tmp_path, programs)
        for block in STEPS:
            assert block.language == "console", block
            for command, promised in block.commands():
                if command in desk.running:
                    desk.end(command)
                words = STARTS.get(command)
                said = desk.type(command) if words is None else desk.start(command, words)
                wanted = [desk.own(line) for line in promised]
                for _ in range(LOOKS if command == LOOK else 0):
                    if is_promised(wanted, said):
                        break
                    said = desk.type(command)
                assert_promised(wanted, said)
        for command in list(desk.running):
            desk.end(command)
    assert sum(len(list(block.commands())) for block in STEPS) == 17
