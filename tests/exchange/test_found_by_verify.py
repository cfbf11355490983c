"""What ``make verify`` has found: the shortest traces to rules that were broken.

Each plays events in a small world of ``tests.verify``; what goes over the wires stands beside them. A drive
counts 1000 per mm on the table ``tests.verify.screw.WORN``.
"""

from dataclasses import replace

from tests.verify.designs import BY_NAME
from tests.verify.explore import play
from tests.verify.world import Happening

ACK = ("drive", "ack")
REFUSE = ("drive", "refuse")
ARRIVE = ("arrive", 0)
RUN = ("ask", 0, "run", 0)


def to(target: int, axis: int = 0) -> Happening:
    """The controller writes one of the targets of the world."""
    return ("ask", 0, "to", axis, target)


def test_a_beam_does_not_go_while_the_target_of_one_of_its_axes_is_lost() -> None:
    """M11: both axes of a group lost their target; the new one of x is no target of y."""
    lost = (
        to(0, axis=0),  # unit 1: 10 0606 0002 04 232F 0000, sent as 10 0606 0002 04 235E 0000
        REFUSE,  # 90 04: blocks both axes, for the sake of x
        to(0, axis=1),  # unit 2: the same
        REFUSE,  # 90 04: y lost one of its own
        to(0, axis=0),
        ACK,  # x has a new one
        RUN,  # 06 050E 0001 is answered 86 04: y has none
    )
    assert ACK not in play(BY_NAME["group"], *lost).happenings()
    anew = (*lost, to(0, axis=1), ACK, RUN)
    assert ACK in play(BY_NAME["group"], *anew).happenings()


def test_a_reading_decides_no_branch_after_two_targets_that_came_without_one() -> None:
    """M6: where the axis stood when its last target came was assumed, so its reading is judged on the drive's
    scale."""
    play(
        BY_NAME["late-start"],
        to(0),  # 10 0606 0002 04 E4A5 FFFF: -7003
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 E425 FFFF: backward to -7131
        ARRIVE,
        to(1),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> E425 FFFF
        ACK,  # 10 0606 0002 04 23D4 0000; 80 ms pass, and it has not begun to move
        to(0),
        ACK,  # 03 0520 0002 -> E425 FFFF
        ACK,  # 10 0606 0002 04 E502 FFFF: flagged, for nothing tells
        to(1),
        ACK,  # 10 0606 0002 04 23D4 0000, by the reading of 80 ms ago
        to(0),
        ACK,  # 03 0520 0002 -> E425 FFFF: where the backward branch puts -7003
        ACK,  # 10 0606 0002 04 E502 FFFF: forward to -6910, 221 counts away, and not flagged
    )


def test_a_target_given_again_after_its_axis_moved_on_is_flagged_where_nothing_tells_its_branch() -> None:
    """M6: it gets the words of the first time, and its axis has moved on since."""
    play(
        BY_NAME["deaf"],
        to(1),  # 10 0606 0002 04 233B 0000: 9019
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23E0 0000: forward to 9184; it is on its way at 1501
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 03 0520 0002 -> 05DD 0000
        REFUSE,  # 10 0606 0002 04 23D4 0000, forward, -> 90 04: the axis goes on to 9184
        ARRIVE,
        to(0),
        REFUSE,  # 03 0520 0002 -> 83 04
        ACK,  # 10 0606 0002 04 23D4 0000: from 9184 to 9172 is backward, and it is not flagged
    )


def test_a_target_that_is_repeated_while_its_axis_is_on_its_way_keeps_its_branch() -> None:
    """M4: an axis that is slow to begin was not moved by somebody else."""
    play(
        replace(BY_NAME["short"], is_prompt=False),
        to(1),  # 10 0606 0002 04 2330 0000: 9008
        ACK,  # 03 0520 0002 -> 0000 0000
        ACK,  # 10 0606 0002 04 23D5 0000: forward to 9173
        ARRIVE,
        ("ask", 0, "read", 0),
        ACK,  # 03 0520 0002 -> 23D5 0000
        ("ask", 0, "status", 0),
        ACK,  # 03 005C 0001 -> 0110: it has arrived
        to(0),  # 10 0606 0002 04 232F 0000: 9007
        ACK,  # 10 0606 0002 04 22E8 0000: backward to 8936; 80 ms pass
        ("wait",),
        ("wait",),  # unseen_ms is 160
        to(0),
        ACK,  # 03 0520 0002 -> 23D5 0000: it has not moved yet
        ACK,  # 10 0606 0002 04 23D4 0000: forward to 9172, and not flagged
    )
