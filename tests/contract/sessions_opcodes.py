"""Sessions with cylinders and small steppers: IAI, SMC, Applied Motion, Makerbase, ESS-RS, TL-R.

Axes as in the sessions with paths.
"""

from typing import Final

from gateway.simulator.ledger import MoveKind
from tests.contract.script import Session

IAI_ROBO_CYLINDER: Final = Session(
    "iai-robo-cylinder",
    "rtu",
    1,
    """
    05 0403 FF00                                               # servo on
    05 040B 0000
    05 040B FF00                                               # home
    03 9005 0001 | 0010=0010
    10 9900 0007 0E 0000 2710 0000 000A 0000 2710 001E         # to 10 000
    03 9005 0001 | 0008=0008
    03 9900 0002
    03 9000 000A
    10 9900 0009 12 FFFF F63C 0000 000A 0000 2710 001E 0000 0008   # by -2500
    03 9005 0001 | 0008=0008
    03 9000 0002
    10 9900 0002 04 0000 7530                                  # to 30 000
    wait 40
    05 042C FF00                                               # stop after 0.05 s
    03 9007 0001 | 0020=0000
    03 9000 0002
    05 0407 FF00                                               # fault reset: nothing moves
    05 0407 0000
    06 9900 0000                                               # to 15 000, word by word
    06 9901 3A98
    03 9005 0001 | 0008=0008
    03 9900 0002
    03 9000 0002
    06 9908 0008                                               # by 100, the flag first
    10 9900 0002 04 0000 0064
    03 9005 0001 | 0008=0008
    03 9000 0002
    10 9900 0002 04 0000 7530                                  # to 30 000
    wait 40
    05 040A FF00                                               # pause after 0.05 s
    03 9007 0001 | 0020=0000
    03 9000 0002
    05 040A 0000                                               # the rest of the way
    03 9005 0001 | 0008=0008
    03 9000 0002
    05 0416 FF00                                               # jog
    05 0416 0000
    05 040B 0000
    05 040B FF00                                               # home again, and to 2500
    03 9005 0001 | 0010=0010
    10 9900 0002 04 0000 09C4
    03 9005 0001 | 0008=0008
    03 9000 0002
    04 9000 0002                                               # refused
    """,
    (
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.RELATIVE, 15_100),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 17_600),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 30_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)

SMC_LEC: Final = Session(
    "smc-lec",
    "rtu",
    1,
    """
    05 0030 FF00                                               # serial mode
    05 001B FF00
    05 001B 0000
    05 0019 FF00                                               # servo on
    05 001C FF00                                               # home
    02 004A 0001 | =01
    05 001C 0000
    10 9102 0001 02 0001                                       # absolute
    10 9103 0001 02 0064
    10 9104 0002 04 0000 2710
    03 9104 0002
    10 9100 0001 02 0100
    03 9100 0001 | =0000
    02 0048 0008
    02 004B 0001 | =01
    03 9000 0006
    10 9104 0002 04 0000 2EE0                                  # on to 12 000
    10 9100 0001 02 0100
    02 004B 0001 | =01
    10 9102 0001 02 0002                                       # by -4500
    10 9104 0002 04 FFFF EE6C
    10 9100 0001 02 0100
    02 004B 0001 | =01
    03 9000 0002
    10 9102 0004 08 0001 0064 0000 7530                        # to 30 000
    10 9100 0001 02 0100
    wait 40
    05 001B FF00                                               # reset stops it after 0.05 s
    02 0048 0001 | =00
    05 001B 0000
    03 9000 0002
    10 9104 0002 04 0000 3A98
    10 9100 0001 02 0100
    02 004B 0001 | =01
    03 9000 0002
    10 9104 0002 04 0000 7530                                  # to 30 000
    10 9100 0001 02 0100
    wait 40
    05 0018 FF00                                               # HOLD after 0.05 s
    02 0048 0001 | =00
    05 0018 0000
    03 9000 0002
    05 001E FF00                                               # jog
    05 001E 0000
    05 001C FF00                                               # home again, and to 2500
    02 004A 0001 | =01
    05 001C 0000
    10 9104 0002 04 0000 09C4
    10 9100 0001 02 0100
    02 004B 0001 | =01
    03 9000 0002
    06 9102 0001                                               # refused: no FC06
    """,
    (
        (MoveKind.STOP, 0),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.ABSOLUTE, 12_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 17_500),
        (MoveKind.OTHER, None),
        (MoveKind.STOP, 17_500),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
    ),
)


def _applied_motion(target: str, actual: str, status: str) -> str:
    """The same session on both maps."""
    return f"""
    06 007C 009F                                               # enable
    06 007D 0003
    06 007E 004C
    06 007C 006E                                               # home
    03 {status} 0001 | 0410=0000
    10 {target} 0002 04 0000 2710
    03 {target} 0002
    06 007C 0067                                               # absolute
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    10 {target} 0002 04 FFFF F63C
    06 007C 0066                                               # relative
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    10 {target} 0002 04 0000 7530
    06 007C 0067
    wait 40
    06 007C 00E2                                               # stop after 0.05 s
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    10 {target} 0002 04 0000 3A98
    06 007C 0067
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    06 007C 006E                                               # home again, and to 2500
    03 {status} 0001 | 0410=0000
    10 {target} 0002 04 0000 09C4
    06 007C 0067
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    10 007D 0002 04 0000 0000                                  # zero
    06 007C 0098
    06 007C 00A5
    03 {actual} 0002
    10 {target} 0002 04 0000 0064
    06 007C 0066
    03 {status} 0001 | 0010=0000
    03 {actual} 0002
    """


APPLIED_MOTION_MOVES: Final = (
    (MoveKind.HOME, None),
    (MoveKind.ABSOLUTE, 10_000),
    (MoveKind.RELATIVE, 7_500),
    (MoveKind.ABSOLUTE, 30_000),
    (MoveKind.STOP, 10_000),
    (MoveKind.ABSOLUTE, 15_000),
    (MoveKind.HOME, None),
    (MoveKind.ABSOLUTE, 2_500),
    (MoveKind.SET_POSITION, 0),
    (MoveKind.SET_POSITION, 0),
    (MoveKind.RELATIVE, 100),
)
APPLIED_MOTION_16: Final = Session(
    "applied-motion-16", "rtu", 32, _applied_motion("001E", "0004", "0001"), APPLIED_MOTION_MOVES
)
APPLIED_MOTION_32: Final = Session(
    "applied-motion-32", "tcp", 1, _applied_motion("015E", "0006", "0003"), APPLIED_MOTION_MOVES
)

MAKERBASE_SERVO42D: Final = Session(
    "makerbase-servo42d",
    "rtu",
    1,
    """
    06 0091 0001                                               # home
    wait 1000
    10 00F5 0004 08 0002 012C 0000 2710                        # to 10 000
    04 0031 0003 | =0000 0000 2710
    10 00F4 0004 08 0002 012C FFFF F63C                        # by -2500
    04 0031 0003 | =0000 0000 1D4C
    10 00F5 0004 08 0002 012C 0000 7530                        # to 30 000
    wait 40
    10 00F5 0004 08 0002 0000 0000 0000                        # stop after 0.05 s: no target
    wait 1000
    04 0031 0003
    10 00F5 0004 08 0002 012C 0000 3A98                        # to 15 000
    04 0031 0003 | =0000 0000 3A98
    06 0091 0001                                               # home again, and to 2500
    wait 1000
    10 00F5 0004 08 0002 012C 0000 09C4
    04 0031 0003 | =0000 0000 09C4
    10 00F5 0004 08 0002 012C FFFF FC18                        # to -1000
    04 0031 0003 | =FFFF FFFF FC18
    04 00F1 0001 | =0001
    06 00F3 0001                                               # motor on: nothing moves
    06 0092 0001                                               # zero
    04 0031 0003
    06 1234 0001                                               # refused with FFFF
    10 00F6 0001 02 0001                                       # refused with a count of 0
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
        (MoveKind.ABSOLUTE, -1_000),
        (MoveKind.SET_POSITION, 0),
    ),
)

STEPPERONLINE_ESS_RS: Final = Session(
    "stepperonline-ess-rs",
    "rtu",
    1,
    """
    03 0019 0001
    10 0021 0005 0A 0064 0064 012C 0000 2710                   # to 10 000
    03 0021 0005
    06 0027 0005
    03 0007 0001 | 0004=0000
    03 0006 0007
    10 0024 0002 04 FFFF F63C                                  # by -2500
    06 0027 0001
    03 0007 0001 | 0004=0000
    03 000A 0002
    10 0024 0002 04 0000 7530                                  # to 30 000
    06 0027 0005
    wait 40
    06 0027 0100                                               # stop after 0.05 s
    03 0007 0001 | 0004=0000
    03 000A 0002
    06 0024 0000                                               # to 15 000, word by word
    06 0025 3A98
    06 0027 0005
    03 0007 0001 | 0004=0000
    03 000A 0002
    06 002D 0012                                               # motor on, fault reset: nothing moves
    06 002D 0021
    10 0024 0002 04 0000 4E20                                  # to 20 000, and at once to 12 000 instead
    06 0027 0005
    wait 40
    10 0024 0002 04 0000 2EE0
    06 0027 000D
    03 0007 0001 | 0004=0000
    03 000A 0002
    06 0027 0010                                               # home, and to 2500
    03 0007 0001 | 0004=0000
    10 0024 0002 04 0000 09C4
    06 0027 0005
    03 0007 0001 | 0004=0000
    03 000A 0002
    06 002D 0031                                               # zero, and to 100
    10 0024 0002 04 0000 0064
    06 0027 0005
    03 0007 0001 | 0004=0000
    03 000A 0002
    03 0000 0011                                               # seventeen registers: refused
    """,
    (
        (MoveKind.ABSOLUTE, 10_000),
        (MoveKind.RELATIVE, 7_500),
        (MoveKind.ABSOLUTE, 30_000),
        (MoveKind.STOP, 10_000),
        (MoveKind.ABSOLUTE, 15_000),
        (MoveKind.ABSOLUTE, 20_000),
        (MoveKind.ABSOLUTE, 12_000),
        (MoveKind.HOME, None),
        (MoveKind.ABSOLUTE, 2_500),
        (MoveKind.SET_POSITION, 0),
        (MoveKind.ABSOLUTE, 100),
    ),
)

TL_R: Final = Session(
    "tl-r",
    "rtu",
    1,
    """
    06 004E 0010                                               # home
    03 0004 0001 | 0002=0002
    06 004E 0000
    06 0034 0064                                               # to 10 000, register by register
    06 0035 0064
    06 0036 012C
    06 0037 0000
    06 0038 2710
    06 004E 0003
    03 0004 0001 | 0001=0001
    03 0037 0002
    03 0004 0006
    06 004E 0000
    06 0037 FFFF                                               # by -2500
    06 0038 F63C
    06 004E 0001
    03 0004 0001 | 0001=0001
    03 0008 0002
    06 004E 0000
    06 0037 0000                                               # to 30 000
    06 0038 7530
    06 004E 0003
    wait 40
    06 004E 0020                                               # stop after 0.05 s
    03 0004 0001 | 0004=0000
    03 0008 0002
    06 004E 0000
    06 0038 3A98                                               # to 15 000
    06 004E 0003
    03 0004 0001 | 0001=0001
    03 0008 0002
    06 004E 0000
    06 004E 0010                                               # home again, and to 2500
    03 0004 0001 | 0002=0002
    06 004E 0000
    06 0038 09C4
    06 004E 0003
    03 0004 0001 | 0001=0001
    03 0008 0002
    06 004F 0400                                               # zero
    03 0008 0002
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
    ),
)

SESSIONS: Final = (
    IAI_ROBO_CYLINDER,
    SMC_LEC,
    APPLIED_MOTION_16,
    APPLIED_MOTION_32,
    MAKERBASE_SERVO42D,
    STEPPERONLINE_ESS_RS,
    TL_R,
)
