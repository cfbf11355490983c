"""The configuration that the exchange needs, checked and frozen before it runs."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

from gateway.compensation.settings import AxisSettings, Setpoints, ThermalSettings
from gateway.compensation.table import CorrectionTable
from gateway.drives.motion import DIRECT, Addressing, Form, MotionPlan, NextTarget
from gateway.exchange.rights import UNLIMITED, Rights
from gateway.modbus.registers import BitField, PositionField
from gateway.times import NS_PER_MS

HOMED_BIT: Final = "homed"
HOMING_DONE_BIT: Final = "homing_done"
DONE_BIT: Final = "done"
MOVING_BIT: Final = "moving"
ALARM_BIT: Final = "alarm"

DEFAULT_UNSEEN_MS: Final = 500.0
DEFAULT_DONE_DROP_MS: Final = 1000.0
DEFAULT_WRITER_HOLD_S: Final = 5.0
"""Longer than a program pauses between two moves, and than a controller needs to reconnect; shorter than the
walk from one panel to the next."""

DEFAULT_BUDGET_US: Final = 1000.0
"""About ten times the median of the relay on a small Linux machine: an overrun is reported."""

PAGE_BITS: Final = 8
"""Addresses with the same high byte."""


class CompensationMode(Enum):
    """``shadow`` is the dry run: it computes and shows everything and writes the original."""

    ON = "on"
    SHADOW = "shadow"
    OFF = "off"


class Reference(Enum):
    """How the gateway knows that an axis is referenced."""

    ABSOLUTE = "absolute"
    """An absolute encoder: only a set position ends the reference, until a person declares it again."""
    DRIVE_BIT = "drive-bit"
    """The drive's homed bit. A person cannot declare the reference."""
    HOMING = "homing"
    """A homing command was seen, and after it the bit that ends it."""
    SET_POSITION = "set-position"
    """The controller sets the drive's position, at standstill."""


class Late(Enum):
    """What happens to a target or trigger that is older than its deadline."""

    FORWARD = "forward"
    REJECT = "reject"


def default_late(setpoints: Setpoints) -> Late:
    """Return the default: a move must not end short, an old setpoint must not be used."""
    return Late.REJECT if setpoints is Setpoints.STREAM else Late.FORWARD


class Role(Enum):
    """What a controller may do, highest first. ``monitor`` may only read."""

    MOTION = "motion"
    OPERATOR = "operator"
    MONITOR = "monitor"


@dataclass(frozen=True, slots=True)
class ControllerPlan:
    """One controller as the exchange sees it."""

    name: str
    role: Role = Role.MOTION
    timeout_ms: float = 1000.0
    """After this time the controller gives up on a request (W5, W7)."""
    serial: bool = False
    """RTU controllers get silence where TCP ones get exceptions 0x0A and 0x0B."""
    rights: Rights = UNLIMITED
    certified: str = ""
    """The role in the certificate of this connection, where certificates give roles."""


@dataclass(frozen=True, slots=True)
class CrossPlan:
    """Corrections of one axis over the position of another: straightness, sag, squareness.

    Positions and corrections are in the units of the corrected axis; ``scale`` converts the other axis's
    units to them.
    """

    axis: str
    """Name of the other axis, on the same gateway."""
    positions: tuple[float, ...]
    """Machine positions of the other axis."""
    corrections: tuple[float, ...]
    scale: float = 1.0
    modulo: float = 0.0
    """One turn of the other axis; 0: it is linear."""
    fresh_s: float = 60.0
    """How long the last position counts after the other axis's position became unknown, and then how long it
    fades."""
    table_name: str = ""
    table_digest: str = ""


@dataclass(frozen=True, slots=True)
class AxisPlan:
    """One axis: its address on the bus, its registers, its settings and its table."""

    name: str
    unit_id: int
    settings: AxisSettings
    table: CorrectionTable | None
    compensation: CompensationMode
    referenced: Reference
    command: tuple[PositionField, ...]
    actual: tuple[PositionField, ...] = ()
    commanded: tuple[PositionField, ...] = ()
    guarded: tuple[PositionField, ...] = ()
    """Registers that hold positions which are not mapped (M10)."""
    remapping: tuple[PositionField, ...] = ()
    """Registers that remap other registers (M10)."""
    passes_unmapped: bool = False
    """Writes to guarded registers pass all the same."""
    limits: tuple[PositionField, ...] = ()
    """Positions with which the drive compares its own."""
    aliases: tuple[PositionField, ...] = ()
    """Further addresses at which positions can be read."""
    settable: frozenset[int] = frozenset()
    """Actual positions, by number, that can be written to set the drive's position."""
    motion: MotionPlan = DIRECT
    addressing: Addressing = Addressing.REGISTERS
    object_words: Mapping[int, int] = field(default_factory=dict)
    """Registers of each object that is not a position, where addresses are objects."""
    reads_with: Form = Form.FC03
    writes_with: Form = Form.FC16
    budget_us: float = DEFAULT_BUDGET_US
    """The gateway's own time in one transaction: last byte in to first byte out, both directions added."""
    deadline_ms: float = 0.0
    """Age, since its last byte came in, at which a target or trigger is late; 0: never."""
    late: Late = Late.FORWARD
    lost_ms: float = 1000.0
    """After so long a silence the drive may have been switched off."""
    unseen_ms: float = DEFAULT_UNSEEN_MS
    """After so long without traffic from or to the drive its axis may have been moved."""
    done_drop_ms: float = DEFAULT_DONE_DROP_MS
    """For this time after a target its drive may still report the done of the move before."""
    next_target: NextTarget = NextTarget.AT_ONCE
    """What the drive does with a target that comes while the axis moves."""
    done_is_in_position: bool = False
    """Its done bit only says that it is near its present setpoint; the bit is set on the way too."""
    bits: Mapping[str, BitField] = field(default_factory=dict)
    max_registers: int = 123
    """Most registers that the drive takes in one frame."""
    response_ms: float | None = None
    """The drive's time from the last byte of a request to the first of its reply; None: unknown."""
    safe_read: bool = True
    """The gateway itself may read positions and bits (W8)."""
    checks_crc: bool = True
    """The drive ignores frames with a wrong CRC. If False, its line has no cut-through."""
    added_frames: bool = True
    refused_read: int = 0
    """Function byte with which its drive refuses every read; 0: the function code of the request with bit 7
    set."""
    exception_writes_nothing: bool = False
    """The profile says ``exception = "nothing-written"`` (M7)."""
    has_one_writer: bool = True
    """Only one controller may move it at a time."""
    writer_hold_s: float = DEFAULT_WRITER_HOLD_S
    """After this time without a frame that moves it, its writer loses its hold."""
    drive: str = ""
    """Name of the shipped profile with its registers; it selects the simulator's drive."""
    table_name: str = ""
    """Name of its file. Set without a table if the file was removed, or is bad and there was none before."""
    table_format: str = ""
    table_digest: str = ""
    thermal: ThermalSettings | None = None
    """None: the length of its screw is always that of its table."""
    cross: tuple[CrossPlan, ...] = ()

    @property
    def has_rules(self) -> bool:
        """Whether a frame may mean something other than a position to go to immediately."""
        return self.motion.waits_for_trigger or any(self.motion.modes) or bool(self.settable)


@dataclass(frozen=True, slots=True, order=True)
class StopWord:
    """What stops a drive: a register or a coil, written with a certain content."""

    address: int
    mask: int
    value: int
    is_coil: bool = False


@dataclass(frozen=True, slots=True)
class OtherUnits:
    """What is known of those unit ids of a line that have no axis."""

    unit_ids: frozenset[int] = frozenset()
    """Those of other devices: they pass unchanged."""
    odd: frozenset[int] = frozenset()
    """Those of them that may take odd frames, whose length differs from their function code: all that are on
    a serial port, but never 0, which is no device."""
    stops: frozenset[StopWord] = frozenset()
    """What stops the known drives: it passes to any of them."""


NO_OTHER_UNITS: Final = OtherUnits()


def writes_alone(plans: Iterable[AxisPlan], field: PositionField) -> bool:
    """Whether a target is the only thing written with FC16 at addresses with the same high byte, by the maps.

    For one unit id of which every frame is only a position to go to immediately.
    """
    page = field.address >> PAGE_BITS
    for plan in plans:
        settable = [plan.actual[number] for number in plan.settable]
        written = (*plan.command, *plan.limits, *settable, *plan.guarded, *plan.remapping)
        for other in written:
            first = other.address if other.block is None else other.block
            if other != field and page in (first >> PAGE_BITS, other.address >> PAGE_BITS):
                return False
    return True


@dataclass(frozen=True, slots=True)
class LineTiming:
    """Times of one bus, in milliseconds."""

    response_timeout_ms: float = 1000.0
    drain_ms: float = 0.0
    """Silence that must follow a time-out; 0: ``response_timeout_ms`` (W6). RTU only."""
    turnaround_ms: float = 100.0
    """Pause after a broadcast (Modbus over serial line V1.02, 2.4.1: typically 100 to 200 ms)."""
    gap_ms: float = 0.0
    """Silence that a drive needs before each request, beyond 3.5 characters (Delta: 10 ms)."""
    quiet_ms: float = 5.0
    """Time without motion after which a monitor's request may start; directly after motion it always may."""
    monitor_max_wait_ms: float = 200.0
    """A monitor's request that has waited for this time is sent in the next gap, even if it does not fit."""
    retry_ms: float = 1000.0
    """Pause before the next trial of a unit that left three requests in a row unanswered. It doubles each
    time, up to 10 s. 0: such a unit gets requests as if it had answered."""
    connect_delay_ms: float = 0.0
    """Pause between a new connection to the drives and the first request on it."""
    max_connection_s: float = 0.0
    """A connection to the drives is renewed after so long, once nothing is under way; 0: never."""
    connects_on_demand: bool = False
    """The connection is made for a request, and closed when none comes."""

    @property
    def backs_off(self) -> bool:
        """Whether a unit that left three requests in a row unanswered gets only trials."""
        return int(self.retry_ms * NS_PER_MS) > 0
