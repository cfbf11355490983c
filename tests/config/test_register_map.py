"""The register map of a drive by itself."""

from typing import Any

import pytest
from pydantic import ValidationError

from gateway.drives.motion import Action, Addressing, Form, Operation
from gateway.drives.registers import PositionSpec, RegisterMap, clashes
from gateway.modbus.registers import BitField, BitTable, FieldAccess, RegisterType, WordOrder


def register_map(**keys: Any) -> RegisterMap:
    return RegisterMap.model_validate({"command": [{"address": 10, "type": "int32"}], **keys})


def test_what_is_left_out_has_the_documented_values() -> None:
    registers = register_map()
    assert registers.command[0].words is WordOrder.HIGH_FIRST
    assert registers.command[0].scale == 1.0
    assert registers.safe_read
    assert registers.checks_crc
    assert registers.write is Form.FC16
    assert (registers.max_registers, registers.gap_ms, registers.staged) == (123, 0.0, False)
    assert registers.response_ms is None


@pytest.mark.parametrize(
    ("kind", "last"),
    [("int16", 65535), ("int32", 65534), ("float32", 65534), ("int48", 65533), ("int64", 65532)],
)
def test_a_position_ends_with_the_last_register_at_most(kind: str, last: int) -> None:
    assert PositionSpec.model_validate({"address": last, "type": kind}).type is RegisterType(kind)
    if last < 65535:
        with pytest.raises(ValidationError, match="would end at 0x10000: the last one is 0xffff"):
            PositionSpec.model_validate({"address": last + 1, "type": kind})


@pytest.mark.parametrize("address", [8, 9, 10, 11, 12])
def test_positions_clash_where_they_share_a_register(address: int) -> None:
    # The command fills 10 and 11; an int32 at 9, 10 or 11 touches one of them.
    registers = register_map(actual=[{"address": address, "type": "int32"}])
    pairs = [(str(one.key), str(other.key)) for one, other in clashes(registers)]
    assert pairs == ([("('command', 0)", "('actual', 0)")] if 9 <= address <= 11 else [])


def test_bits_may_share_a_register_with_each_other_but_not_with_a_position() -> None:
    bits = {"homed": {"address": 12, "bit": 0}, "done": {"address": 12, "bit": 1}}
    assert clashes(register_map(bits=bits)) == []
    bits["alarm"] = {"address": 11, "bit": 2}
    assert [other.key for _, other in clashes(register_map(bits=bits))] == [("bits", "alarm")]


def test_the_whole_schema_can_be_said() -> None:
    position = {"address": 100, "type": "uint32", "words": "low-first", "scale": 0.5}
    registers = register_map(
        limits=[position],
        aliases=[position],
        position_like=[position],
        remap=[position],
        mode={"source": "in-frame", "address": 9, "mask": 1, "absolute": [1], "relative": [0]},
        trigger=[
            {
                "address": 7,
                "absolute": [1],
                "relative": [2],
                "start": [3],
                "stop": [4],
                "home": [5],
                "set_position": [6],
            }
        ],
        staged=True,
        starts_on=[11],
        exception="nothing-written",
    )
    assert registers.trigger[0].set_position == (6,)
    assert registers.mode is not None
    assert registers.mode.mask == 1


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        ({"source": "fixed", "address": 3}, "no other key"),
        ({"source": "sticky"}, "needs the address"),
        ({"source": "guess"}, "fixed"),
        ({"source": "in-frame", "absolute": [1]}, "needs the address"),
        ({"source": "sticky", "address": 3}, "no value of the register has a meaning"),
        ({"source": "sticky", "address": 3, "mask": 1, "absolute": [2]}, "absolute lists 0x2, .* mask = 0x1"),
        (
            {"source": "sticky", "address": 3, "absolute": [1], "relative": [1]},
            "0x1 is listed as absolute and as relative",
        ),
        ({"source": "sticky", "address": 3, "absolute": [0x10000]}, "less than or equal to 65535"),
        ({"source": "sticky", "address": 3, "absolute": [1], "otherwise": "perhaps"}, "'unknown'"),
        ({"source": "sticky", "address": 3, "absolute": [1], "set_position": [2]}, "Extra inputs"),
    ],
)
def test_a_mode_says_enough_and_not_too_much(mode: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(mode=mode)


def test_a_mode_moves_along_with_its_path() -> None:
    # Path P at 100 + 8 P, its mode one register before it.
    registers = register_map(
        command=[{"address": 100, "type": "int32", "paths": {"count": 3, "stride": 8}}],
        mode={"source": "in-frame", "address": 99, "absolute": [1], "relative": [0x41]},
        trigger=[{"address": 7, "start": [0x10], "stop": [0x40], "paths": True}],
    )
    assert [field.address for field in registers.command[0].fields()] == [100, 108, 116]
    motion = registers.motion()
    assert [mode.address for mode in motion.modes if mode] == [99, 107, 115]
    assert motion.triggers[0].deeds == {
        0x10: Operation(Action.START, 0),
        0x11: Operation(Action.START, 1),
        0x12: Operation(Action.START, 2),
        0x40: Operation(Action.STOP),
    }


def test_a_position_may_be_meant_otherwise_than_the_map_says() -> None:
    registers = register_map(
        command=[
            {"address": 10, "type": "int32"},
            {"address": 20, "type": "int32", "mode": {"source": "fixed"}},
        ],
        mode={"source": "sticky", "address": 9, "absolute": [1]},
    )
    first, second = registers.motion().modes
    assert first is not None
    assert first.action(1) is Action.ABSOLUTE
    assert first.action(2) is Action.UNKNOWN
    assert second is None


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"paths": {"count": 2, "stride": 1}}, "stride = 1, but int32 takes 2 registers"),
        ({"address": 65500, "paths": {"count": 6, "stride": 8}}, "the last path would end at 0x10005"),
        ({"paths": {"count": 0, "stride": 8}}, "greater than or equal to 1"),
        ({"block": 11}, "a frame that begins at 0x000b does not hold 0x000a"),
        ({"access": "never"}, "'both', 'read' or 'write'"),
    ],
)
def test_a_command_that_cannot_be(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(command=[{"address": 10, "type": "int32", **keys}])


@pytest.mark.parametrize(
    ("trigger", "said"),
    [
        ({"start": [1]}, "needs exactly one of address and coil"),
        ({"address": 7, "coil": 7, "start": [1]}, "needs exactly one of address and coil"),
        ({"coil": 7, "start": [2]}, "a coil is 0 or 1"),
        ({"address": 7}, "no value has a meaning"),
        ({"address": 7, "start": [1], "stop": [1]}, "0x1 is listed as .* and as"),
        ({"address": 7, "mask": 0x0F, "start": [0x10]}, "start lists 0x10, .* mask = 0xf"),
        ({"address": 7, "mask": 0x0F, "start": [1], "rising": 0x10}, "rising = 0x10 has bits outside"),
        ({"address": 7, "start": [1], "paths": True}, "no command has paths"),
    ],
)
def test_a_trigger_that_cannot_be(trigger: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(trigger=[trigger])


@pytest.mark.parametrize(
    ("trigger", "said"),
    [
        ({"start": [0x10], "home": [0x1F]}, "path 15 of 0x10 is 0x1f, listed as home"),
        ({"start": [8], "mask": 0x0F}, "path 8 of 0x8 is 0x10, outside mask = 0xf"),
    ],
)
def test_values_of_paths_mean_nothing_else(trigger: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(
            command=[{"address": 10, "type": "int32", "paths": {"count": 16, "stride": 8}}],
            trigger=[{"address": 7, "paths": True, **trigger}],
        )


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"command": []}, "at least 1 item"),
        ({"staged": True}, "staged = true, but no trigger is named"),
        ({"mode": {"source": "trigger"}}, "no trigger is named"),
        ({"objects": [{"address": 1, "words": 2}]}, 'only with addressing = "objects"'),
        ({"read": "fc16"}, 'read: allowed: "fc03", "fc04" or "mei"'),
        ({"write": "fc03"}, 'write: allowed: "fc16", "fc06" or "mei"'),
        ({"read": "fc99"}, "'fc03'"),
        (
            {
                "command": [
                    {"address": 10, "type": "int32", "paths": {"count": 2, "stride": 2}},
                    {"address": 20, "type": "int32"},
                ]
            },
            "paths need to be the only entry",
        ),
    ],
)
def test_a_map_that_does_not_fit_together(keys: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(**keys)


@pytest.mark.parametrize("form", ["fc03", "fc04", "mei"])
def test_ways_to_read(form: str) -> None:
    assert register_map(read=form).read is Form(form)


@pytest.mark.parametrize("form", ["fc06", "fc16", "mei"])
def test_ways_to_write(form: str) -> None:
    assert register_map(write=form).write is Form(form)


def test_state_can_stand_in_coils_and_inputs_and_be_said_the_other_way_round() -> None:
    bits = {
        "homed": {"address": 0x4A, "table": "input"},
        "moving": {"address": 0x48, "table": "coil"},
        "done": {"address": 4, "bit": 4, "inverted": True},
    }
    named = {name: bit.field() for name, bit in register_map(bits=bits).bits.named()}
    assert named == {
        "homed": BitField(0x4A, 0, BitTable.INPUT),
        "moving": BitField(0x48, 0, BitTable.COIL),
        "done": BitField(4, 4, BitTable.REGISTER, is_inverted=True),
    }


def test_a_coil_shares_no_register_with_a_position() -> None:
    assert clashes(register_map(bits={"homed": {"address": 10, "table": "coil"}})) == []


@pytest.mark.parametrize(
    ("bit", "said"),
    [
        ({"address": 4}, "a register has 16 bits: say which"),
        ({"address": 4, "table": "input", "bit": 0}, "has no bits: leave bit out"),
        ({"address": 4, "bit": 16}, "less than or equal to 15"),
    ],
)
def test_a_bit_that_cannot_be(bit: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(bits={"homed": bit})


def test_objects_at_neighbouring_addresses_share_nothing() -> None:
    actual = [{"address": 11, "type": "int32"}]
    assert clashes(register_map(actual=actual))
    registers = register_map(
        actual=actual, addressing="objects", objects=[{"address": 0x6081, "words": 2}], read="mei"
    )
    assert registers.addressing is Addressing.OBJECTS
    assert clashes(registers) == []


def test_what_is_read_and_what_is_written_at_one_address_are_two_positions() -> None:
    written = {"address": 10, "type": "int32", "access": "write"}
    read = {"address": 10, "type": "int32", "access": "read"}
    registers = register_map(command=[written], actual=[read])
    assert clashes(registers) == []
    assert registers.command[0].field().access is FieldAccess.WRITE
    assert clashes(register_map(command=[written], actual=[written]))


def test_frames_that_begin_elsewhere_are_other_frames() -> None:
    def position(address: int, block: int) -> dict[str, Any]:
        return {"address": address, "type": "int32", "block": block}

    assert clashes(register_map(command=[position(0xF7, 0xF5), position(0xF6, 0xF4)])) == []
    assert clashes(register_map(command=[position(0xF7, 0xF5), position(0xF6, 0xF5)]))


def test_a_trigger_and_a_mode_stand_beside_the_positions() -> None:
    for rule in (
        {"trigger": [{"address": 11, "start": [1]}]},
        {"mode": {"source": "sticky", "address": 11, "absolute": [1]}},
    ):
        assert [str(other) for _, other in clashes(register_map(**rule))] == ["0x000b"]
    assert clashes(register_map(trigger=[{"coil": 11, "start": [1]}])) == []
