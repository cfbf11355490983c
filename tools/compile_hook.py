"""Puts compiled modules into a wheel where the environment asks for them (docs/decisions/0014).

    PITCH_GATEWAY_COMPILED=1 pip install .

Without it a wheel holds the sources alone and runs everywhere.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

VARIABLE = "PITCH_GATEWAY_COMPILED"
NEEDED = ["mypy>=1.19,<3", "setuptools>=70,<90"]


def is_wanted() -> bool:
    """Whether the environment asks for it; what is no answer is refused."""
    value = os.environ.get(VARIABLE, "")
    if value not in ("", "0", "1"):
        raise SystemExit(f"{VARIABLE} = {value!r}: 1 compiles, 0 or nothing does not")
    return value == "1"


class CompiledWheel(BuildHookInterface):  # type: ignore[type-arg]
    """See the module."""

    def dependencies(self) -> list[str]:
        """Return what the compiling needs."""
        return NEEDED if is_wanted() else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile before the wheel is put together."""
        if not is_wanted():
            return
        if version == "editable":
            raise SystemExit(f"an editable install runs its sources: leave {VARIABLE} out, or --editable")
        self._folder = TemporaryDirectory()
        command = [sys.executable, str(Path(self.root, "tools", "compiled.py")), self._folder.name]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(
                f"{done.stdout}{done.stderr}\nthe modules could not be compiled; that needs a C compiler and "
                f"the headers of Python (Debian: gcc, python3-dev). Without {VARIABLE} nothing is compiled"
            )
        folder = Path(self._folder.name)
        for library in folder.rglob("*.so"):
            build_data["force_include"][str(library)] = str(library.relative_to(folder))
        build_data["pure_python"] = False
        build_data["infer_tag"] = True

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Take the compiled files away again."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
