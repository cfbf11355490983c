"""How often a test repeats what it draws at random: in full in ``make soak``, a twentieth of it elsewhere.

That is each test that asks ``repeated``, and each of Hypothesis that does not say how many examples it needs:
1000 in ``make soak``, 50 elsewhere.

And what takes minutes, and is the same each time: in ``make soak`` alone (``IS_FULL``). Elsewhere

- ``metrology/test_differences.py``: a block is walked along 2 screws, in place of 102;
- ``metrology/test_what_lies_between.py``: each kind of screw is measured twice, in place of four times;
- ``processes/test_brokers.py``: a broker stays away for 3 s, in place of 60;
- ``processes/test_streaming_through_saves.py``: each table is saved 10 times, in place of 50;
- ``relay/test_kills_at_any_instant.py``: a relay is killed 3 times, in place of 125;
- ``verify/test_verify.py``: the larger worlds are left out.
"""

import os
from typing import Final

IS_FULL: Final = os.environ.get("SOAK") == "1"


def repeated(number: int) -> int:
    """Return how often to do what is done so often in ``make soak``."""
    return number if IS_FULL else number // 20
