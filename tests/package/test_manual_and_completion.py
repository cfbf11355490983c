"""The man pages are whole and well formed; a shell completes the command for real."""

import os
import pty
import select
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
import typer.main

from gateway.cli.app import app
from tests.support.processes import started
from tests.support.programs import ran

ROOT = Path(__file__).parents[2]
PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def man(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("man")
    subprocess.run([sys.executable, ROOT / "tools" / "man_pages.py", folder], check=True)
    return folder


def test_every_command_has_a_page_with_its_options(man: Path) -> None:
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    for name, command in commands.items():
        page = (man / f"pitch-gateway-{name}.1").read_text()
        assert f"pitch\\-gateway {name}".replace("-", "-") in page
        for parameter in command.params:
            if parameter.param_type_name == "option":
                for option in parameter.opts:
                    assert option.replace("-", "\\-") in page, (name, option)
        for sub in getattr(command, "commands", {}):
            assert (man / f"pitch-gateway-{name}-{sub}.1").exists()
            assert f"pitch\\-gateway\\-{name}\\-{sub} (1)" in page


def test_signs_of_roff_in_a_text_stay_text(man: Path) -> None:
    page = (man / "pitch-gateway-table.1").read_text()
    assert "Centroid .tab" in page  # a line that begins with a point would be a command that does not exist
    for path in man.iterdir():
        commands = {line.split()[0] for line in path.read_text().splitlines() if line.startswith((".", "'"))}
        assert commands <= {".TH", ".SH", ".TP", ".PP", ".B", ".I", ".BR", ".nf", ".fi"}, path


@pytest.mark.skipif(shutil.which("mandoc") is None, reason="mandoc is not there (Debian: mandoc)")
def test_mandoc_finds_nothing(man: Path) -> None:
    done = ran("mandoc", "-T", "lint", "-W", "warning", *sorted(man.iterdir()))
    assert (done.stdout, done.stderr) == ("", "")


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("completions")
    subprocess.run([sys.executable, ROOT / "tools" / "completions.py", folder], check=True)
    command = folder / "bin" / "pitch-gateway"
    command.parent.mkdir()
    # No path in the first line: the kernel takes none with blanks, and none that is long.
    program = "import sys; sys.argv[0] = 'pitch-gateway'; from gateway.cli.main import main; main()"
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -c "{program}" "$@"\n')
    command.chmod(0o755)
    return folder


def typed_into(shell: list[str], lines: list[str], scripts: Path, report: Path) -> str:
    """Type into an interactive shell on a terminal; returns the line that it wrote into the report.

    How a shell paints its line, and how often, is its own business: it is asked for the line itself.
    """
    ours, theirs = pty.openpty()
    environment = {
        "PATH": f"{scripts / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "TERM": "dumb",
        "HOME": str(scripts),
    }
    shown = ""
    options = {"stdin": theirs, "stdout": theirs, "stderr": theirs, "env": environment}
    with started(shell, start_new_session=True, **options) as process:
        os.close(theirs)
        for line in lines:
            os.write(ours, line.encode())
        deadline = time.monotonic() + PATIENCE_S
        while not (report.exists() and report.read_text().endswith("\n")):
            assert process.poll() is None, shown
            assert time.monotonic() < deadline, shown
            if select.select([ours], [], [], 0.1)[0]:
                shown += os.read(ours, 4096).decode(errors="replace")
    os.close(ours)
    return report.read_text().removesuffix("\n")


TYPED = "pitch-gateway ta\t\x18"
"""The first TAB completes; then Control-X has the shell write its line into the report."""


def test_bash_completes_a_command(scripts: Path, tmp_path: Path) -> None:
    report = tmp_path / "line"
    start = [
        f"source '{scripts}/bash/pitch-gateway'\n",
        f"report() {{ echo \"$READLINE_LINE\" > '{report}'; }}; bind -x '\"\\C-x\": report'\n",
    ]
    shown = typed_into(["bash", "--norc", "-i"], [*start, TYPED], scripts, report)
    assert shown == "pitch-gateway table "


@pytest.mark.skipif(shutil.which("zsh") is None, reason="zsh is not there")
def test_zsh_completes_with_the_first_tab(scripts: Path, tmp_path: Path) -> None:
    report = tmp_path / "line"
    start = [
        f"fpath=('{scripts}/zsh' $fpath); autoload -U compinit; compinit -u -D\n",
        f"report() {{ print -r -- $BUFFER > '{report}' }}; zle -N report; bindkey '^X' report\n",
    ]
    shown = typed_into(["zsh", "-f", "-i"], [*start, TYPED], scripts, report)
    assert shown == "pitch-gateway table "


@pytest.mark.skipif(shutil.which("fish") is None, reason="fish is not there")
def test_fish_completes_a_command(scripts: Path) -> None:
    command = f"source '{scripts}/fish/pitch-gateway.fish'; complete --do-complete 'pitch-gateway ta'"
    environment = {
        "PATH": f"{scripts / 'bin'}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "HOME": str(scripts),
    }
    done = ran("fish", "-c", command, env=environment, check=True)
    assert done.stdout.split()[0] == "table"
