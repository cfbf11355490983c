"""What neither profile nor simulated drive knows moves nothing, and is told loudly."""

import pytest

from tests.simulator.drive_bench import Drive


def cmmt(control: int, kind: int, target: int) -> str:
    """Return an image of telegram 111: STW1, POS_STW1, the target low word first."""
    words = (control, kind, 0, 0, 0, target, 0)
    return "10 0000 0007 0E " + " ".join(f"{word:04X}" for word in words)


@pytest.mark.parametrize(
    ("name", "frames", "told"),
    [
        ("smc-lec", ("05 0019 FF00", "05 0030 FF00", "10 9100 0001 02 1000"), "0x1000 in 0x9100"),
        ("tl-r", ("06 004E 0080",), "0x0080 in 0x004e"),
        ("oriental-az", ("06 0067 0002",), "0x0002 in 0x0067"),
        ("oriental-blv-r", ("06 007D 0001", "06 0067 0014"), "0x0014 in 0x0067"),  # 1 to 19 start
        ("festo-cmmt-111", (cmmt(0x043F, 0x8000, 1), cmmt(0x043F, 0x9000, 2)), "0x9000 in 0x0001"),
        ("festo-cmmt-111", (cmmt(0x043F, 0x0100, 1), cmmt(0x043F, 0x1100, 2)), "0x1100 in 0x0001"),
        (
            "festo-cmmo-fhpp",
            ("10 0000 0004 08 4301 0000 0000 0000", "10 0000 0004 08 4303 0800 0000 0064"),
            "0x0800 in 0x0001",
        ),
    ],
)
def test_unknown_frames_are_told(
    name: str, frames: tuple[str, ...], told: str, caplog: pytest.LogCaptureFixture
) -> None:
    drive = Drive(name)
    drive.does(*frames)
    assert drive.moves == []
    [said] = drive.unit.ledger.unheard_of
    assert told in said
    assert caplog.messages == [said]
