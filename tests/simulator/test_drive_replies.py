"""What drives reply to a frame, and which move comes of some: a row for each."""

from collections.abc import Sequence

import pytest

from gateway.simulator.ledger import MoveKind
from tests.simulator.drive_bench import ABSOLUTE, HOME, OTHER, RELATIVE, SET_POSITION, STOP, ready

IAI_TARGET = "10 9900 0002 04 0000 0005"
AKD_TARGET = "10 001E 0002 04 0000 2710"
AKD_MOVE = ["10 0016 0002 04 0000 0000", "10 0016 0002 04 0000 0001"]
REPLIES = {
    "makerbase-servo42d": [  # it refuses without exceptions
        ("06 1234 0001", "06 12 34 FF FF"),
        ("06 00F5 0001", "06 00 F5 FF FF"),
        ("10 00F6 0001 02 0001", "10 00 F6 00 00"),
        ("10 00F5 0002 04 0000 2710", "10 00 F5 00 00"),  # half an opcode
        ("10 00F4 0005 0A 0002 012C 0000 2710 0000", "10 00 F4 00 00"),
        ("04 00F5 0004", ""),
        ("03 0031 0003", ""),
    ],
    "stepperonline-ess-rs": [("03 0000 0011", "83 03"), ("03 00C0 0001", "83 02")],
    "tl-r": [("03 00C8 0001", "83 02")],
    "oriental-az": [("17 005C 0002 005C 0002 04 0000 0102", "97 01"), ("08 0000 A537", "08 00 00 A5 37")],
    "oriental-blv-r": [  # it writes and reads with one frame
        ("17 005C 0002 005C 0002 04 0000 0102", "17 04 00 00 01 02")
    ],
    "festo-cmmt-111": [
        ("05 0000 FF00", "85 01"),
        ("03 001B 0002", "83 02"),
        ("2B 0D 00 00", "AB 03"),
        # who it is
        ("2B 0E 01 00", "2B 0E 01 01 00 00 03 00 05 46 65 73 74 6F 01 04 43 4D 4D 54 02 01 31"),
    ],
    "festo-cmmo-fhpp": [("03 0008 0001", "83 02"), ("07", "07 00")],
    "iai-robo-cylinder": [
        ("04 9000 0002", "84 01"),
        ("03 8FFF 0002", "83 02"),
        ("05 0103 FF00", "85 02"),
        ("10 9901 0009 12 0000 0000 0000 0000 0000 0000 0000 0000 0000", "90 02"),
    ],
    "smc-lec": [
        ("06 9102 0001", "86 01"),
        ("04 9000 0002", "84 01"),
        ("03 9010 0002", "83 02"),
        ("02 0080 0001", "82 02"),
    ],
    "leadshine-pr": [
        ("04 602C 0002", "84 01"),
        ("03 8000 0001", "83 02"),
        ("06 9000 0001", "86 02"),
        ("03 6200 0062", "83 03"),  # 98 registers: the reply would be longer than 200 bytes
        ("10 6200 0002 02 0001", "90 03"),
    ],
    "delta-asda": [  # codes of its own
        ("04 0520 0002", "84 01"),
        ("03 0800 0001", "83 01"),  # group 8
        ("03 02C8 0001", "83 02"),  # P2-100
        ("03 0200 000B", "83 04"),  # 11 words
        ("03 0200 0000", "83 05"),
        ("06 0520 0000", "86 06"),
        ("06 050E 0100", "86 27"),  # path 256
    ],
    "kinco-fd": [  # function bytes of its own
        ("03 3201 0002", "81 02"),
        ("03 4000 0003", "81 02"),
        ("06 0001 0001", "86 02"),
        ("10 0001 0001 02 0001", "90 02"),
        ("04 3700 0002", "84 01"),
    ],
    "mitsubishi-mr-je-c": [
        ("03 6065 0002", "83 02"),
        ("03 607B 0001", "83 02"),
        ("03 607A 0001", "83 03"),
        ("10 607A 0001 02 0001", "90 03"),
        ("10 6064 0002 04 0000 0000", "90 02"),
        ("06 6040 000F", "86 01"),
        ("17 6040 0001 6040 0001 02 000F", "97 01"),
        ("08 0000 1234", "08 00 00 12 34"),
    ],
}


@pytest.mark.parametrize(
    ("name", "request_pdu", "reply"),
    [(name, request, reply) for name, rows in REPLIES.items() for request, reply in rows],
)
def test_a_drive_replies_as_its_manual_says_and_moves_nothing(
    name: str, request_pdu: str, reply: str
) -> None:
    drive = ready(name)
    assert drive.ask(request_pdu) == reply
    assert drive.moves == []


ORIENTAL_TYPE = "10 005A 000E 1C 0000 0001 FFFF FC18 0000 03E8 0000 03E8 0000 03E8 0000 03E8 0000 0001"
MOVES: list[tuple[str, str, list[str], Sequence[tuple[MoveKind, int | None]]]] = [
    *(
        row
        for name in ("oriental-az", "oriental-blv-r")
        for row in (
            ("the frame may begin at the type", name, [ORIENTAL_TYPE], [(ABSOLUTE, -1_000)]),
            (
                "the position is preset",
                name,
                ["10 038C 0002 04 0000 0064", "10 018A 0002 04 0000 0001"],
                [(SET_POSITION, 100)],
            ),
        )
    ),
    (
        "with trigger -4 the speed starts the move",
        "oriental-az",
        [
            "10 005A 0004 08 0000 0001 0000 000A",
            "10 0066 0002 04 FFFF FFFC",
            "10 005C 0002 04 0000 000B",
            "10 005E 0002 04 0000 0064",
        ],
        [(ABSOLUTE, 11)],
    ),
    *(
        (
            "more than one trigger starts, and type 0 stops",
            "oriental-blv-r",
            [
                "10 005A 0004 08 0000 0001 0000 2710",
                f"10 0066 0002 04 {trigger}",
                "10 005A 0004 08 0000 0000 0000 0000",
                "10 0066 0002 04 0000 0001",
            ],
            [(ABSOLUTE, 10_000), (STOP, 0)],
        )
        for trigger in ("0000 0002", "0000 0003", "0000 0013")
    ),
    *(
        (
            "it moves again with speed, ramp or force",
            "iai-robo-cylinder",
            [IAI_TARGET, starting],
            [(ABSOLUTE, 5)] * 2,
        )
        for starting in ("10 9904 0002 04 0000 2710", "06 9906 001E", "06 9907 007F")
    ),
    ("no move with a band", "iai-robo-cylinder", ["10 9902 0002 04 0000 000A"], []),
    ("no move with flags", "iai-robo-cylinder", ["06 9908 0008"], []),
    ("its coils as a register", "iai-robo-cylinder", ["06 0D00 1000", "06 0D00 1010"], [(HOME, None)]),
    (
        "one command at a time",
        "tl-r",
        ["06 004F 0500", "06 004F 0300", "06 004F 0600", "06 004F 0400"],
        [(STOP, 0), (SET_POSITION, 0)],
    ),
    (
        "reference point",
        "festo-cmmt-111",
        ["06 0002 0002", "06 0002 0002", "06 0002 0000"],
        [(SET_POSITION, 0)],
    ),
    *(
        (
            "the kind of a task",
            "kollmorgen-akd2g",
            [AKD_TARGET, f"10 0020 0002 04 {control}", *AKD_MOVE],
            [move],
        )
        for control, move in {
            "0000 0001": (RELATIVE, 10_000),
            "0000 0003": (RELATIVE, 10_000),
            "0000 0005": (OTHER, None),
            "0000 0007": (RELATIVE, 10_000),
            "0000 0010": (OTHER, None),
        }.items()
    ),
    (
        # Read-only FAULTED and unknown 12 to 18 in front of MOTIONCONTROL and MT.MOVE.
        "blocks run to their end",
        "kollmorgen-akd2g",
        [AKD_TARGET, "10 000A 000E 1C" + " 0000" * 13 + " 0001"],
        [(ABSOLUTE, 10_000)],
    ),
    (
        "a target for each path",
        "delta-asda",
        ["10 060A 0002 04 FFFF FFFF", "10 060E 0002 04 0007 0000", "06 050E 0003", "06 050E 0002"],
        [(ABSOLUTE, 7), (ABSOLUTE, -1)],
    ),
    (
        "a half as it comes",
        "delta-asda",
        ["06 0606 000A", "06 0607 0001", "06 050E 0001"],
        [(ABSOLUTE, 0x1_000A)],
    ),
    ("an unknown definition", "delta-asda", ["10 0604 0002 04 0001 0000", "06 050E 0001"], [(OTHER, None)]),
]


@pytest.mark.parametrize(
    ("name", "requests", "moves"), [row[1:] for row in MOVES], ids=[f"{row[1]}: {row[0]}" for row in MOVES]
)
def test_frames_make_a_drive_do_this_and_no_more(
    name: str, requests: list[str], moves: Sequence[tuple[MoveKind, int | None]]
) -> None:
    drive = ready(name)
    drive.does(*requests)
    assert drive.moves == moves
