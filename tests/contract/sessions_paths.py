"""Sessions with drives that keep targets in paths and blocks: Leadshine, Oriental Motor, Delta.

No session reads a position before its first move has ended: a gateway that was only just put in has corrected
nothing until then, and shows what the drive shows.

All axes stand at 0 and make 1000 mm/s² up to 100 mm/s, with 1000 counts to the mm: a move that is stopped t
seconds after its start ends t² × 10⁶ counts further on, half of it driven and half of it braked.
"""

from typing import Final

from gateway.simulator.ledger import MoveKind
from tests.contract.script import Session

LEADSHINE_PR: Final = Session(
    "leadshine-pr",
    "rtu",
    1,
    """
    06 6002 0020                                               # home
    03 1003 0001 | 0040=0040
    10 6200 0008 10 0001 0000 2710 0258 0032 0032 0000 0010    # to 10 000 in one frame
    03 1003 0001 | 0030=0030
    03 6200 0005
    03 602C 0002
    03 1012 0004
    03 602B 0002                                               # cuts both positions
    06 6200 0041                                               # by -2500, staged word by word
    06 6201 FFFF
    06 6202 F63C
    03 6201 0002
    06 6002 0010
    03 6002 0001 | =0000
    03 602A 0004
    10 6200 0008 10 0001 0000 7530 0258 0032 0032 0000 0010    # to 30 000
    03 602C 0002
    wait 30
    06 6002 0040                                               # stop after 0.05 s
    03 1003 0001 | 0004=0000
    03 602C 0002
    10 6208 0008 10 0001 0000 3A98 0258 0032 0032 0000 0000    # to 15 000, on path 1
    06 6002 0011
    03 6002 0001 | =0001
    03 6209 0002
    03 602C 0002
    06 6002 0020                                               # home again, and to 2500
    03 1003 0001 | 0040=0040
    10 6200 0008 10 0001 0000 09C4 0258 0032 0032 0000 0010
    03 1003 0001 | 0030=0030
    03 602C 0002
    06 6002 0021                                               # zero
    03 602A 0004
    10 6200 0008 10 0041 0000 0064 0258 0032 0032 0000 0010    # by 100
    03 1003 0001 | 0030=0030
    03 602C 0002
    02 0001 0001                                               # refused
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
        (MoveKind.SET_POSITION, 0),
        (MoveKind.RELATIVE, 100),
    ),
)

LEADSHINE_EL7: Final = Session(
    "leadshine-el7",
    "rtu",
    1,
    """
    06 6002 0020                                               # home
    03 0B05 0001 | 0008=0008
    06 6200 0001                                               # to 70 000 = 0x0001_1170, word by word
    06 6201 0001
    06 6202 1170
    06 6203 0258
    06 6204 0032
    06 6205 0032
    03 6201 0002
    06 6002 0010
    03 0B05 0001 | 0010=0010
    03 602C 0002
    06 6201 0000                                               # to 4464 = 0x1170: only the high word
    06 6002 0010
    03 0B05 0001 | 0010=0010
    03 602A 0004
    06 6200 0041                                               # by -2500
    10 6201 0002 04 FFFF F63C
    06 6002 0010
    03 6002 0001 | =0000
    03 602C 0002
    10 6200 0008 10 0001 0000 7530 0258 0032 0032 0000 0010    # to 30 000
    wait 40
    06 6002 0040                                               # stop after 0.05 s
    wait 100
    03 602C 0002
    10 6200 0008 10 0001 0000 3A98 0258 0032 0032 0000 0010    # to 15 000
    03 0B05 0001 | 0010=0010
    06 6002 0020                                               # home again, and to 2500
    03 0B05 0001 | 0008=0008
    10 6200 0008 10 0001 0000 09C4 0258 0032 0032 0000 0010
    03 0B05 0001 | 0010=0010
    03 602C 0002
    06 6002 0021                                               # zero
    03 602A 0004
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 70_000),
        (MoveKind.ABSOLUTE, 4_464),
        (MoveKind.RELATIVE, 1_964),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 4_464),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.SET_POSITION, 0),
    ),
)

ORIENTAL_AZ: Final = Session(
    "oriental-az",
    "rtu",
    1,
    """
    10 007C 0002 04 0000 0010                                  # home
    10 007C 0002 04 0000 0000
    03 0178 0001 | 0001=0001
    10 0058 0010 20 0000 0000 0000 0001 0000 2710 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    03 007F 0001 | 2000=0000
    03 0058 0010
    03 00C6 000C                                               # both positions, and what lies between
    10 005A 000E 1C 0000 0002 FFFF F63C 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001    # by -2500
    03 007F 0001 | 2000=0000
    03 00CC 0002
    10 0058 0010 20 0000 0000 0000 0001 0000 7530 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    wait 40
    10 007C 0002 04 0000 0020                                  # stop after 0.05 s
    03 007F 0001 | 2000=0000
    10 007C 0002 04 0000 0000
    03 0120 0004
    10 0066 0002 04 FFFF FFFB                                  # from now on the position starts the move
    10 005C 0002 04 0000 3A98
    03 007F 0001 | 2000=0000
    03 005C 0002
    03 00CC 0002
    10 005C 0002 04 FFFF FF9C
    03 007F 0001 | 2000=0000
    03 00CC 0002
    10 007C 0002 04 0000 0010                                  # home again, and to 2500
    10 007C 0002 04 0000 0000
    03 0178 0001 | 0001=0001
    10 005C 0002 04 0000 09C4
    03 007F 0001 | 2000=0000
    03 00CC 0002
    10 0066 0002 04 0000 0000
    06 007D 4000                                               # jog, a turn without a target, and to 5000
    06 007D 0000
    10 005A 000E 1C 0000 0007 0000 0000 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    10 005A 000E 1C 0000 0001 0000 1388 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    03 007F 0001 | 2000=0000
    03 00CC 0002
    10 018A 0002 04 0000 0001                                  # preset
    03 00CC 0002
    08 0000 1234
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.ABSOLUTE, -100),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 2_500),
        (MoveKind.OTHER, None),
        (MoveKind.ABSOLUTE, 5_000),
        (MoveKind.SET_POSITION, 0),
    ),
)

ORIENTAL_BLV_R: Final = Session(
    "oriental-blv-r",
    "rtu",
    1,
    """
    10 0058 0010 20 0000 0000 0000 0001 0000 2710 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001  # 04
    10 007C 0002 04 0000 0001                                  # S-ON
    10 007C 0002 04 0010 0001                                  # home
    10 007C 0002 04 0000 0001
    03 007F 0001 | 0010=0010
    10 0058 0010 20 0000 0000 0000 0001 0000 2710 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    03 007F 0001 | 2200=0200
    03 005C 0002
    03 00C6 000C
    10 005A 000E 1C 0000 0002 FFFF F63C 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001    # by -2500
    03 007F 0001 | 2200=0200
    03 00CC 0002
    10 0058 0010 20 0000 0000 0000 0001 0000 7530 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    wait 40
    10 007C 0002 04 0000 0021                                  # stop after 0.05 s
    03 007F 0001 | 2000=0000
    10 007C 0002 04 0000 0001
    03 00CC 0002
    06 007D 0081                                               # fault reset: nothing moves
    06 007D 0001
    10 0066 0002 04 0000 FFFB                                  # from now on the position starts the move
    17 00CC 0002 005C 0002 04 0000 3A98                        # written and read in one frame
    03 007F 0001 | 2200=0200
    03 00CC 0002
    10 007C 0002 04 0010 0001                                  # home again, and to 2500
    10 007C 0002 04 0000 0001
    03 007F 0001 | 0010=0010
    10 005C 0002 04 0000 09C4
    03 007F 0001 | 2200=0200
    03 00CC 0002
    10 0066 0002 04 0000 0000
    06 007C 0004                                               # a speed by the inputs, ended by type 0
    06 007C 0000
    10 005A 000E 1C 0000 0000 0000 0000 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001
    10 005A 000E 1C 0000 0001 0000 1388 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0003    # to 5000
    03 007F 0001 | 2200=0200
    03 00CC 0002
    10 0078 0002 04 0010 0000                                  # home by the inputs that go off, and to 2000
    03 007F 0001 | 0010=0010
    10 005A 000E 1C 0000 0001 0000 07D0 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0013
    03 007F 0001 | 2200=0200
    03 00CC 0002
    10 018A 0002 04 0000 0001                                  # preset
    03 00CC 0002
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
        (MoveKind.STOP, 2_500),
        (MoveKind.ABSOLUTE, 5_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_000),
        (MoveKind.SET_POSITION, 0),
    ),
)

DELTA_ASDA: Final = Session(
    "delta-asda",
    "rtu",
    1,
    """
    10 023C 0002 04 0005 0000                                  # writes are not kept
    06 050E 0000                                               # home
    03 005C 0002 | 0100=0100
    10 0604 0002 04 0002 0000                                  # path 1: absolute
    10 0606 0002 04 2710 0000
    03 0606 0002
    06 050E 0001
    03 005C 0002 | 0010=0010
    03 0520 0002
    03 0050 000A                                               # ten words with the state among them
    03 050E 0001 | =4E21
    06 0606 1D4C                                               # to 7500 = 0x1D4C, word by word
    06 0607 0000
    10 050E 0002 04 0001 0000
    03 005C 0002 | 0010=0010
    03 0520 0002
    10 060A 0002 04 7530 0000                                  # path 2 to 30 000
    06 050E 0002
    wait 40
    06 050E 03E8                                               # stop after 0.05 s
    03 005C 0002 | 0010=0010
    03 0520 0002
    10 0604 0002 04 0012 0000                                  # from now on with INS
    10 0606 0002 04 3A98 0000
    06 050E 0001
    03 005C 0002 | 0010=0010
    03 0520 0002
    10 0604 0002 04 0052 0000                                  # by 100 from where it is
    10 0606 0002 04 0064 0000
    10 050E 0002 04 0001 0000
    03 005C 0002 | 0010=0010
    03 0520 0002
    06 050E 0000                                               # home again, and to 2500
    03 005C 0002 | 0100=0100
    10 0604 0002 04 0032 0000                                  # with OVLP too
    10 0606 0002 04 09C4 0000
    06 050E 0001
    03 005C 0002 | 0010=0010
    03 0520 0002
    03 0520 000B                                               # eleven words: refused with 04
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.ABSOLUTE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.RELATIVE, 15_100),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)

SESSIONS: Final = (LEADSHINE_PR, LEADSHINE_EL7, ORIENTAL_AZ, ORIENTAL_BLV_R, DELTA_ASDA)
