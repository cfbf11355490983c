"""Axes that name a drive: a shipped profile or a file of their own, and what is said when it does not fit."""

from pathlib import Path

import pytest

from gateway.config.drive_files import read_profile
from gateway.config.summary import DriveSummary, summary, summary_lines
from gateway.drives import library
from gateway.drives.profile import Transport
from gateway.modbus.registers import BitField, PositionField, RegisterType, WordOrder
from tests.config.config_bench import GOOD, edited, line_of, loaded, refusal, refused

RTU = 'drives = { rtu = "/dev/serial/by-id/usb-B", baudrate = 115200, parity = "even" }'
WITHOUT_REGISTERS = GOOD[: GOOD.index("[axis.x.registers]")]

OWN = """\
title = "A drive of mine"
transports = ["rtu"]
[registers]
command = [{ address = 0x10, type = "int32", words = "low-first" }]
actual = [{ address = 0x20, type = "int32" }]
bits.homed = { address = 0x30, bit = 2 }
gap_ms = 4.0
[[traps]]
what = "it bites"
"""


def with_drive(drive: str, *changes: tuple[str, str]) -> str:
    return edited(("max_speed = 200.0", f'drive = "{drive}"'), *changes, text=WITHOUT_REGISTERS)


def own(folder: Path, text: str = OWN) -> str:
    (folder / "mine.toml").write_text(text)
    return with_drive("./mine.toml")


def test_a_file_of_ones_own_gives_the_axis_its_registers(tmp_path: Path) -> None:
    result = loaded(tmp_path, own(tmp_path))
    assert result.warnings == ()
    (line,) = result.plan.lines
    (axis,) = line.axes
    assert axis.command == (PositionField(0x10, RegisterType.INT32, WordOrder.LOW_FIRST),)
    assert axis.actual == (PositionField(0x20, RegisterType.INT32),)
    assert axis.bits == {"homed": BitField(0x30, 2)}
    assert line.timing.gap_ms == 4.0
    assert result.drives["x"].profile.title == "A drive of mine"


def test_the_summary_names_the_drive_and_counts_its_traps(tmp_path: Path) -> None:
    result = loaded(tmp_path, own(tmp_path))
    drive = summary(result.plan, result.drives).axes["x"].drive
    assert drive == DriveSummary("./mine.toml", "A drive of mine", tier="own", traps=1)
    assert any(
        "A drive of mine (./mine.toml): a profile of your own, 1 traps to check" in text
        for text in summary_lines(result.plan, result.drives)
    )


WAYS = {
    "applied-motion-16": "homing",
    "applied-motion-32": "set-position",
    "igus-dryve-d1": "homing",
    "kollmorgen-akd2g": "absolute",
    "makerbase-servo42d": "set-position",
    "mitsubishi-mr-je-c": "homing",
}
"""How drives without a lasting homed bit are known to be referenced."""
NOTHING_STANDS = "neither bits.done nor bits.moving is mapped"
EXPECTED = {
    "applied-motion-32": NOTHING_STANDS,
    "makerbase-servo42d": NOTHING_STANDS,
    "kollmorgen-akd2g": "no value is listed that stops the axis",
}
"""What nothing public tells about a drive."""


@pytest.mark.parametrize("name", library.names())
def test_every_shipped_profile_makes_a_good_configuration(tmp_path: Path, name: str) -> None:
    text = with_drive(name, ('"drive-bit"', f'"{WAYS.get(name, "drive-bit")}"'))
    if Transport.RTU not in library.shipped(name).transports:
        text = edited((RTU, 'drives = { tcp = "192.168.0.9:502" }'), text=text)
    result = loaded(tmp_path, text)
    [axis] = result.plan.lines[0].axes
    assert axis.drive == name
    assert axis.command
    assert [EXPECTED[name] in warning.found for warning in result.warnings] == [True] * (name in EXPECTED)
    assert all(warning.line == line_of(text, f'drive = "{name}"') for warning in result.warnings)


@pytest.mark.parametrize(
    ("drive", "said"),
    [
        ("oriental-ax", "did you mean oriental-az"),
        ("delta", "did you mean delta-asda?"),
        ("leadshine", "did you mean leadshine-el7 or leadshine-pr?"),
        ("zzz", "`pitch-gateway drives` lists them all"),
    ],
)
def test_a_name_that_does_not_exist_suggests_near_ones(tmp_path: Path, drive: str, said: str) -> None:
    text = with_drive(drive)
    problem = refusal(tmp_path, text, "axis.x.drive")
    assert problem.found == f'there is no profile "{drive}"'
    assert said in problem.remedy
    assert "pitch-gateway drives" in problem.remedy
    assert problem.line == line_of(text, "drive =" + f' "{drive}"')


def test_registers_beside_a_drive_are_refused(tmp_path: Path) -> None:
    text = edited(("max_speed = 200.0", 'drive = "oriental-az"'))
    problem = refusal(tmp_path, text, "axis.x.registers", at="[axis.x.registers]")
    assert "pitch-gateway drives show oriental-az --toml" in problem.remedy


def test_a_file_that_does_not_exist_is_named(tmp_path: Path) -> None:
    text = with_drive("./missing.toml")
    problem = refusal(tmp_path, text, "axis.x.drive", at='drive = "./missing.toml"')
    assert problem.found == f"{tmp_path / 'missing.toml'}: no such file"
    assert problem.remedy == "give the path of a drive profile"


def test_a_folder_is_no_profile(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    problem = refusal(tmp_path, with_drive("./mine"), "axis.x.drive")
    assert problem.found == f"{tmp_path / 'mine'}: a folder"
    assert problem.remedy == "give the path of a drive profile in it"


@pytest.mark.parametrize(
    ("old", "new", "key", "said"),
    [
        ("gap_ms", "gap_mss", "registers.gap_mss", "did you mean gap_ms?"),
        ('type = "int32" }', 'type = "int33" }', "registers.actual[1].type", '"int32"'),
        ('words = "low-first"', 'words = "middle"', "registers.command[1].words", '"low-first"'),
        ("0x20", "0x11", "registers.actual[1]", "a register belongs to one position"),
        ("gap_ms = 4.0", "max_registers = 1", "registers.max_registers", "allowed: 2 or more"),
        ('["rtu"]', '["can"]', "transports[1]", '"rtu"'),
        ('what = "it bites"', 'whatever = "it bites"', "traps[1].whatever", "did you mean what?"),
        ("[[traps]]", '[evidence]\n"comand" = { confidence = "verified" }\n[[traps]]', "evidence.comand", ""),
        (
            "[[traps]]",
            '[evidence]\n"actual" = { confidence = "verified", sources = ["m"] }\n[[traps]]',
            "evidence.actual.sources",
            "[sources] is empty",
        ),
        ("[[traps]]", '[sources.m]\nname = "M"\n[[traps]]', "sources.m.name", "title"),
        ('title = "A drive of mine"', "", "title", "needed"),
    ],
)
def test_what_is_wrong_in_a_file_of_ones_own_is_said_with_its_line(
    tmp_path: Path, old: str, new: str, key: str, said: str
) -> None:
    text = edited((old, new), text=OWN)
    problems = refused(tmp_path, own(tmp_path, text))
    assert key in [problem.key for problem in problems]
    problem = next(problem for problem in problems if problem.key == key)
    assert problem.file == str(tmp_path / "mine.toml")
    assert said in problem.remedy
    if new:
        assert problem.line is not None
        assert (
            new.splitlines()[-2 if "[[traps]]" in new else 0].split(" =")[0]
            in text.splitlines()[problem.line - 1]
        )


def test_checks_of_an_axis_look_at_the_registers_of_its_profile(tmp_path: Path) -> None:
    # 300 mm x 1000 counts do not fit an int16; there is no homed bit.
    small = edited(
        ('0x10, type = "int32", words = "low-first"', '0x10, type = "int16"'),
        ("bits.homed = { address = 0x30, bit = 2 }\n", ""),
        text=OWN,
    )
    text = own(tmp_path, small)
    problems = refused(tmp_path, text)
    assert [problem.key for problem in problems] == ["axis.x.referenced", "axis.x.registers.command[1]"] or [
        problem.key for problem in problems
    ] == ["axis.x.registers.command[1]", "axis.x.referenced"]
    fits = next(problem for problem in problems if problem.key.endswith("command[1]"))
    assert fits.line == line_of(text, 'drive = "./mine.toml"')


def test_the_motion_of_a_profile_is_looked_at_as_that_of_a_map(tmp_path: Path) -> None:
    profile = edited(("gap_ms", 'write = "fc06"\ngap_ms'), text=OWN)
    problem = refusal(tmp_path, own(tmp_path, profile), "registers.write")
    assert problem.file == str(tmp_path / "mine.toml")
    assert problem.line == line_of(profile, 'write = "fc06"')


def test_the_plan_names_a_shipped_profile_and_no_file_of_ones_own(tmp_path: Path) -> None:
    shipped, mine = loaded(tmp_path, with_drive("oriental-az")), loaded(tmp_path, own(tmp_path))
    assert [result.plan.lines[0].axes[0].drive for result in (shipped, mine)] == ["oriental-az", ""]


def test_a_line_of_another_kind_is_warned_of(tmp_path: Path) -> None:
    text = edited((RTU, 'drives = { tcp = "192.168.0.9:502" }'), text=own(tmp_path))
    (warning,) = loaded(tmp_path, text).warnings
    assert warning.key == "axis.x.drive"
    assert "speaks Modbus RTU, but the drives of line xyz are on Modbus TCP" in warning.found


def test_an_axis_that_lacks_something_else_still_gets_its_profile_looked_at(tmp_path: Path) -> None:
    text = edited(("counts_per_unit = 1000.0\n", ""), text=with_drive("nothing-like-it"))
    keys = [problem.key for problem in refused(tmp_path, text)]
    assert sorted(keys) == ["axis.x.counts_per_unit", "axis.x.drive"]


@pytest.mark.parametrize("name", library.names())
def test_a_shipped_profile_can_be_copied_and_named_as_a_file(tmp_path: Path, name: str) -> None:
    path = tmp_path / "copy.toml"
    path.write_text(library.text_of(name), encoding="utf-8")
    assert read_profile(path) == library.shipped(name)
