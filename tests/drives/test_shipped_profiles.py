"""The profiles that come with the gateway: whole, with a reason for each value, and true to their sources."""

import re
from typing import Any

import pytest

from gateway.drives import library
from gateway.drives.motion import Action, Addressing, Form, MotionPlan, Operation, TriggerPlan
from gateway.drives.profile import Confidence, Profile, Tier, entries, evidence_of, faults
from gateway.drives.public import public_traffic
from gateway.modbus.registers import BitField, BitTable, FieldAccess, PositionField
from tests.contract.through import axis_plan, table_of
from tests.exchange.line_bench import Bench

TIER_A = {
    "applied-motion-16",
    "applied-motion-32",
    "delta-asda",
    "iai-robo-cylinder",
    "kinco-fd",
    "leadshine-el7",
    "leadshine-pr",
    "makerbase-servo42d",
    "mitsubishi-mr-je-c",
    "oriental-az",
    "oriental-blv-r",
    "smc-lec",
}
TIER_B = {
    "festo-cmmo-fhpp",
    "festo-cmmt-111",
    "igus-dryve-d1",
    "jmc-rc",
    "kollmorgen-akd2g",
    "stepperonline-ess-rs",
    "tl-r",
}


def motion(name: str) -> MotionPlan:
    return library.shipped(name).registers.motion()


def deeds(name: str, address: int, word: int, before: int | None = 0) -> set[Action]:
    """What writing a word to a register does, by all rules that look at it."""
    return {
        trigger.operation(word, before).action
        for trigger in motion(name).triggers
        if trigger.address == address and not trigger.is_coil
    } - {Action.IGNORE}


def coil_triggers(name: str) -> dict[int, TriggerPlan]:
    """Return the rules that look at a coil, by its address."""
    return {trigger.address: trigger for trigger in motion(name).triggers if trigger.is_coil}


def fields(name: str, key: str) -> list[PositionField]:
    positions: Any = getattr(library.shipped(name).registers, key)
    return [position.field() for position in positions]


def test_the_drives_that_are_shipped() -> None:
    tiers = {name: library.shipped(name).tier for name in library.names()}
    assert {name for name, tier in tiers.items() if tier is Tier.A} == TIER_A
    assert {name for name, tier in tiers.items() if tier is Tier.B} == TIER_B


@pytest.mark.parametrize("name", library.names())
def test_a_shipped_profile_is_whole(name: str) -> None:
    assert list(faults(library.shipped(name), is_shipped=True)) == []


@pytest.mark.parametrize("name", library.names())
def test_every_source_is_used_and_public(name: str) -> None:
    profile = library.shipped(name)
    used = {source for evidence in profile.evidence.values() for source in evidence.sources}
    used |= {sequence.source for sequence in public_traffic(name)}
    assert used == set(profile.sources)
    for source in profile.sources.values():
        assert source.note
        assert not source.url or re.fullmatch(r"https?://\S+", source.url)


@pytest.mark.parametrize("name", library.names())
def test_what_is_called_verified_has_two_sources_or_a_manual(name: str) -> None:
    """One source is enough only where it is the maker's document about the drive itself."""
    profile = library.shipped(name)
    for key, evidence in profile.evidence.items():
        if evidence.confidence is Confidence.VERIFIED and len(evidence.sources) < 2:
            source = profile.sources[evidence.sources[0]]
            assert "manual" in source.title, f"{name}: {key}"


@pytest.mark.parametrize("name", library.names())
def test_texts_of_traps_are_sentences(name: str) -> None:
    for trap in library.shipped(name).traps:
        assert trap.what.endswith(".")
        assert not trap.check or trap.check.endswith((".", "?"))


@pytest.mark.parametrize("name", library.names())
def test_nothing_of_the_machine_it_was_written_on_is_in_a_profile(name: str) -> None:
    text = library.text_of(name)
    assert not re.search(r"/work|/tmp|/home|facts/|drives\.(md|json)", text.replace("docs/drives.md", ""))


def test_a_profile_is_named_like_its_file() -> None:
    assert library.names() == tuple(sorted(library.names()))
    with pytest.raises(KeyError):
        library.text_of("nobody-1")


def test_evidence_of_a_part_is_that_of_the_whole_unless_it_has_its_own() -> None:
    profile = library.shipped("leadshine-pr")
    verified = evidence_of(profile, "command[1].words")
    assert verified is not None
    assert verified.confidence is Confidence.VERIFIED
    relative = evidence_of(profile, "mode.relative_to_commanded")
    assert relative is not None
    assert relative.confidence is Confidence.SINGLE_SOURCE
    assert evidence_of(profile, "gap_ms") is None
    assert "command[1]" in entries(profile.written())


def small(**keys: Any) -> Profile:
    registers = {"command": [{"address": 1, "type": "int32"}]}
    return Profile.model_validate({"title": "T", "registers": registers, **keys})


def test_a_shipped_profile_without_reasons_has_faults_and_ones_own_has_none() -> None:
    assert list(faults(small())) == []
    found = {fault.found for fault in faults(small(), is_shipped=True)}
    assert 'nothing is said about "command[1]"' in found
    assert 'tier = "own"' in found


# What follows is worked out by hand from the manuals' own words and frames.


def test_leadshine_runs_a_path_by_its_number() -> None:
    # 0x6002 = 0x10 + P; path P at 0x6200 + 8 P.
    plan = motion("leadshine-pr")
    trigger = plan.triggers[0]
    assert trigger.operation(0x0013, None) == Operation(Action.START, 3)
    assert deeds("leadshine-pr", 0x6002, 0x20) == {Action.HOME}
    assert deeds("leadshine-pr", 0x6002, 0x21) == {Action.SET_POSITION}
    assert deeds("leadshine-pr", 0x6207, 0x40) == {Action.STOP}
    paths = library.shipped("leadshine-pr").registers.command[0].fields()
    assert [path.address for path in paths[:3]] == [0x6201, 0x6209, 0x6211]
    mode = plan.mode(3)
    assert mode is not None
    assert mode.address == 0x6218


@pytest.mark.parametrize(
    ("word", "action"),
    [
        (0x0001, Action.ABSOLUTE),
        (0x0011, Action.ABSOLUTE),  # with interrupt
        (0x0041, Action.RELATIVE_TO_COMMANDED),
        (0x0002, Action.OTHER_MOTION),
        (0x0003, Action.HOME),
        (0x4101, Action.UNKNOWN),  # jumps to path 1 afterwards
        (0x0000, Action.UNKNOWN),
        (0x0081, Action.UNKNOWN),  # on the servos a distance from the motor's place, here nobody says
        (0x00C1, Action.UNKNOWN),
    ],
)
def test_leadshine_modes(word: int, action: Action) -> None:
    mode = motion("leadshine-pr").mode(0)
    assert mode is not None
    assert mode.action(word) is action


def test_leadshine_servos_have_one_field_for_what_a_distance_counts_from() -> None:
    mode = motion("leadshine-el7").mode(0)
    assert mode is not None
    actions = {word: mode.action(word) for word in (0x0001, 0x0041, 0x0081, 0x0091, 0x00C1, 0x0082, 0x4081)}
    assert actions == {
        0x0001: Action.ABSOLUTE,
        0x0041: Action.RELATIVE_TO_COMMANDED,
        0x0081: Action.RELATIVE_TO_ACTUAL,
        0x0091: Action.RELATIVE_TO_ACTUAL,  # with interrupt
        0x00C1: Action.UNKNOWN,
        0x0082: Action.OTHER_MOTION,
        0x4081: Action.UNKNOWN,  # jumps afterwards
    }


def test_oriental_values_stand_in_the_lower_words() -> None:
    # FC16 0x0058 x16 [0,0, 0,1, posH,posL, ..., 0,1]: type in 0x005B, position in 0x005C, trigger in 0x0067.
    for name in ("oriental-az", "oriental-blv-r"):
        plan = motion(name)
        mode = plan.mode(0)
        assert mode is not None
        assert mode.address == 0x005B
        assert mode.action(1) is Action.ABSOLUTE
        assert fields(name, "command")[0].address == 0x005C
        assert deeds(name, 0x0067, 1) == {Action.START}
        assert deeds(name, 0x0067, 0x10000 - 5) == {Action.FOLLOW_NEXT}


def test_oriental_remote_inputs() -> None:
    assert deeds("oriental-az", 0x007D, 0x0008) == {Action.STORED}
    assert deeds("oriental-az", 0x007D, 0x0008, before=0x0008) == set()
    assert deeds("oriental-az", 0x007D, 0x0010) == {Action.HOME}
    assert deeds("oriental-az", 0x007D, 0x0020) == {Action.STOP}
    assert deeds("oriental-az", 0x007D, 0x0100) == {Action.STORED}
    assert deeds("oriental-az", 0x007D, 0x4000) == {Action.OTHER_MOTION}
    assert deeds("oriental-az", 0x007D, 0x0000, before=0x4000) == set()
    assert deeds("oriental-az", 0x007D, 0x0080) == set()  # alarm reset


def test_oriental_az_operation_types() -> None:
    mode = motion("oriental-az").mode(0)
    assert mode is not None
    actions = {kind: mode.action(kind) for kind in (0, 1, 2, 3, 7, 8, 16, 17, 18, 20, 21, 22)}
    assert actions == {
        0: Action.UNKNOWN,  # no setting
        1: Action.ABSOLUTE,
        2: Action.RELATIVE_TO_COMMANDED,
        3: Action.RELATIVE_TO_ACTUAL,
        7: Action.OTHER_MOTION,
        8: Action.UNKNOWN,  # wrap
        16: Action.OTHER_MOTION,
        17: Action.OTHER_MOTION,
        18: Action.OTHER_MOTION,
        20: Action.ABSOLUTE,  # pushes
        21: Action.RELATIVE_TO_COMMANDED,
        22: Action.RELATIVE_TO_ACTUAL,
    }
    for copy in (0x0075, 0x0079):
        assert deeds("oriental-az", copy, 0x0020) == {Action.STOP}
        assert deeds("oriental-az", copy, 0x0010) == {Action.HOME}
        assert deeds("oriental-az", copy, 0x0008) == {Action.STORED}
        assert deeds("oriental-az", copy, 0x0400) == {Action.STORED}
        assert deeds("oriental-az", copy, 0x4000) == {Action.OTHER_MOTION}
        assert deeds("oriental-az", copy, 0x0080) == set()
    # What is off again by itself rises with every write.
    assert deeds("oriental-az", 0x0079, 0x0008, before=0x0008) == {Action.STORED}
    assert deeds("oriental-az", 0x0075, 0x0008, before=0x0008) == set()
    assert deeds("oriental-az", 0x018B, 1) == {Action.SET_POSITION}


def test_oriental_blv_r_inputs_triggers_and_stops() -> None:
    for first in (0x007C, 0x0074, 0x0078):
        assert deeds("oriental-blv-r", first, 0x0010) == {Action.HOME}
        assert {*deeds("oriental-blv-r", first, 0x0040), *deeds("oriental-blv-r", first, 0x0080)} == {
            Action.STORED
        }
        for turn in (0x0001, 0x0002, 0x0004, 0x0008):
            assert deeds("oriental-blv-r", first, turn) == {Action.OTHER_MOTION}
        assert deeds("oriental-blv-r", first, 0x0300) == set()  # which data START would run
        for stop in (0x0009, 0x0011, 0x0021, 0x0041):  # CLR, QSTOP, STOP, FREE
            assert deeds("oriental-blv-r", first + 1, stop) == {Action.STOP}
        assert deeds("oriental-blv-r", first + 1, 0x0101) == {Action.STORED}
        assert deeds("oriental-blv-r", first + 1, 0x0081) == set()  # S-ON and alarm reset
    assert deeds("oriental-blv-r", 0x007D, 0x0000) == {Action.STOP}
    for trigger in (1, 2, 3, 4, 0x13):
        assert deeds("oriental-blv-r", 0x0067, trigger) == {Action.START}
    assert deeds("oriental-blv-r", 0x0067, 0x14) == {Action.UNKNOWN}
    assert deeds("oriental-blv-r", 0x018B, 1) == {Action.SET_POSITION}
    mode = motion("oriental-blv-r").mode(0)
    assert mode is not None
    assert {mode.action(kind) for kind in (0, 31, 32)} == {Action.STOP}
    positions = library.shipped("oriental-blv-r").registers.position_like
    assert {0x038C, 0x1802, 0x1842} <= {field.address for each in positions for field in each.fields()}


def test_delta_paths_and_their_numbers() -> None:
    # PR n at 0x0602 + 4 n, its definition at 0x0600 + 4 n; P5-07 = n runs it.
    plan = motion("delta-asda")
    paths = library.shipped("delta-asda").registers.command[0].fields()
    assert [paths[n - 1].address for n in (1, 2, 3, 49)] == [0x0606, 0x060A, 0x060E, 0x06C6]
    assert plan.triggers[0].operation(2, None) == Operation(Action.START, 1)
    assert plan.triggers[0].operation(50, None).action is Action.UNKNOWN
    assert deeds("delta-asda", 0x050E, 0) == {Action.HOME}
    assert deeds("delta-asda", 0x050E, 1000) == {Action.STOP}
    assert deeds("delta-asda", 0x0508, 0x0108) == {Action.SET_POSITION}  # P5-04: the lowest digit
    assert deeds("delta-asda", 0x0508, 0x0083) == set()
    assert deeds("delta-asda", 0x028E, 1) == {Action.SET_POSITION}
    assert library.shipped("delta-asda").registers.gap_ms == 10.0
    assert [limit.address for limit in fields("delta-asda", "limits")] == [0x0510, 0x0512]


@pytest.mark.parametrize(
    ("definition", "expected"),
    [
        (0x0002, Action.ABSOLUTE),
        (0x1112, Action.ABSOLUTE),  # INS, and the ramps of path 2
        (0x0032, Action.ABSOLUTE),  # INS and OVLP
        (0x0052, Action.RELATIVE_TO_ACTUAL),
        (0x0092, Action.RELATIVE),
        (0x00D2, Action.UNKNOWN),  # from a captured place
        (0x0013, Action.STORED),  # goes on to the next path
        (0x0071, Action.OTHER_MOTION),  # at a speed
        (0x0007, Action.UNKNOWN),
    ],
)
def test_delta_tells_by_the_type_and_what_a_number_counts_from(definition: int, expected: Action) -> None:
    mode = motion("delta-asda").mode(0)
    assert mode is not None
    assert mode.action(definition) is expected


def test_kinco_control_words() -> None:
    assert deeds("kinco-fd", 0x3100, 0x003F, before=0x002F) == {Action.START}
    assert deeds("kinco-fd", 0x3100, 0x005F, before=0x004F) == {Action.RELATIVE_TO_COMMANDED}
    assert deeds("kinco-fd", 0x3100, 0x001F, before=0x000F) == {Action.START}  # homes in mode 6
    assert deeds("kinco-fd", 0x3100, 0x103F, before=0x002F) == {Action.FOLLOW}
    assert deeds("kinco-fd", 0x3100, 0x002F, before=0x000F) == set()
    assert deeds("kinco-fd", 0x3100, 0x107F, before=0x002F) == {Action.UNKNOWN}
    assert deeds("kinco-fd", 0x3100, 0x000B, before=0x003F) == {Action.STOP}
    assert deeds("kinco-fd", 0x3100, 0x0006, before=0x003F) == {Action.STOP}
    assert deeds("kinco-fd", 0x3100, 0x0086, before=0x000F) == {Action.STOP}
    assert Action.STOP in deeds("kinco-fd", 0x3100, 0x013F, before=0x003F)  # halt
    assert Action.STOP in deeds("kinco-fd", 0x3100, 0x013F, before=0x000F)
    mode = motion("kinco-fd").mode(0)
    assert mode is not None
    assert mode.action(6) is Action.HOME
    assert {mode.action(other) for other in (3, 4, 7, 0xFFFC, 0xFFFD)} == {Action.OTHER_MOTION}
    assert mode.action(5) is Action.UNKNOWN


def test_iai_starts_on_the_low_word_and_forgets_its_flags() -> None:
    plan = motion("iai-robo-cylinder")
    assert 0x9901 in plan.starts_on
    assert 0x9900 not in plan.starts_on
    assert {0x9905, 0x9906, 0x9907} <= plan.starts_on
    mode = plan.mode(0)
    assert mode is not None
    assert mode.resets_to == 0
    assert mode.action(0x0006) is Action.ABSOLUTE  # a push
    assert mode.action(0x0008) is Action.RELATIVE
    assert mode.action(0x000E) is Action.RELATIVE_TO_ACTUAL


def test_iai_stops_pauses_and_runs_stored_positions_by_coils() -> None:
    coils = coil_triggers("iai-robo-cylinder")
    assert coils[0x042C].operation(1, 0).action is Action.STOP
    assert coils[0x040A].operation(1, 0).action is Action.STOP
    assert coils[0x040A].operation(0, 1).action is Action.OTHER_MOTION  # the rest of its way
    assert {coils[jog].operation(1, 0).action for jog in (0x0416, 0x0417)} == {Action.OTHER_MOTION}
    assert {coils[start].operation(1, 0).action for start in range(0x0418, 0x0420)} == {Action.STORED}
    assert deeds("iai-robo-cylinder", 0x0D00, 0x1020, before=0x1000) == {Action.STOP}
    assert deeds("iai-robo-cylinder", 0x0D01, 0x0200) == {Action.OTHER_MOTION}
    assert deeds("iai-robo-cylinder", 0x0D01, 0x0020) == {Action.STORED}
    # Entry 12 of the position table is at 0x10C0, its zones at +6 and +8; entry 300 at 0x22C0.
    positions = library.shipped("iai-robo-cylinder").registers.position_like
    guarded = {field.address for position in positions for field in position.fields()}
    assert {0x10C0, 0x10C6, 0x10C8, 0x22C0, 0x22C6, 0x22C8} <= guarded


def test_smc_has_coils_and_inputs() -> None:
    coils = coil_triggers("smc-lec")
    assert coils[0x1C].operation(1, 0).action is Action.HOME
    assert coils[0x19].operation(0, 1).action is Action.STOP
    assert coils[0x18].operation(1, 0).action is Action.STOP  # HOLD
    assert coils[0x18].operation(0, 1).action is Action.OTHER_MOTION
    assert coils[0x1B].operation(1, 0).action is Action.STOP  # RESET
    assert {coils[jog].operation(1, 0).action for jog in (0x1D, 0x1E)} == {Action.OTHER_MOTION}
    assert library.shipped("smc-lec").registers.bits.homed is not None
    named = {name: bit.field() for name, bit in library.shipped("smc-lec").registers.bits.named()}
    assert named["homed"] == BitField(0x4A, 0, BitTable.INPUT)
    assert [limit.address for limit in fields("smc-lec", "limits")] == [0x910C, 0x910E]
    steps = library.shipped("smc-lec").registers.position_like[0].fields()
    assert [steps[n].address for n in (0, 3, 63)] == [0x0402, 0x0432, 0x07F2]


@pytest.mark.parametrize(("name", "target"), [("applied-motion-16", 30), ("applied-motion-32", 350)])
def test_applied_motion_tells_by_its_opcode(name: str, target: int) -> None:
    assert fields(name, "command")[0].address == target
    assert deeds(name, 124, 0x67) == {Action.ABSOLUTE}
    assert deeds(name, 124, 0x66) == {Action.RELATIVE_TO_COMMANDED}
    assert deeds(name, 124, 0x98) == {Action.SET_POSITION}
    assert deeds(name, 124, 0x12) == {Action.UNKNOWN}


def test_mks_frames_are_commands_and_speed_zero_is_a_stop() -> None:
    # 01 10 00F5 0004 08 | acc 0002 | speed 012C | position 0002 8000
    absolute, relative, pulses = fields("makerbase-servo42d", "command")
    assert (pulses.block, pulses.address, pulses.scale) == (0x00FE, 0x0100, 16_384 / 3_200)
    assert (absolute.block, absolute.address) == (0x00F5, 0x00F7)
    assert (relative.block, relative.address) == (0x00F4, 0x00F6)
    plan = motion("makerbase-servo42d")
    first, second, third = plan.mode(0), plan.mode(1), plan.mode(2)
    assert first is not None
    assert second is not None
    assert third is not None
    assert (third.address, third.action(0), third.action(300)) == (0x00FF, Action.STOP, Action.ABSOLUTE)
    assert (first.address, first.action(0), first.action(300)) == (0x00F6, Action.STOP, Action.ABSOLUTE)
    assert second.action(300) is Action.RELATIVE_TO_COMMANDED
    assert library.shipped("makerbase-servo42d").registers.read is Form.FC04


def test_cia_402_drives_stop_when_an_enabling_bit_goes() -> None:
    for name in ("mitsubishi-mr-je-c", "igus-dryve-d1"):
        assert deeds(name, 0x6040, 0x001F, before=0x000F) == {Action.START}
        assert deeds(name, 0x6040, 0x005F, before=0x000F) == {Action.RELATIVE_TO_COMMANDED}
        assert deeds(name, 0x6040, 0x000F, before=0x001F) == set()
        assert Action.STOP in deeds(name, 0x6040, 0x010F, before=0x000F)
        assert library.shipped(name).registers.addressing is Addressing.OBJECTS


def test_a_speed_moves_cia_402_drives_without_a_rise_of_bit_4() -> None:
    for name in ("mitsubishi-mr-je-c", "igus-dryve-d1"):
        assert deeds(name, 0x60FF, 500) == {Action.OTHER_MOTION}
    assert deeds("mitsubishi-mr-je-c", 0x6040, 0x800F, before=0x000F) == {Action.OTHER_MOTION}


def test_an_akd2g_runs_a_task_when_its_action_leaves_zero() -> None:
    assert deeds("kollmorgen-akd2g", 23, 1, before=0) == {Action.START}
    assert deeds("kollmorgen-akd2g", 23, 1, before=1) == set()
    mode = motion("kollmorgen-akd2g").mode(0)
    assert mode is not None
    assert [mode.action(control) for control in (0x0000, 0x0001, 0x0003, 0x0007, 0x0005, 0x0010)] == [
        Action.ABSOLUTE,
        Action.RELATIVE_TO_COMMANDED,
        Action.RELATIVE,
        Action.RELATIVE_TO_ACTUAL,
        Action.UNKNOWN,
        Action.UNKNOWN,
    ]


def test_opcodes_that_feed_to_a_sensor_move_without_a_place() -> None:
    for name in ("applied-motion-16", "applied-motion-32"):
        assert {next(iter(deeds(name, 124, code))) for code in (0x68, 0x6D, 0xCC)} == {Action.OTHER_MOTION}
        assert deeds(name, 124, 0xDB) == {Action.HOME}
        assert deeds(name, 124, 0x6F) == set()  # waits
    assert deeds("applied-motion-32", 343, 0) == {Action.STOP}
    assert deeds("applied-motion-32", 343, 5000) == {Action.OTHER_MOTION}


def test_a_jmc_rc_starts_stops_and_runs_by_its_control_word() -> None:
    assert deeds("jmc-rc", 0x6040, 0x001F, before=0x000F) == {Action.START}
    assert deeds("jmc-rc", 0x6040, 0x003F, before=0x002F) == {Action.START}
    assert deeds("jmc-rc", 0x6040, 0x005F, before=0x000F) == {Action.RELATIVE_TO_COMMANDED}
    for stop in (0x010F, 0x0002, 0x0007, 0x0080):
        assert deeds("jmc-rc", 0x6040, stop, before=0x000F) == {Action.STOP}
    assert deeds("jmc-rc", 0x6060, 3) == {Action.OTHER_MOTION}
    assert deeds("jmc-rc", 0x6060, 1) == set()


JMC_OBJECTS = {
    **dict.fromkeys((0x6039, 0x6040, 0x605A, 0x6060, 0x6083, 0x6084, 0x6085, 0x6098, 0x609A), 1),
    **dict.fromkeys((0x607A, 0x607C, 0x6081, 0x6099, 0x609B), 2),
}
"""What is written to, and its registers."""


@pytest.mark.parametrize("index", JMC_OBJECTS, ids=hex)
def test_a_jmc_rc_takes_one_object_in_a_frame(index: int) -> None:
    """A longer frame goes on in the order of a table, and may hold the target where no address tells."""
    words = JMC_OBJECTS[index]
    for length in range(words, 45):
        line = Bench(axis_plan("jmc-rc", 1, table_of(0.05, 0.05)))
        # An object that is 0x000F takes nothing away from the control word, wherever that stands.
        reply = line.ask(_fc16(index, *[0x000F] * length))
        is_alone = length == words and index != 0x607C
        assert (reply[0] == 16) is is_alone, f"{length} words"
        assert "compensation-ended" not in line.kinds()


@pytest.mark.parametrize("control", [0x0000, 0x0002, 0x0007, 0x0080, 0x010F])
def test_after_a_stop_over_the_table_of_a_jmc_rc_nothing_is_corrected(control: int) -> None:
    """A stop is never refused: the target that may stand behind it is nobody's."""
    for index, ahead in ((0x6040, 0), (0x6039, 7)):
        line = Bench(axis_plan("jmc-rc", 1, table_of(0.05, 0.05)))
        for pdu in (_fc16(0x6060, 1), _fc16(0x607A, 0, 5000), _fc16(0x6040, 0x001F)):
            assert line.ask(pdu)[0] == 16
        table = _fc16(index, *[0] * ahead, control, 1, 0, 10, 100, 100, 100, 0, 1000)
        assert line.ask(table)[0] == 16
        assert line.seen[-1] == table
        assert "compensation-ended" in line.kinds()
        assert line.ask(_fc16(0x6040, 0x000F))[0] == 16
        assert line.ask(_fc16(0x6040, 0x001F)) == bytes((0x90, 4))  # what it knows is not what would run
    line = Bench(axis_plan("jmc-rc", 1, table_of(0.05, 0.05)))
    assert line.ask(_fc16(0x6040, control))[0] == 16  # a stop alone
    assert "compensation-ended" not in line.kinds()


def _fc16(address: int, *words: int) -> bytes:
    data = b"".join(word.to_bytes(2) for word in words)
    return bytes((16,)) + address.to_bytes(2) + bytes((0, len(words), len(data))) + data


def test_a_word_of_eight_bits_means_the_same_with_and_without_its_sign() -> None:
    mode = motion("mitsubishi-mr-je-c").mode(0)
    assert mode is not None
    assert mode.action(0x10000 - 101) is mode.action(0x0100 - 101) is Action.STORED


def test_tl_r_is_written_word_by_word() -> None:
    assert library.shipped("tl-r").registers.write is Form.FC06
    assert deeds("tl-r", 78, 0x0003) == {Action.ABSOLUTE}
    assert deeds("tl-r", 78, 0x0001) == {Action.RELATIVE_TO_COMMANDED}
    assert deeds("tl-r", 78, 0x0003, before=0x0003) == {Action.ABSOLUTE}


def test_festo_images_hold_start_and_stop() -> None:
    assert deeds("festo-cmmt-111", 0, 0x047F, before=0x043F) == {Action.START}
    assert deeds("festo-cmmt-111", 0, 0x047F, before=0x047F) == set()
    assert deeds("festo-cmmt-111", 0, 0x043E, before=0x043F) == {Action.STOP}
    assert deeds("festo-cmmt-111", 0, 0x0C3F, before=0x043F) == {Action.HOME}
    assert deeds("festo-cmmt-111", 1, 0x9100, before=0x9100) == {Action.FOLLOW}
    assert deeds("festo-cmmt-111", 1, 0x9000) == {Action.UNKNOWN}
    assert deeds("festo-cmmt-111", 2, 0x0002) == {Action.SET_POSITION}
    assert deeds("festo-cmmt-111", 0, 0x243F, before=0x043F) == {Action.STORED}  # the next record
    assert deeds("festo-cmmt-111", 0, 0x041F, before=0x043F) == {Action.STOP}  # a pause
    assert deeds("festo-cmmt-111", 0, 0x043F, before=0x041F) == {Action.OTHER_MOTION}  # goes on
    assert deeds("festo-cmmt-111", 0, 0x043F, before=0x042F) == set()
    mode = motion("festo-cmmt-111").mode(0)
    assert mode is not None
    assert {mode.action(record) for record in (0x0000, 0x0003, 0x0100)} == {Action.STORED}
    assert {mode.action(speed) for speed in (0xC300, 0xC500, 0x4000)} == {Action.OTHER_MOTION}
    assert (mode.action(0x8100), mode.action(0x8000)) == (Action.ABSOLUTE, Action.RELATIVE_TO_COMMANDED)
    assert deeds("festo-cmmo-fhpp", 0, 0x4303, before=0x4301) == {Action.START}
    assert deeds("festo-cmmo-fhpp", 0, 0x0303, before=0x0301) == {Action.STORED}  # record selection
    assert deeds("festo-cmmo-fhpp", 0, 0x4300, before=0x4301) == {Action.STOP}  # halt
    assert deeds("festo-cmmo-fhpp", 0, 0x4101, before=0x4301) == {Action.STOP}
    assert deeds("festo-cmmo-fhpp", 0, 0x4201, before=0x4301) == {Action.STOP}
    assert deeds("festo-cmmo-fhpp", 0, 0x4301, before=0x4300) == {Action.OTHER_MOTION}
    assert deeds("festo-cmmo-fhpp", 0, 0x4309, before=0x4301) == {Action.OTHER_MOTION}  # jog
    (written,), (read,) = fields("festo-cmmo-fhpp", "command"), fields("festo-cmmo-fhpp", "actual")
    assert written.address == read.address
    assert (written.access, read.access) == (FieldAccess.WRITE, FieldAccess.READ)
