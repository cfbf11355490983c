"""How often a test repeats what it draws at random: in full in ``make soak``, a tenth of it elsewhere.

And what takes minutes, and is the same each time: in ``make soak`` alone (``IS_FULL``).
"""

import os
from typing import Final

IS_FULL: Final = os.environ.get("SOAK") == "1"


def repeated(number: int) -> int:
    """Return how often to do what is done so often in ``make soak``."""
    return number if IS_FULL else number // 10
