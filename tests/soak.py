"""What ``make test`` repeats less often than ``make soak``, test by test.

A twentieth of what is drawn at random (``repeated``). In ``make soak``

- ``exchange/test_cut_streams.py``: 400 moves; ``exchange/test_streams_with_terms.py``: 400 steps;
- ``exchange/test_cut_through_properties.py``: 3000 courses; ``exchange/test_field_counts.py``: 6000 fields;
- ``exchange/test_kills_in_a_stream.py``: 120 streams, each with a kill at each instant;
- ``exchange/test_link_walks.py``: 6000 walks, each a test;
- ``exchange/test_parts_of_positions.py``: 500 examples;
- ``exchange/test_relative_moves.py``: 33 400 moves stored, 5000 in each other way;
- ``exchange/test_record.py``: 500 or 400 kills of each kind;
- ``metrology/test_mutated_readings.py``: 10 000 spoilt files; ``metrology/test_workbook.py``: 400;
- ``processes/test_brokers.py``: a broker that stays away for 60 s;
- ``supervisor/mqtt/test_mqtt_commands.py``: a flood of 6000 commands;
- ``tabfile/test_every_pair.py``: 60 tables for each pair of dialects;
- ``tabfile/test_mutants.py``: 10 000 spoilt files of each dialect;
- each test of Hypothesis that does not say how many examples it needs: 1000.

What takes minutes, and is the same each time (``IS_FULL``). In place of what ``make soak`` does

- ``metrology/test_band.py``: half of the kinds of screw by one method, in place of all by three;
- ``metrology/test_differences.py``: a block is walked along 2 screws, in place of 102;
- ``metrology/test_what_lies_between.py``: each kind of screw is measured twice, in place of four times;
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
