"""Writes what lets a shell complete ``pitch-gateway``: ``python tools/completions.py FOLDER``.

Each file has the name that its shell looks for: ``bash/pitch-gateway``, ``zsh/_pitch-gateway``,
``fish/pitch-gateway.fish``. They ask the command itself, so that they fit every release.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

NAME = "pitch-gateway"
FILES = {"bash": NAME, "zsh": f"_{NAME}", "fish": f"{NAME}.fish"}
COMMAND = f"import sys; sys.argv = ['{NAME}']; from gateway.cli.main import main; main()"
AT_ONCE = """
# The first time zsh has only read this file: without this the first TAB would do nothing.
[[ $funcstack[1] = _pitch-gateway ]] && _pitch_gateway_completion "$@"
"""


def script(shell: str) -> str:
    """Return what the command itself says for a shell."""
    environment = {**os.environ, "_PITCH_GATEWAY_COMPLETE": f"source_{shell}"}
    done = subprocess.run(
        [sys.executable, "-c", COMMAND], env=environment, stdout=subprocess.PIPE, text=True, check=False
    )
    if NAME not in done.stdout:
        raise SystemExit(f"nothing came to complete {NAME} in {shell} (exit code {done.returncode})")
    return done.stdout.strip() + "\n"


def main() -> None:
    """Do what the command line says."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="where the files go; is made where it is missing")
    folder: Path = parser.parse_args().folder
    for shell, name in FILES.items():
        (folder / shell).mkdir(parents=True, exist_ok=True)
        text = script(shell) + (AT_ONCE if shell == "zsh" else "")
        (folder / shell / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
