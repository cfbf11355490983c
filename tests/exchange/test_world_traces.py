"""Traces that ``make verify`` found, as it prints them: what happens, and the bytes that it causes.

``world_trace`` has the language. Traces are on a screw of ``tests.verify.screw.WORN``.
"""

from dataclasses import replace
from typing import Final

import pytest

from tests.exchange.world_trace import played
from tests.verify.designs import BY_NAME
from tests.verify.explore import play
from tests.verify.world import Design

TRACES: Final[dict[str, tuple[str | Design, str]]] = {
    "an axis that is read off its way after a while has been moved": (
        "s-jogged-past",
        """
        # M4, M6: a repeat keeps no branch on which its axis cannot come. 2003 is 2063 or 1855 (backward).
        to 0: 10 0606 0002 04 07D3 0000, ack: 03 0520 0002 -> 0000 0000, ack: 10 0606 0002 04 080F 0000
        arrive, jog, read, ack: 03 0520 0002 -> 0BB9 0000  # 240 ms later it stands at 3001
        to 0, has: 10 0606 0002 04 073F 0000
        """,
    ),
    "an axis that was nudged from where it had arrived goes on from where it was seen": (
        "s-nudged",
        """
        # M6: 0.3 mm further than 9172 it comes to 9107 backward: 9274 forward, 9037 backward.
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000, ack: 10 0606 0002 04 23D4 0000
        arrive, read, ack: 03 0520 0002 -> 23D4 0000, status, ack: 03 005C 0001 -> 0110  # done
        nudge, read, ack: 03 0520 0002 -> 2500 0000  # 9472
        to 1: 10 0606 0002 04 2393 0000, has: 10 0606 0002 04 234D 0000
        """,
    ),
    "a reading decides no branch after two targets that came without one": (
        "late-start",
        """
        # M6: where the axis stood when its last target came was assumed: its reading is the drive's.
        to 0: 10 0606 0002 04 E4A5 FFFF, ack: 03 0520 0002 -> 0000 0000  # -7003
        ack: 10 0606 0002 04 E425 FFFF, arrive                           # backward to -7131
        to 1: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> E425 FFFF  # 9007
        ack: 10 0606 0002 04 23D4 0000  # 80 ms pass, and it has not begun to move
        to 0, ack: 03 0520 0002 -> E425 FFFF, ack: 10 0606 0002 04 E502 FFFF  # flagged: nothing tells it
        to 1, ack: 10 0606 0002 04 23D4 0000                             # by the reading of 80 ms ago
        to 0, ack: 03 0520 0002 -> E425 FFFF  # where the backward branch puts -7003
        has: 10 0606 0002 04 E502 FFFF                                   # forward to -6910, flagged
        flagged
        """,
    ),
    "a target that is repeated while its axis is on its way keeps its branch": (
        replace(BY_NAME["short"], is_prompt=False),
        """
        # M4: an axis that begins late has not been moved otherwise.
        to 1: 10 0606 0002 04 2330 0000, ack: 03 0520 0002 -> 0000 0000  # 9008
        ack: 10 0606 0002 04 23D5 0000, arrive                           # forward to 9173
        read, ack: 03 0520 0002 -> 23D5 0000, status, ack: 03 005C 0001 -> 0110  # it has arrived
        to 0: 10 0606 0002 04 232F 0000, ack: 10 0606 0002 04 22E8 0000  # 9007: backward to 8936; 80 ms pass
        wait, wait                                                       # unseen_ms is 160
        to 0, ack: 03 0520 0002 -> 23D5 0000                             # it has not moved yet
        ack: 10 0606 0002 04 22E8 0000                                   # not 23D4, which is forward
        """,
    ),
    "a reading that fades from an assumed start decides no branch in the window of its target": (
        "read-back",
        """
        # M6: 9008 was obeyed and not acknowledged, 9007 lies a count beside it: the axis stands where it
        # stood. Its reading fades from 1:1, 9173, to 9007 within that count. Forward 9008 is 9173.12,
        # backward 8937.09.
        jog, read, ack: 03 0520 0002 -> 0BB9 0000                              # 3001
        to 1: 10 0606 0002 04 2330 0000, obey: 10 0606 0002 04 23D5 0000       # 9008: 9173, not acknowledged
        wait, wait, to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 2364 0000  # 9060: between them
        has: 10 0606 0002 04 235E 0000, arrive          # half-way to 9054, flagged, lost; it stands at 9173
        wait, wait, to 0, ack: 03 0520 0002 -> 23D5 0000
        ack: 10 0606 0002 04 23D4 0000                  # it has come there forward
        to 1, ack: 03 0520 0002 -> 23D5 0000
        has: 10 0606 0002 04 23D5 0000                  # not 22E9, as it was sent
        flagged
        """,
    ),
    "a reading in coarser steps than the target is the nearest one of an axis that stands there": (
        "s-coarse",
        """
        # 8932 is 9095.98 forward, sent as 9096: 910 in steps of 10 counts. 893 is nearest to 8932.
        to 1: 10 0606 0002 04 22E4 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 2388 0000, arrive  # forward to 9096
        read, ack: 03 0520 0002 -> 038E 0000    # 910
        told: 03 04 037D 0000                   # not 037E, 894
        """,
    ),
    "the repeat of a target of before is a new one where the axis stands elsewhere": (
        "p-home-read",
        """
        # M6, M9: it was switched off and homed, and stands at 0, from where 9007 is forward: 9172.
        to 0: 10 0606 0002 04 232F 0000, ack: 03 005C 0001 -> 0110
        ack: 10 0606 0002 04 235E 0000  # half-way, for it is only staged
        run, ack: 03 0520 0002 -> 0000 0000, ack: 10 0606 0002 04 23D4 0000, ack: 06 050E 0001
        reboot, to 0, ack: 03 005C 0001 -> 0010  # not homed
        ack: 10 0606 0002 04 232F 0000           # as it came
        run, homed, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002, ack: 10 0606 0002 04 23D4 0000, ack
        forward
        """,
    ),
    "a target that went without a reference is a new one where its drive was homed elsewhere": (
        "s-link-homed",
        """
        # M4, M6, M9: -7003 went as it came. The drive is switched off and homed while the link is down, and
        # stands at 0: from there it is -7131, backward.
        unplug, plug, reboot, to 0, ack: 03 005C 0001 -> 0010, ack: 10 0606 0002 04 E4A5 FFFF
        homed, unplug, reboot, plug, unplug, homed, plug
        read, wait, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> 0000 0000
        to 0, ack: 10 0606 0002 04 E425 FFFF
        backward
        """,
    ),
    "one look tells whether a target keeps its words over a new reference": (
        "s-link-homed",
        """
        # W8, M9: -7003 went as it came; the drive was homed meanwhile, and stands there: the same words.
        unplug, reboot, plug, homed, reboot, to 0, ack: 03 005C 0001 -> 0010
        homed, ack: 10 0606 0002 04 E4A5 FFFF, arrive
        to 0, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> E4A5 FFFF
        has: 10 0606 0002 04 E4A5 FFFF
        """,
    ),
    "a repeat over a new reference is a new target where its drive was switched off": (
        "s-link-homed",
        """
        # M4, M9: 9007 (9172) goes out over a new reference, and its answer is lost with the link. Its drive
        # was switched off again and counts from another zero, at which it stands: 9007, without a
        # reference.
        to 1, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> 0000 0000, ack: 10 0606 0002 04 23D4 0000
        to 0, has: 03 0520 0002, unplug, reboot, plug
        to 1, wait, ack: 03 005C 0001 -> 0010, homed, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002
        has: 10 0606 0002 04 23D4 0000, unplug, plug, reboot
        to 1, ack: 03 005C 0001 -> 0010, has: 10 0606 0002 04 232F 0000
        """,
    ),
    "a gateway that was killed does not take the start of the last way for known": (
        "killed-near",
        """
        # M6: its record keeps the fade of the reading, and not that it fades from a start that was assumed.
        # 9007 is 9172.10 forward and 8936.08 backward, half-way 9054.09; 9019 half-way 9066.24.
        read, ack: 03 0520 0002 -> 0000 0000
        to 0: 10 0606 0002 04 232F 0000, obey: 10 0606 0002 04 23D4 0000, arrive  # 9172, not acknowledged
        kill, to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 23D4 0000  # 9019
        ack: 10 0606 0002 04 236A 0000                                         # half-way to 9066, flagged
        kill, ack: 03 0520 0002 -> 23D4 0000                                   # it has not begun to move
        to 0, has: 10 0606 0002 04 235E 0000                                   # not 22E8, as it was sent
        flagged
        """,
    ),
    "a gateway that was killed takes no target for reached where the way before begins there": (
        "killed-near",
        """
        # M6: 9007 was given again and not answered before the axis had begun to go from there to 9019. 9007
        # is 9172.10 forward and 8936.08 backward, 9019 forward 9184.29.
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000, arrive  # forward to 9172
        to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 23D4 0000, ack: 10 0606 0002 04 23E0 0000
        to 0, ack: 03 0520 0002 -> 23D4 0000    # it has not begun to move
        kill, ack: 03 0520 0002 -> 23D4 0000    # 10 0606 0002 04 23D4 0000 never came
        arrive, to 0                            # it stands at 9184
        ack: 03 0520 0002 -> 23E0 0000          # not 10 … 23D4: that would be forward
        has: 10 0606 0002 04 22E8 0000
        """,
    ),
    "a mask is not laid over a corrected word of an axis that has no reference": (
        "s-mask-homing",
        """
        # M1, M9: 9007 was corrected to 9172, 23D4; a mask that sets its high byte to 24 makes 242F, 9263.
        # As it came it made 24D4 of 23D4: 9428.
        home, ack: 06 050E 0064, homed, wait, wait
        to 0: 10 0606 0002 04 232F 0000, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000  # forward to 9172
        home, ack: 06 050E 0064
        mask 0: 16 0606 00FF 2400, ack: 03 005C 0001 -> 0000  # not homed yet
        has: 10 0606 0002 04 242F 0000, ack, told: 16 0606 00FF 2400  # its own echo
        """,
    ),
    "the first setpoint of a stream given again on its way there is the same words": (
        "stream",
        """
        # M4: its drive may hold it; 9007 less than both branches say at 0 is 8838, and 8854 at 1501.
        to 1: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        obey: 10 0606 0002 04 2286 0000, wait, wait  # 8838, never acknowledged
        read, ack: 03 0520 0002 -> 05DD 0000
        to 1, ack: 03 0520 0002, has: 10 0606 0002 04 2286 0000
        """,
    ),
    "an axis that was moved away before a dry run ended does not run its old words": (
        "s-dry-run-staged",
        """
        # M4, M9: staged 9007 stands 1:1 at 9007, and nobody goes to the 9054 that it would be. It is jogged
        # to 3001; the dry run ends, and the next reading says so: 9172, forward, and no repeat any more.
        to 0, ack: 10 0606 0002 04 232F 0000, run, ack: 06 050E 0001, arrive
        read, ack: 03 0520 0002 -> 232F 0000
        jog, read, end_dry_run, ack: 03 0520 0002 -> 0BB9 0000
        run, has: 10 0606 0002 04 23D4 0000
        not-flagged
        """,
    ),
}


@pytest.mark.parametrize("name", TRACES)
def test_a_trace_is_as_it_is_written(name: str) -> None:
    played(*TRACES[name])


@pytest.mark.parametrize(
    "again", ["to 0", "to 1", "status, ack: 03 005C 0001 -> 0110, to 0", "status, ack, to 1"]
)
def test_the_position_is_read_before_a_target_after_the_done_bit_fell_and_rose(again: str) -> None:
    """M4, M6: it is at rest at an unknown position. 9007 is 9172 forward; 5003 is 5108, or 4888 backward."""
    crept = """
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000, arrive, status, ack: 03 005C 0001 -> 0110   # done
        blink, status, ack: 03 005C 0001 -> 0100, read, ack: 03 0520 0002 -> 23D4 0000  # not done
        creep  # 80 ms later it stands at 3001
    """
    played("s-crept-past", crept + again + ", has: 03 0520 0002")
    if again == "status, ack, to 1":  # forward, not 1318
        forward = ", ack: 03 0520 0002 -> 0BB9 0000, has: 10 0606 0002 04 13F4 0000"
        played("s-crept-past", crept + again + forward)


def test_a_repeat_after_its_axis_moved_is_flagged_if_nothing_shows_its_branch() -> None:
    """M6: its axis has moved since its words were sent. Read at 9184, it goes backward."""
    onward = """
        to 1: 10 0606 0002 04 233B 0000, ack: 03 0520 0002 -> 0000 0000  # 9019
        ack: 10 0606 0002 04 23E0 0000  # forward to 9184; it is on its way at 1501
        to 0: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 05DD 0000  # 9007
        refuse: 10 0606 0002 04 23D4 0000, arrive                        # 90 04: the axis goes on to 9184
        to 0, refuse: 03 0520 0002,
    """
    assert played("deaf", onward + "refuse: 03 0520 0002, has: 10 0606 0002 04 23D4 0000").is_sending_unsure()
    played("deaf", onward + "ack: 03 0520 0002 -> 23E0 0000, has: 10 0606 0002 04 22E8 0000")


@pytest.mark.parametrize(
    "after_it",
    [
        "plug, to 1, wait, ack: 03 005C 0001, ack: 03 0520 0002, has: 10 0606 0002 04 23D4 0000",
        "reboot, plug, to 1, wait, ack: 03 005C 0001, ack, ack: 03 0520 0002, has: 10 0606 0002 04 232F 0000",
    ],
)
def test_a_repeat_lost_with_the_link_keeps_its_words_if_the_axis_is_at_its_target(after_it: str) -> None:
    """M4, M9: 9007 (9172) is repeated, and the link is lost before the answer. An axis at 9172 then gets the
    same words. A drive that was switched off is at 0: without a reference it goes to 9007."""
    told = """
        read, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> 0000 0000
        to 1, ack: 10 0606 0002 04 23D4 0000, arrive   # 9007 forward
        to 1, has: 10 0606 0002 04 23D4 0000, unplug   # the same words, never answered
    """
    played("s-link-homed", told + after_it)


LOST_TARGETS = """
    to 0, refuse: 10 0606 0002 04 235E 0000    # unit 1: it blocks both axes, for the sake of the first
    to 0 y, refuse: 10 0606 0002 04 235E 0000  # unit 2: the second one has lost its own
    to 0, ack: 10 0606 0002 04 235E 0000       # the first one has a new one
    run                                        # 86 04: the second one has none
"""


def test_a_group_does_not_move_while_the_target_of_one_axis_is_lost() -> None:
    """M11: both axes of a group lost their target; the new one of the first is no target of the second."""
    assert ("drive", "ack") not in played("group", LOST_TARGETS).happenings()
    assert ("drive", "ack") in played("group", LOST_TARGETS + "to 0 y, ack, run").happenings()


def test_a_rewritten_target_without_an_acknowledgement_does_not_run_without_a_reference() -> None:
    """M2, M9: without a reference the words of the controller run; -7003 is -7131 backward."""
    lost = """
        reboot, home, ack: 06 050E 0064
        to 0: 10 0606 0002 04 E4A5 FFFF, homed, ack: 03 005C 0001 -> 0110
        ack: 10 0606 0002 04 E4A5 FFFF  # as it came: the bit may be that of the homing before
        wait, wait, run, ack: 03 005C 0001 -> 0110, ack: 03 0520 0002 -> 0000 0000
        obey: 10 0606 0002 04 E425 FFFF  # -7131, never acknowledged
        reboot, run: 06 050E 0001, ack: 03 005C 0001 -> 0010  # not homed
    """
    assert played("homed", lost).state.wire is None
    played("homed", lost + "to 0, ack, ack, run, ack, has: 06 050E 0001")  # written again, it may run


def test_the_branch_is_flagged_if_a_record_cannot_tell_which_of_two_targets_the_axis_reached() -> None:
    """M6, 5: the axis may have gone back, or not have begun yet. It reads its target 203, flagged.

    9007 is 9172 forward; 203 is 34.92 backward.
    """
    world = played(
        "s-killed-onward",
        """
        to 2: 10 0606 0002 04 232F 0000, ack: 03 0520 0002 -> 0000 0000
        ack: 10 0606 0002 04 23D4 0000                                   # the way is 0 to 9172
        to 0: 10 0606 0002 04 00CB 0000, ack: 03 0520 0002 -> 05DD 0000  # seen at 1501
        obey: 10 0606 0002 04 0023 0000                                  # back to 35, not acknowledged
        kill, ack: 03 0520 0002 -> 05DD 0000, arrive, kill, ack: 03 0520 0002 -> 0023 0000
        """,
    )
    assert [event.kind.name for event in world.told] == ["restored", "direction-unsure"]
    assert round(world.sides[0].line.axes[0].motion.nominal_of(35)) == 203


def test_a_record_counts_after_each_kill_as_after_the_first() -> None:
    """5: a setpoint is lost, the axis stands at the one before. A start keeps what its record says."""
    lost = """
        to 0: 10 0606 0002 04 03EB 0000, ack: 03 0520 0002 -> 0000 0000, ack  # 1003
        to 2: 10 0606 0002 04 232F 0000
        ack: 10 0606 0002 04 235E 0000          # 9054, half of its blend has gone
        to 0, has: 10 0606 0002 04 034C 0000    # never acknowledged
        arrive                                  # at 9054
    """
    for kills in (1, 2, 3):
        world = played("s-killed-stream", lost + kills * "kill, ack: 03 0520 0002 -> 235E 0000\n")
        assert [event.kind.name for event in world.told] == ["restored"]
        assert world.said(0).direction == "forward"


LOST_WORD = "low 0: 06 0606 232F, ack: 03 0606 0002 -> 0000 0000\n"
"""The high word is not certain, so that it is answered 86 04."""


def test_a_word_joined_with_a_lost_one_is_sent_as_a_whole_position_also_without_compensation() -> None:
    """M1: the drive never got the low word; both are 9007. 06 0607 0000 alone would be 0."""
    joined = "high 0: 06 0607 0000, switch, ack: 03 0520 0002 -> 0000 0000, has: 10 0606 0002 04 232F 0000"
    played("s-words-replaced", LOST_WORD + joined)


def test_a_lost_word_is_joined_with_none_once_a_newer_one_was_sent_unchanged() -> None:
    """M1, M9: 0019 has replaced 232F in the drive, and was acknowledged."""
    played("s-words-replaced", LOST_WORD + "switch, low 1, ack: 06 0606 0019, high 0, has: 06 0607 0000")


AFTER_A_LOSS: Final = (
    ("switch",),
    ("ask", 0, "to", 1, 1),
    ("wait",),
    ("ask", 0, "to", 0, 1),
    ("wait",),
    ("drive", "obey-refuse"),
    ("ask", 0, "to", 1, 1),
    ("drive", "obey-refuse"),
    ("ask", 0, "to", 1, 1),
    ("arrive", 0),
    ("switch",),
    ("ask", 0, "to", 0, 1),
    ("arrive", 1),
    ("drive", "ack"),
    ("ask", 0, "to", 1, 1),
    ("drive", "ack"),
    ("ask", 0, "to", 1, 0),
    ("wait",),
    ("ask", 0, "to", 0, 0),
    ("wait",),
    ("ask", 0, "to", 1, 0),
    ("wait",),
    ("wait",),
    ("ask", 0, "to", 1, 0),
    ("wait",),
    ("switch",),
    ("ask", 0, "to", 0, 1),
    ("drive", "ack"),
    ("switch",),
    ("drive", "obey-refuse"),
    ("ask", 0, "to", 1, 1),
    ("drive", "obey-refuse"),
    ("ask", 0, "to", 1, 1),
    ("drive", "ack"),
)


def test_a_target_from_before_a_loss_that_may_have_been_executed_is_not_another_target() -> None:
    """M11: y was silent for long. Both axes get 5003 while switched off, each without an acknowledgement.

    The compensation is switched on in between, which is put off. y gets 5003 once more: it follows x, with
    10 0606 0002 04 138B 0000, not with 1386. The rules of ``make verify`` check that.
    """
    play(BY_NAME["s-group-movers"], *AFTER_A_LOSS)
