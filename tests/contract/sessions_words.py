"""Sessions with drives that are run by control words or images: Kinco, MR-JE-C, JMC, dryve D1, Festo, AKD2G.

Axes as in the sessions with paths.
"""

from typing import Final

from gateway.simulator.ledger import MoveKind
from tests.contract.script import Session

KINCO_FD: Final = Session(
    "kinco-fd",
    "rtu",
    1,
    """
    06 3100 000F                                               # enable
    06 3500 0006                                               # home
    06 4D00 0011
    06 3100 001F
    03 3200 0001 | 8000=8000
    06 3100 000F
    06 3500 0001
    10 4000 0002 04 2710 0000
    10 4A00 0002 04 4E82 001B
    06 3100 002F                                               # absolute
    06 3100 003F
    03 3200 0001 | 0400=0400
    03 4000 0002
    03 3700 0002
    10 4000 0002 04 F63C FFFF                                  # by -2500
    06 3100 004F
    06 3100 005F
    03 3200 0001 | 0400=0400
    03 3700 0002
    10 4000 0002 04 7530 0000
    06 3100 002F
    06 3100 003F
    wait 40
    06 3100 000B                                               # quick stop after 0.05 s
    03 3200 0001 | 0400=0400
    03 3700 0002
    06 3100 000F
    10 4000 0002 04 3A98 0000
    06 3100 103F                                               # follow
    03 3200 0001 | 0400=0400
    10 4000 0002 04 3E80 0000                                  # 16 000
    10 4000 0002 04 4268 0000                                  # 17 000, while it moves
    03 3200 0001 | 0400=0400
    03 3700 0002
    06 3100 000F
    10 4000 0002 04 7530 0000
    06 3100 002F
    06 3100 003F
    wait 40
    06 3100 013F                                               # halt after 0.05 s
    03 3200 0001 | 0400=0400
    03 3700 0002
    06 3100 0086                                               # fault reset
    06 3100 000F
    06 3500 0006                                               # home again, and to 2500
    06 3100 001F
    03 3200 0001 | 8000=8000
    06 3100 000F
    06 3500 0001
    10 4000 0002 04 09C4 0000
    06 3100 003F
    03 3200 0001 | 0400=0400
    03 3700 0002
    10 3700 0002 04 0000 0000                                  # zero
    03 3700 0002
    03 3701 0002                                               # refused, with 81
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.ABSOLUTE, 16_000),
        (MoveKind.ABSOLUTE, 17_000),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 19_500),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.SET_POSITION, 0),
    ),
)

MITSUBISHI_MR_JE_C: Final = Session(
    "mitsubishi-mr-je-c",
    "tcp",
    255,
    """
    10 6060 0001 02 0006                                       # home
    10 6040 0001 02 0006
    10 6040 0001 02 0007
    10 6040 0001 02 000F
    10 6040 0001 02 001F
    03 6041 0001 | 1400=1400
    10 6040 0001 02 000F
    10 6060 0001 02 0001
    10 607A 0002 04 2710 0000
    10 6081 0002 04 03E8 0000
    10 6040 0001 02 001F
    10 6040 0001 02 000F
    03 6041 0001 | 0400=0400
    03 607A 0002
    03 6064 0002
    03 6040 0002
    10 607A 0002 04 F63C FFFF                                  # by -2500
    10 6040 0001 02 005F
    10 6040 0001 02 000F
    03 6041 0001 | 0400=0400
    03 6064 0002
    10 607A 0002 04 7530 0000
    10 6040 0001 02 001F
    wait 40
    10 6040 0001 02 010F                                       # halt after 0.05 s
    03 6041 0001 | 0400=0400
    03 6064 0002
    10 6040 0001 02 000F
    10 607A 0002 04 3A98 0000
    10 6040 0001 02 001F
    03 6041 0001 | 0400=0400
    03 6064 0002
    10 6040 0001 02 000F
    10 6060 0001 02 0006                                       # home again, and to 2500
    10 6040 0001 02 001F
    03 6041 0001 | 1400=1400
    10 6040 0001 02 000F
    10 6060 0001 02 0001
    10 607A 0002 04 09C4 0000
    10 6040 0001 02 001F
    03 6041 0001 | 0400=0400
    03 6064 0002
    03 6065 0002                                               # no such object
    06 6040 000F                                               # no such function
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)

JMC_RC: Final = Session(
    "jmc-rc",
    "rtu",
    1,
    """
    06 6040 0001                                               # on, step by step
    06 6040 0003
    06 6040 000F
    06 6060 0006                                               # home
    06 6098 0001
    06 6040 001F
    03 6041 0001 | 1400=1400
    06 6040 000F
    06 6060 0001
    10 6081 0002 04 0000 000A
    10 607A 0002 04 0000 2710                                  # to 10 000
    06 6040 001F
    06 6040 000F
    03 6041 0001 | 0400=0400
    03 6064 0002
    10 607A 0002 04 FFFF F63C                                  # by -2500
    06 6040 005F
    06 6040 004F
    03 6041 0001 | 0400=0400
    03 6064 0002
    10 607A 0002 04 0000 7530                                  # to 30 000
    06 6040 001F
    wait 40
    06 6040 010F                                               # halt after 0.05 s
    03 6041 0001 | 0400=0400
    03 6064 0002
    06 6040 000F
    10 607A 0002 04 0000 3A98                                  # to 15 000
    06 6040 001F
    03 6041 0001 | 0400=0400
    03 6064 0002
    06 6040 000F
    06 6060 0006                                               # home again, and to 2500
    06 6040 001F
    03 6041 0001 | 1400=1400
    06 6040 000F
    06 6060 0001
    10 607A 0002 04 0000 09C4
    06 6040 001F
    03 6041 0001 | 0400=0400
    03 6064 0002
    06 6040 0080                                               # fault reset: it is off
    03 6060 0001                                               # can only be written
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)

IGUS_DRYVE_D1: Final = Session(
    "igus-dryve-d1",
    "tcp",
    0,
    """
    2B0D 01 0000 6040 00 000000 02 0600
    2B0D 01 0000 6040 00 000000 02 0700
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 01 0000 6060 00 000000 01 06                          # home
    2B0D 01 0000 6092 01 000000 04 01000000
    2B0D 01 0000 6099 01 000000 04 70170000
    2B0D 01 0000 609A 00 000000 04 409C0000
    2B0D 01 0000 6040 00 000000 02 1F00
    2B0D 00 0000 6041 00 000000 02 | =2716
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 01 0000 6060 00 000000 01 01
    2B0D 01 0000 6081 00 000000 04 10270000
    2B0D 01 0000 607A 00 000000 04 10270000                    # to 10 000
    2B0D 01 0000 6040 00 000000 02 1F00
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 00 0000 6041 00 000000 02 | =2706
    2B0D 00 0000 607A 00 000000 04
    2B0D 00 0000 6064 00 000000 04
    2B0D 01 0000 607A 00 000000 04 3CF6FFFF                    # by -2500
    2B0D 01 0000 6040 00 000000 02 5F00
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 00 0000 6041 00 000000 02 | =2706
    2B0D 00 0000 6064 00 000000 04
    2B0D 01 0000 607A 00 000000 04 30750000                    # to 30 000
    2B0D 01 0000 6040 00 000000 02 1F00
    wait 40
    2B0D 01 0000 6040 00 000000 02 0F01                        # halt after 0.05 s
    2B0D 00 0000 6041 00 000000 02 | =2706
    2B0D 00 0000 6064 00 000000 04
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 01 0000 607A 00 000000 04 983A0000                    # to 15 000
    2B0D 01 0000 6040 00 000000 02 1F00
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 00 0000 6041 00 000000 02 | =2706
    2B0D 00 0000 6064 00 000000 04
    2B0D 01 0000 6060 00 000000 01 06                          # home again, and to 2500
    2B0D 01 0000 6040 00 000000 02 1F00
    2B0D 00 0000 6041 00 000000 02 | =2716
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 01 0000 6060 00 000000 01 01
    2B0D 01 0000 607A 00 000000 04 C4090000
    2B0D 01 0000 6040 00 000000 02 1F00
    2B0D 01 0000 6040 00 000000 02 0F00
    2B0D 00 0000 6041 00 000000 02 | =2706
    2B0D 00 0000 6064 00 000000 04
    03 6064 0002                                               # no such function
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)

KOLLMORGEN_AKD2G: Final = Session(
    "kollmorgen-akd2g",
    "tcp",
    1,
    """
    10 001E 0002 04 0000 2710                                  # MT.P0, to 10 000
    10 001C 0002 04 0001 86A0
    10 0018 0002 04 0001 86A0
    10 001A 0002 04 0001 86A0
    10 0020 0002 04 0000 0000
    10 0016 0002 04 0000 0000                                  # MT.MOVE: 0, then not 0
    10 0016 0002 04 0000 0001
    03 0006 0002 | =0000 0806
    03 001E 0002
    03 0000 0006
    10 0016 0002 04 0000 0000
    10 001E 0004 08 0000 1D4C 0000 0000                        # back to 7500
    10 0016 0002 04 0000 0001
    03 0006 0002 | =0000 0806
    03 0000 0002
    10 0016 0002 04 0000 0000
    10 001E 0004 08 0000 7530 0000 0000                        # to 30 000
    10 0016 0002 04 0000 0001
    wait 50
    10 0016 0002 04 0000 0000
    10 001E 0002 04 0000 1388                                  # to 5000 instead
    10 0016 0002 04 0000 0001
    03 0006 0002 | =0000 0806
    03 0000 0002
    10 0016 0002 04 0000 0000
    10 001E 0004 08 FFFF FC18 0000 0001                        # by -1000 from where it was told to be
    10 0016 0002 04 0000 0001
    03 0006 0002 | =0000 0806
    03 0000 0002
    10 0000 0002 04 0000 0001                                  # left out, and not reported
    03 0000 0002
    """,
    (
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.ABSOLUTE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.ABSOLUTE, 5_000),
        (MoveKind.RELATIVE, 4_000),
    ),
)

REST = "0000 " * 21


def _cmmt_output(stw1: str, mode: str, target: str) -> str:
    """The whole output image."""
    return f"10 0000 001C 38 {stw1} {mode} 0000 0000 4000 {target} {REST}"


def _cmmt(stw1: str, mode: str, target: str) -> str:
    """One cycle: the whole output image, then the whole input image."""
    return _cmmt_output(stw1, mode, target) + "\n03 0064 001C"


def _cmmt_session() -> str:
    return "\n".join(
        (
            "2B 0E 01 00",
            "10 0190 0002 04 0064 0000",
            _cmmt_output("043F", "8100", "0000 0000"),
            _cmmt_output("0C3F", "8100", "0000 0000"),  # reference run
            "03 0064 0001 | 0C00=0C00",
            _cmmt_output("043F", "8100", "2710 0000"),
            _cmmt_output("047F", "8100", "2710 0000"),  # to 10 000
            _cmmt_output("047F", "8100", "2710 0000"),
            "03 0064 0001 | 0400=0400",
            _cmmt("047F", "8100", "2710 0000"),
            _cmmt("043F", "8000", "F63C FFFF"),
            _cmmt("047F", "8000", "F63C FFFF"),  # by -2500
            "03 0064 0001 | 0400=0400",
            "03 0064 001C",
            _cmmt("043F", "8100", "7530 0000"),
            _cmmt("047F", "8100", "7530 0000"),  # to 30 000
            "wait 30",
            _cmmt("046F", "8100", "7530 0000"),  # rejected after 0.05 s
            "03 0064 0001 | 2400=2400",
            "03 0069 0002",
            _cmmt("043F", "9100", "3A98 0000"),  # from now on each change of the target counts
            "03 0064 0001 | 0400=0400",
            _cmmt("043F", "9100", "3E80 0000"),
            "03 0064 0001 | 0400=0400",
            _cmmt("043F", "9100", "3E80 0000"),
            _cmmt("043F", "8100", "3E80 0000"),
            _cmmt("0C3F", "8100", "3E80 0000"),  # home again, and to 2500
            "03 0064 0001 | 0C00=0C00",
            _cmmt("043F", "8100", "09C4 0000"),
            _cmmt("047F", "8100", "09C4 0000"),
            "03 0064 0001 | 0400=0400",
            _cmmt("047F", "8100", "09C4 0000"),
            "03 0000 0009",
            _cmmt("043F", "8100", "7530 0000"),
            _cmmt("047F", "8100", "7530 0000"),  # to 30 000
            "wait 30",
            _cmmt("041F", "8100", "7530 0000"),  # paused after 0.05 s
            "03 0064 0001 | 2000=2000",
            "03 0069 0002",
            _cmmt("043F", "8100", "7530 0000"),  # the rest of the way
            "03 0064 0001 | 2400=2400",
            "03 0069 0002",
            _cmmt("053F", "8100", "7530 0000"),  # jog, and a run at a speed
            _cmmt("043F", "8100", "7530 0000"),
            _cmmt("047F", "C300", "7530 0000"),
            _cmmt("042F", "C300", "7530 0000"),
            _cmmt("043F", "8100", "3A98 0000"),
            _cmmt("047F", "8100", "3A98 0000"),  # to 15 000
            "03 0064 0001 | 2400=2400",
            "03 0069 0002",
            _cmmt_output("043F", "8100", "3A98 0000").replace("8100 0000", "8100 0002"),  # zero
            "03 0069 0002",
        )
    )


FESTO_CMMT_111: Final = Session(
    "festo-cmmt-111",
    "tcp",
    1,
    _cmmt_session(),
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.ABSOLUTE, 16_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 5_000),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 30_000),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 30_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.SET_POSITION, 0),
    ),
)

FESTO_CMMO_FHPP: Final = Session(
    "festo-cmmo-fhpp",
    "tcp",
    1,
    """
    10 0000 0004 08 4301 0064 0000 0000                        # enabled, no halt
    10 0000 0004 08 4305 0064 0000 0000                        # home
    03 0000 0001 | 0084=0084
    10 0000 0004 08 4301 0064 0000 2710
    10 0000 0004 08 4301 0064 0000 2710
    10 0000 0004 08 4303 0064 0000 2710                        # to 10 000
    07
    10 0000 0004 08 4303 0064 0000 2710
    03 0000 0001 | 0004=0004
    03 0000 0004
    10 0000 0004 08 4301 0164 FFFF F63C
    17 0000 0004 0000 0004 08 4303 0164 FFFF F63C              # by -2500, written and read in one frame
    03 0000 0001 | 0004=0004
    17 0000 0004 0000 0004 08 4303 0164 FFFF F63C
    10 0000 0004 08 4301 0064 0000 7530
    10 0000 0004 08 4303 0064 0000 7530                        # to 30 000
    wait 40
    10 0000 0004 08 4300 0064 0000 7530                        # halt after 0.05 s
    03 0000 0001 | 0014=0004
    03 0000 0004
    10 0000 0004 08 4301 0064 0000 3A98
    10 0000 0004 08 4303 0064 0000 3A98                        # to 15 000
    03 0000 0001 | 0004=0004
    10 0000 0004 08 4301 0064 0000 3A98
    10 0000 0004 08 4305 0064 0000 3A98                        # home again, and to 2500
    03 0000 0001 | 0084=0084
    10 0000 0004 08 4301 0064 0000 09C4
    10 0000 0004 08 4303 0064 0000 09C4
    03 0000 0001 | 0004=0004
    03 0002 0002
    10 0000 0004 08 4301 0064 0000 09C4
    10 0000 0004 08 4309 0064 0000 09C4                        # jog, for as long as the bit is set
    10 0000 0004 08 4301 0064 0000 09C4
    10 0000 0004 08 4201 0064 0000 09C4                        # no stop taken back: it stops
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 2_500),
    ),
)

SESSIONS: Final = (
    KINCO_FD,
    MITSUBISHI_MR_JE_C,
    IGUS_DRYVE_D1,
    JMC_RC,
    KOLLMORGEN_AKD2G,
    FESTO_CMMT_111,
    FESTO_CMMO_FHPP,
)
