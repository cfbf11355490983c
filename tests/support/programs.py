"""Other programs, run to their end."""

import subprocess
from typing import Any


def ran(*command: object, check: bool = False, **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a program and return what it said."""
    words = [str(word) for word in command]
    return subprocess.run(words, capture_output=True, text=True, check=check, **options)
