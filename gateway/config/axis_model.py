"""``[axis.NAME]``: one axis, its place on the bus, its scale, its table and what is done with it."""

from enum import Enum
from typing import Annotated

from pydantic import Field

from gateway.compensation import settings
from gateway.compensation.settings import BacklashKind, Gain, Outside, Setpoints
from gateway.compensation.units import Units
from gateway.config.axis_values import GainValue, OutsideValue, ReversalValue
from gateway.config.terms_model import CrossSpec, ThermalSpec
from gateway.config.values import (
    Counts,
    CountsOrZero,
    CountsPerUnit,
    Length,
    LengthOrZero,
    Microseconds,
    Milliseconds,
    Name,
    PositiveLength,
    Travel,
    UnitId,
)
from gateway.drives.registers import RegisterMap
from gateway.drives.strict import ByName, ListOf, StrictModel
from gateway.exchange.plan import (
    DEFAULT_BUDGET_US,
    DEFAULT_UNSEEN_MS,
    DEFAULT_WRITER_HOLD_S,
    CompensationMode,
    Late,
    Reference,
)
from gateway.tabfile import ErrorSense, HomeSide, V1Layout


class HomeApproach(Enum):
    """Direction of the last movement of homing."""

    NONE = "none"
    FORWARD = "forward"
    BACKWARD = "backward"

    @property
    def sign(self) -> int:
        """+1 forward, -1 backward, 0 not known."""
        return {HomeApproach.NONE: 0, HomeApproach.FORWARD: 1, HomeApproach.BACKWARD: -1}[self]


class AddedFrames(Enum):
    """Whether the gateway may send frames of its own."""

    AUTO = "auto"
    NEVER = "never"


class Unmapped(Enum):
    """What happens to a write to a position that is not mapped; also to a relative move without a base."""

    REFUSE = "refuse"
    PASS = "pass"  # noqa: S105 (no password)


class StoredMoves(Enum):
    """What happens to the start of a move whose target the drive keeps."""

    REFUSE = "refuse"
    UNCORRECTED = "uncorrected"


class Writers(Enum):
    """How many controllers may move an axis at a time."""

    ONE = "one"
    ANY = "any"


class ReloadSpec(StrictModel):
    """How one table gives way to another while setpoints stream."""

    distance: PositiveLength = Field(description="setpoint travel of the blend, in units")


class BacklashSpec(StrictModel):
    """Constant lost motion beside a table that knows one direction only."""

    width: PositiveLength = Field(description="the lost motion, in units")
    kind: ByName[BacklashKind] = Field(description="where it is put")


class TableOptions(StrictModel):
    """What a table file cannot prove about itself."""

    file_counts_per_unit: CountsPerUnit | None = Field(
        default=None, description="encoder counts per unit of the control that the file was made for"
    )
    v1_layout: ByName[V1Layout] | None = Field(default=None, description="what the first value belongs to")
    file_start: Length | None = Field(default=None, description="machine position of the first point")
    increment: PositiveLength | None = Field(
        default=None, description="distance of the points of a Mint program that does not set it"
    )
    file_home: ByName[HomeSide] | None = Field(default=None, description="the end at which it homes")
    format: str | None = Field(default=None, description="name of the format, where the text fits several")
    file_units: ByName[Units] | None = Field(default=None, description="units of a file that states none")
    file_axis: str | None = Field(default=None, description="name of the axis in a file of several")
    fagor_sense: ByName[ErrorSense] | None = Field(default=None, description="how the error was meant")
    isg_sense: ByName[ErrorSense] | None = Field(default=None, description="how the error was meant")
    error_sense: ByName[ErrorSense] | None = Field(default=None, description="how the error was meant")


class AxisSection(StrictModel):
    """One axis."""

    line: str = Field(description="name of the [line.NAME] that its drive is on")
    unit_id: UnitId = Field(description="Modbus unit id of its drive")
    drive: str | None = Field(default=None, description="a drive profile")
    registers: RegisterMap | None = Field(default=None, description="the registers of its drive")
    units: ByName[Units] = Field(description="unit of every length of this axis")
    counts_per_unit: CountsPerUnit = Field(
        description="counts of the drive in one unit, negative where it counts down"
    )
    zero_counts: Counts = Field(default=0.0, description="count of the drive at machine position 0")
    machine_offset: Length = Field(default=0.0, description="machine position of the controller's zero")
    travel: Travel | None = Field(default=None, description="[lowest, highest] machine position")
    lead: PositiveLength | None = Field(default=None, description="travel of one turn of its screw, in units")
    table: str | None = Field(default=None, description="name of its table file")
    table_options: TableOptions = Field(
        default=TableOptions(), description="what the file cannot prove about itself"
    )
    compensation: ByName[CompensationMode] = Field(
        default=CompensationMode.ON, description="on, shadow or off"
    )
    gain: GainValue = Field(default=Gain(), description="share of the table that is applied, 0 to 1")
    referenced: ByName[Reference] = Field(description="how it is known that the axis knows where it is")
    home_approach: ByName[HomeApproach] = Field(
        default=HomeApproach.NONE, description="direction of the last movement of homing"
    )
    setpoints: ByName[Setpoints] = Field(
        default=Setpoints.TARGETS, description="targets or a stream of setpoints"
    )
    max_speed: LengthOrZero = Field(default=0.0, description="highest speed in units/s; 0: not known")
    hysteresis: LengthOrZero | None = Field(
        default=None, description="smallest reversal of a stream; jitter of measured positions"
    )
    in_position: LengthOrZero | None = Field(
        default=None, description="distance from its target within which an axis has arrived"
    )
    repeat_within: CountsOrZero = Field(
        default=0.0, description="counts by which a target may differ from the last one and keep its branch"
    )
    reversal: ReversalValue | None = Field(default=None, description="blend between the branches")
    reload: ReloadSpec | None = Field(default=None, description="blend from one table to the next")
    outside: OutsideValue = Field(default=Outside(), description="what holds outside the table")
    modulo: PositiveLength | None = Field(default=None, description="length of one turn of a rotary axis")
    max_correction: PositiveLength | None = Field(default=None, description="largest correction allowed")
    travel_margin: LengthOrZero | None = Field(
        default=None, description="how far a corrected position may lie outside travel"
    )
    max_slope: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(
        default=settings.DEFAULT_MAX_SLOPE, description="steepest table allowed"
    )
    fresh_ms: Milliseconds = Field(
        default=settings.DEFAULT_FRESH_MS, description="age in milliseconds up to which a reading counts"
    )
    backlash: BacklashSpec | None = Field(default=None, description="constant lost motion")
    thermal: ThermalSpec | None = Field(default=None, description="what a warm screw adds")
    cross: ListOf[CrossSpec] = Field(default=(), description="what the positions of other axes add")
    budget_us: Microseconds = Field(
        default=DEFAULT_BUDGET_US,
        description="microseconds that the gateway itself may take for one exchange",
    )
    deadline_ms: Milliseconds | None = Field(
        default=None, description="age in milliseconds at which a target or its trigger is late"
    )
    late: ByName[Late] | None = Field(default=None, description="what happens to a late target")
    unmapped: ByName[Unmapped] = Field(default=Unmapped.REFUSE, description="writes to unmapped positions")
    stored_moves: ByName[StoredMoves] = Field(
        default=StoredMoves.REFUSE, description="moves kept by the drive"
    )
    relative_unknown: ByName[Unmapped] = Field(
        default=Unmapped.REFUSE, description="relative moves from an unknown place"
    )
    lost_ms: Milliseconds = Field(
        default=1000.0,
        description="silence in milliseconds after which the drive may have been switched off",
    )
    unseen_ms: Milliseconds = Field(
        default=DEFAULT_UNSEEN_MS,
        description="time in milliseconds without a word of the axis after which it is looked at again",
    )
    added_frames: ByName[AddedFrames] = Field(
        default=AddedFrames.AUTO, description="frames that the gateway adds by itself"
    )
    writers: ByName[Writers] = Field(
        default=Writers.ONE, description="how many controllers may move the axis at a time: one or any"
    )
    writer_hold_s: Annotated[float, Field(gt=0.0, le=86_400.0)] = Field(
        default=DEFAULT_WRITER_HOLD_S,
        description="seconds without a move after which another controller may move the axis",
    )

    @property
    def is_corrected(self) -> bool:
        """Whether anything of it may be corrected: it has a table, or a backlash of its own."""
        return self.table is not None or self.backlash is not None


class GroupSection(StrictModel):
    """Axes that carry one beam together."""

    axes: Annotated[ListOf[Name], Field(min_length=2)] = Field(description="the axes of the group")
