"""Commands of ours, run by a user whom the kernel refuses things.

Root is refused nothing and becomes another user, who may not be able to enter the folder of this checkout or
of the interpreter. So a command runs twice in its process: first as we are, on a file that is not there, to
import what it needs; then as that user. In every checkout, closed or open, it is ended with a sentence where
it then imports a module, or opens a file of this checkout or of the interpreter.

The processes are forked from one program that has imported the command line:
``python -m tests.support.lesser``.
"""

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NoReturn

from tests.support.processes import started

ROOT: Final = Path(__file__).parents[2]
NOBODY: Final = 65534
SECONDS: Final = 100
"""A command that hangs on what it was given is ended by SIGALRM after this."""
CLOSED: Final = tuple(f"{folder}/" for folder in (ROOT, sys.prefix, sysconfig.get_path("stdlib")))
"""What another user may not be able to enter."""
LATE: Final = 99
"""The exit code of a command that another user could not have run."""


@contextlib.contextmanager
def nobody() -> Iterator[None]:
    """Be somebody whom the kernel refuses things, for a while; root opens everything."""
    was_root = os.geteuid() == 0
    if was_root:
        os.seteuid(NOBODY)
    try:
        yield
    finally:
        if was_root:
            os.seteuid(0)


def become_lesser() -> None:
    """Be somebody whom the kernel refuses things, for good, with everything imported that is still needed."""
    if os.geteuid() == 0:
        os.setgroups([])
        os.setresgid(NOBODY, NOBODY, NOBODY)
        os.setresuid(NOBODY, NOBODY, NOBODY)
    sys.addaudithook(_refuse_what_comes_late)


def _refuse_what_comes_late(event: str, arguments: tuple[Any, ...]) -> None:
    is_late = (event == "import" and arguments[0] not in sys.builtin_module_names) or (
        event in {"open", "os.listdir", "os.scandir"} and str(arguments[0]).startswith(CLOSED)
    )
    if is_late:
        said = f"{event} of {arguments[0]} by a user who may not be able to enter its folder: do it before\n"
        os.write(2, said.encode())
        os._exit(LATE)


class Lesser:
    """The program that runs them, one after the other."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process

    def run(self, command: str, path: Path | str) -> "subprocess.CompletedProcess[str]":
        """Run the words of a command of which one is ``{}``, a path."""
        words, before = (
            [word.replace("{}", each) for word in command.split()] for each in (str(path), f"{path}.none")
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps([before, words]) + "\n")
        self._process.stdin.flush()
        code, out, err = json.loads(self._process.stdout.readline())
        return subprocess.CompletedProcess(words, code, out, err)


@contextlib.contextmanager
def lesser() -> Iterator[Lesser]:
    command = [sys.executable, "-m", "tests.support.lesser"]
    with started(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as process:
        yield Lesser(process)


def _serve() -> None:
    from gateway.cli.app import COMMANDS

    for name in (*(f"gateway.cli.{command}" for command in COMMANDS), "gateway.config.load"):
        importlib.import_module(name)  # those that are forked have them then
    for line in sys.stdin:
        before, words = json.loads(line)
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            child = os.fork()
            if child == 0:
                _run(before, words, out.fileno(), err.fileno())
            _, status = os.waitpid(child, 0)
            texts = [os.pread(file.fileno(), 1 << 20, 0).decode() for file in (out, err)]
        sys.stdout.write(json.dumps([os.waitstatus_to_exitcode(status), *texts]) + "\n")
        sys.stdout.flush()


def _run(before: list[str], words: list[str], out: int, err: int) -> NoReturn:
    signal.alarm(SECONDS)
    nothing = os.open(os.devnull, os.O_RDWR)
    _redirect(nothing, nothing, nothing)
    _code(before)
    _redirect(nothing, out, err)
    become_lesser()
    os._exit(_code(words))


def _redirect(*streams: int) -> None:
    for descriptor, stream in enumerate(streams):
        os.dup2(stream, descriptor)


def _code(words: list[str]) -> int:
    """Run the command line as a shell does; returns its exit code, which for a traceback is 1."""
    from gateway.cli.main import main

    sys.argv = ["pitch-gateway", *words]
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    except BaseException:  # noqa: BLE001 - as the interpreter would
        sys.excepthook(*sys.exc_info())
        return 1
    finally:
        sys.stderr.flush()
    return 0


if __name__ == "__main__":
    _serve()
