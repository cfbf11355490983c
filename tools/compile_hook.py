"""Puts compiled modules into a wheel where the environment asks for them (docs/decisions/0028).

    PITCH_GATEWAY_COMPILED=1 pip install .

Without it a wheel holds the sources alone and runs everywhere.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "PITCH_GATEWAY_COMPILED"
SPACE_MB = 150
"""What the compiling takes of the disk, rounded up."""


def is_wanted() -> bool:
    """Whether the environment asks for it; what is no answer is refused."""
    value = os.environ.get(VARIABLE, "")
    if value not in ("", "0", "1"):
        raise SystemExit(f"{VARIABLE} = {value!r}: 1 compiles, 0 or nothing does not")
    return value == "1"


def reason(output: str) -> str:
    """Return why the compiling failed, in one line: the first real error in what was said, and what to do."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    if any("No space left on device" in line for line in lines):
        return (
            f"the disk is full: free {SPACE_MB} MB in the folder of temporary files, or set TMPDIR to another"
        )
    errors = [line for line in lines if re.search(r"\b[Ee]rror: ", line)]
    if errors and re.match(r"\S+\.pyi?:\d+: ", errors[0]):
        return (
            f"mypy refuses {errors[0]} (a mistake of this release, or a version of mypy or of a package "
            "that it was not made for)"
        )
    return (errors or lines[-1:] or ["it ended without a word"])[0]


class CompiledWheel(BuildHookInterface):  # type: ignore[type-arg]
    """See the module."""

    def dependencies(self) -> list[str]:
        """Return what the compiling needs."""
        return self._compiled("--needs").splitlines() if is_wanted() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile before the wheel is put together."""
        if not is_wanted():
            return
        if version == "editable":
            raise SystemExit(f"an editable install runs its sources: leave {VARIABLE} out, or --editable")
        self._folder = TemporaryDirectory()
        self._compiled(self._folder.name)
        folder = Path(self._folder.name)
        for library in folder.rglob("*.so"):
            build_data["force_include"][str(library)] = str(library.relative_to(folder))
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Take the compiled files away again."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()

    def _compiled(self, argument: str) -> str:
        """Run the tool; returns what it said."""
        command = [sys.executable, str(Path(self.root, "tools", "compiled.py")), argument]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            self.finalize("", {}, "")
            raise SystemExit(
                f"pitch-gateway could not be compiled: {reason(done.stdout + done.stderr)}\n"
                f"without {VARIABLE}=1 (install.sh: with --pure) it is installed as Python"
            )
        return done.stdout
