"""The lowest versions that pyproject.toml allows: what a machine may have where nothing newer was installed.

``python -m tools.lowest`` prints them as `NAME==VERSION`, for pip (make test-lowest)
"""

import re
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
FLOOR: Final = re.compile(r"([\w.-]+)(?:\[[\w,-]+\])?>=([\w.]+)")


def lowest(requirements: Iterable[str]) -> list[str]:
    """Return a pin to its lowest version for each requirement that has one.

    >>> lowest(["h11>=0.16.0", "pydantic>=2.10.0,<3", "pymodbus[serial]>=3.16.1", "types-pyyaml"])
    ['h11==0.16.0', 'pydantic==2.10.0', 'pymodbus==3.16.1']
    """
    return [f"{found[1]}=={found[2]}" for each in requirements if (found := FLOOR.match(each))]


def of_project() -> list[str]:
    """Return the pins of what the program runs on."""
    return lowest(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"])


if __name__ == "__main__":
    print("\n".join(of_project()))
