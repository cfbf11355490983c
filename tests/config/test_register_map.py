"""The register map of a drive by itself."""

from typing import Any

import pytest
from pydantic import ValidationError

from gateway.drives.registers import PositionSpec, RegisterMap, WriteFunction, clashes
from gateway.modbus.registers import RegisterType, WordOrder


def register_map(**keys: Any) -> RegisterMap:
    return RegisterMap.model_validate({"command": [{"address": 10, "type": "int32"}], **keys})


def test_what_is_left_out_has_the_documented_values() -> None:
    registers = register_map()
    assert registers.command[0].words is WordOrder.HIGH_FIRST
    assert registers.command[0].scale == 1.0
    assert registers.safe_read
    assert registers.write is WriteFunction.FC16
    assert (registers.max_registers, registers.gap_ms, registers.staged) == (123, 0.0, False)


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
    ],
)
def test_a_mode_says_enough_and_not_too_much(mode: dict[str, Any], said: str) -> None:
    with pytest.raises(ValidationError, match=said):
        register_map(mode=mode)
