"""What a Mint program says about the reversal of an axis, beside its table.

BACKLASHMODE 1 adds BACKLASH in one direction, over BACKLASHINTERVAL servo cycles. The sign tells which: with
a positive size the motor stands at the negative end of the lost motion after homing, so that moving forward
needs the whole size and moving back nothing (MN1270, BACKLASHMODE); with a negative one it is the other way
round. It has to be off with two tables, because these hold the lost motion.
"""

from dataclasses import dataclass

from gateway.tabfile.findings import Lint, Severity
from gateway.tabfile.mint_program import BACKLASH, BACKLASH_INTERVAL, BACKLASH_MODE, Program
from gateway.tabfile.text import SourceText


@dataclass(frozen=True, slots=True)
class Reversal:
    """``backlash`` is signed, in units of the file, 0 for none; ``cycles`` is None where nothing is said."""

    backlash: float
    cycles: int | None
    decisions: tuple[str, ...]
    remarks: tuple[Lint, ...]


def reversal_of(source: SourceText, program: Program, axis: int, *, has_two_tables: bool) -> Reversal:
    """Return what is said about the reversal of one axis.

    Raises:
        TabFileError: backlash that is not off beside two tables, or a number of cycles that is none.
    """
    cycles = _cycles(source, program, axis)
    setting = program.settings.get((BACKLASH, axis))
    width = 0.0 if setting is None else float(setting.value)
    if setting is None or width == 0:
        return Reversal(0.0, cycles, (), ())
    if _is_off(source, program, axis):
        return Reversal(0.0, cycles, (f"{BACKLASH} {width:g} does not count: {BACKLASH_MODE} is off",), ())
    if has_two_tables:
        raise source.error(
            f"{BACKLASH} {width:g} beside a forward and a reverse table, which hold the lost motion already",
            f"{BACKLASH_MODE}.{axis} = _blOFF, or one table",
            line=setting.line,
        )
    message = (
        f"{BACKLASH} {width:g} is not in the table: the control added {abs(width):g} while moving "
        f"{'forward' if width > 0 else 'back'}, which the gateway does only with 'backlash' of the axis set"
    )
    return Reversal(width, cycles, (), (Lint("R8", Severity.WARNING, message, setting.line),))


def _is_off(source: SourceText, program: Program, axis: int) -> bool:
    setting = program.settings.get((BACKLASH_MODE, axis))
    if setting is None or setting.value in {1.0, "_BLON"}:
        return False
    if setting.value in {0.0, "_BLOFF"}:
        return True
    raise source.error(f"{BACKLASH_MODE} {setting.value}", "0 or _blOFF, 1 or _blON", line=setting.line)


def _cycles(source: SourceText, program: Program, axis: int) -> int | None:
    setting = program.settings.get((BACKLASH_INTERVAL, axis))
    if setting is None:
        return None
    number = float(setting.value)
    if number < 0 or number != int(number):
        raise source.error(f"{BACKLASH_INTERVAL} {number:g}", "a whole number of cycles", line=setting.line)
    return int(number)
