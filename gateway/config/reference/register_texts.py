"""Texts of ``[axis.NAME.registers]`` and of what is in it."""

from typing import Final

from gateway.config.reference.text import Said, Texts

REGISTERS: Final[Texts] = {
    "actual": Said(
        meaning=(
            "measured positions. Where writing one tells the drive that it stands somewhere else, it "
            "has `set_position = true`"
        ),
    ),
    "limits": Said(
        meaning=(
            "positions that the drive compares its own with: software limits, areas. They are "
            "corrected like a position there, half way between the two directions. A limit of 0 passes "
            "as it is, because for many drives it means that there is none; one of which a part is "
            "written alone is refused"
        ),
    ),
    "aliases": Said(
        meaning=(
            "further addresses at which positions are read. They are turned back like `actual`; "
            "writing one while the axis is corrected is refused with exception 2"
        ),
    ),
    "position_like": Said(
        meaning=(
            "registers that hold positions which are not mapped (mirrors, stored targets, home "
            "offsets): written while the axis is corrected they are refused with exception 2 (see "
            "`unmapped`); read they pass as they are"
        ),
    ),
    "remap": Said(
        meaning=(
            "registers that move other registers about, or change the order of their words: writing "
            "one ends the compensation of its unit until the gateway is started again"
        ),
    ),
    "mode": Said(
        more="See below",
        default="absolute",
    ),
    "trigger": Said(
        more="Coils too, see below",
    ),
    "done_means": Said(
        meaning=(
            "`move-ended`: `bits.done` falls when a move begins and comes back when it has ended. "
            "`in-position`: it only says that the axis is near where it is told to be at the moment, "
            "which it may be on the way too; then an actual position has to show that it has arrived"
        ),
    ),
    "next_target": Said(
        meaning=(
            "`at-once`: a target that comes while the axis moves is gone to from where the axis is. "
            "`queued`: the axis goes to the one before first, as CiA 402 drives with set-points in a row do: "
            "its direction follows from the order of the targets then, and no reading tells it"
        ),
    ),
    "done_drop_ms": Said(
        meaning=(
            "so long after a target was acknowledged `bits.done` may still be that of the move "
            "before. Sooner it counts as arrival, or as rest before a distance, only after it was "
            "seen to fall"
        ),
    ),
    "refused_read": Said(
        meaning=(
            "function byte with which the drive refuses every read, as Kinco with `0x81`; `0`: that of the "
            "request with bit 7 set, as the standard has it. On RTU any other is no answer to what was asked"
        ),
    ),
    "staged": Said(
        meaning=(
            "`true`: a written position waits for a trigger, and is corrected for the moment of the "
            "trigger, see below. Needs a `trigger`"
        ),
    ),
    "starts_on": Said(
        meaning=(
            "words that start the motion as soon as they are written, whatever their value: the word "
            "of a position that is looked at, or a speed beside it. The other words wait for it"
        ),
    ),
    "bits": Said(
        more="`homed`, `done`, `moving`, `alarm`: what the drive tells about its state, see below",
    ),
    "addressing": Said(
        meaning=(
            '`"objects"`: an address is the index of an object with a width of its own. Two registers '
            "at 0x6064 do not touch 0x6065, and a frame holds whole objects one after the other"
        ),
    ),
    "objects": Said(
        meaning=(
            'with `addressing = "objects"`: how many registers (1 to 4) an object takes that is not a '
            "position, as in `{ address = 0x6081, words = 2 }`. Needed only where a frame holds more "
            "than one object; 1 where nothing is said"
        ),
        kind="list of `{ address, words }`",
    ),
    "read": Said(
        kind='`"fc03"`, `"fc04"`, `"mei"`',
    ),
    "write": Said(
        meaning=(
            "how the gateway writes a position by itself; `fc06` writes a longer one word by word, and "
            "then needs `staged = true`: otherwise the first word would already move the axis"
        ),
        kind='`"fc16"`, `"fc06"`, `"mei"`',
    ),
    "response_ms": Said(
        meaning=(
            "what this drive takes before it answers. Only `pitch-gateway budget` and `check` reckon with it"
        ),
        default="not known",
    ),
}

POSITION: Final[Texts] = {
    "words": Said(
        more="The wrong order turns 10000 into 655360000",
    ),
    "access": Said(
        meaning=(
            "where a drive shows something else at an address than was written there, two positions "
            'share the address: one is `"read"`, the other `"write"`'
        ),
    ),
    "block": Said(
        meaning=(
            "the position stands only in frames that begin at this address. For drives whose addresses "
            "are commands: a frame of four registers at 0x00F5 is one command, and one at 0x00F4 is "
            "another, although the registers overlap"
        ),
    ),
    "set_position": Said(
        more="Only in `actual`",
    ),
    "mode": Said(
        more="Only in `command`",
        default="as `mode` of the map",
    ),
    "paths": Said(
        meaning=(
            "only in `command` (as its only entry), `position_like` and `remap`: `count` (1 to 256) "
            "positions of the same kind, each `stride` registers after the one before; in `command` "
            "the address of `mode` moves along with them"
        ),
        kind="`{ count, stride }`",
    ),
}

BIT: Final[Texts] = {
    "bit": Said(
        kind="0 (lowest) to 15",
        default="required with a register",
    ),
    "table": Said(
        meaning="a coil (function code 1) or a discrete input (function code 2) has no `bit`",
    ),
}

MODE: Final[Texts] = {
    "source": Said(
        meaning=(
            "`fixed`: every position is absolute. `sticky`: a register says so, as it stands at the "
            "trigger. `in-frame`: a register that counts only in the frame that holds the position. "
            "`trigger`: the trigger says so"
        ),
    ),
    "address": Said(
        meaning=(
            "the register that holds the mode: needed with `sticky` and `in-frame`, not allowed with "
            "the others"
        ),
    ),
    "mask": Said(
        more="The values below have no others",
    ),
    "relative_to_commanded": Said(
        meaning=(
            "a distance from where the drive's own profile stands at that moment. Right also where the "
            "manual does not say what a distance counts from: the gateway then wants a standing axis, "
            "at which all three are the same"
        ),
    ),
    "stop": Said(
        meaning="it stops the axis, and the position in the frame means nothing",
    ),
    "other_motion": Said(
        meaning="jog, velocity, torque: the position in the frame means nothing",
    ),
    "otherwise": Said(
        more="`unknown`: passed on unchanged and counted",
        kind='one of the names above, `"ignore"`, `"unknown"`',
    ),
}

TRIGGER: Final[Texts] = {
    "address": Said(
        more="Exactly one of `address` and `coil`",
    ),
    "coil": Said(
        meaning="the coil; its values are 0 and 1",
    ),
    "mask": Said(
        more="The values below have no others",
    ),
    "rising": Said(
        meaning=(
            "bits of which one must rise from 0 to 1 for the drive to act; 0: every write acts. A stop "
            "acts always"
        ),
    ),
    "paths": Said(
        meaning=(
            "`command` has `paths`: value + P runs the position of path P, for the values under "
            "`absolute`, the three `relative` and `start`"
        ),
    ),
    "follow_next": Said(
        meaning=(
            "as `follow`, for values that run nothing themselves: only what is written from then on. "
            "While the register holds a value that is not listed, positions pass unchanged and are "
            "counted as unknown"
        ),
    ),
}
