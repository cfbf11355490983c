"""``[axis.NAME]``: one axis, its unit id, its scale, its table and how the table is used."""

from enum import Enum
from typing import Annotated

from pydantic import Field

from gateway.compensation import settings
from gateway.compensation.settings import BacklashKind, Gain, Outside, Setpoints
from gateway.compensation.units import Units
from gateway.config.axis_values import GainValue, OutsideValue, ReversalValue
from gateway.config.table_options import TableOptionsSection
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
from gateway.drives.strict import ByName, ListOf, Live, Planned, StrictModel, documented
from gateway.exchange.plan import (
    DEFAULT_BUDGET_US,
    DEFAULT_UNSEEN_MS,
    DEFAULT_WRITER_HOLD_S,
    CompensationMode,
    Late,
    Reference,
)


class HomeApproach(Enum):
    """Direction of the last movement of homing."""

    NONE = "none"
    FORWARD = "forward"
    BACKWARD = "backward"

    @property
    def sign(self) -> int:
        """+1 forward, -1 backward, 0 unknown."""
        return {HomeApproach.NONE: 0, HomeApproach.FORWARD: 1, HomeApproach.BACKWARD: -1}[self]


class AddedFrames(Enum):
    """Whether the gateway may send its own frames."""

    AUTO = "auto"
    NEVER = "never"


class Unmapped(Enum):
    """How a write to a position that is not mapped is handled, and a relative move without a known base."""

    REFUSE = "refuse"
    PASS = "pass"  # noqa: S105 (no password)


class StoredMoves(Enum):
    """How the start of a move with a target stored in the drive is handled."""

    REFUSE = "refuse"
    UNCORRECTED = "uncorrected"


class Writers(Enum):
    """How many controllers may move an axis at a time."""

    ONE = "one"
    ANY = "any"


class ReloadSpec(StrictModel):
    """How a new table replaces the old one while setpoints stream."""

    distance: PositiveLength = Field(description="setpoint travel of the blend, in units")


class BacklashSpec(StrictModel):
    """Constant lost motion, beside a table with one direction only."""

    width: PositiveLength = Field(description="the lost motion, in units")
    kind: ByName[BacklashKind] = Field(description="where it is put")


class AxisSection(StrictModel):
    """One axis."""

    line: str = Field(
        description="name of the [line.NAME] that its drive is on", json_schema_extra=documented(kind="name")
    )
    unit_id: Planned[UnitId] = Field(
        description="Modbus unit id of its drive",
        json_schema_extra=documented(
            text=(
                "Modbus unit id of its drive; 0 only on Modbus TCP (on a serial line it is the "
                "broadcast). Axes may share one if they share no register"
            )
        ),
    )
    drive: str | None = Field(
        default=None,
        description="a drive profile",
        json_schema_extra=documented(
            text=(
                'a built-in profile (`"oriental-az"`; `pitch-gateway drives` lists them), or a file '
                '(`"./my-drive.toml"`, relative to this file); see [drives.md](drives.md). Warned of: a '
                "kind of line that the drive does not have"
            ),
            kind="name or path",
        ),
    )
    registers: RegisterMap | None = Field(
        default=None,
        description="the registers of its drive",
        json_schema_extra=documented(
            more="See below; refused beside `drive`", default="required without `drive`"
        ),
    )
    units: Planned[ByName[Units]] = Field(
        description="unit of every length of this axis",
        json_schema_extra=documented(
            text=(
                "unit of every length of this axis. A table in the other unit of length is converted; "
                "angles never are"
            )
        ),
    )
    counts_per_unit: Planned[CountsPerUnit] = Field(
        description="counts of the drive in one unit, negative where it counts down",
        json_schema_extra=documented(
            text=(
                "counts of the drive per unit, negative if the drive counts down while the axis moves forward"
            )
        ),
    )
    zero_counts: Planned[Counts] = Field(default=0.0, description="count of the drive at machine position 0")
    machine_offset: Planned[Length] = Field(
        default=0.0, description="machine position of the controller's zero"
    )
    travel: Planned[Travel | None] = Field(
        default=None,
        description="[lowest, highest] machine position",
        json_schema_extra=documented(
            text=("lowest and highest machine position. They must fit the command registers"),
            default="none, warned of",
        ),
    )
    lead: PositiveLength | None = Field(
        default=None,
        description="travel of one turn of its screw, in units",
        json_schema_extra=documented(
            text=(
                "travel per turn of its screw. `measure` spreads random targets over it, warns of "
                "targets that always meet one angle of the screw, and looks for errors that repeat once "
                "and twice per turn"
            ),
            default="none: not looked for",
        ),
    )
    table: Live[str | None] = Field(
        default=None,
        description="name of its table file",
        json_schema_extra=documented(
            text=(
                "table file in the tables folder, case-insensitive, without a path. Renaming it to "
                "`.bak` or removing it while the gateway runs switches the correction off; so does "
                "`compensation`"
            ),
            kind="file name",
            default="none: 1:1",
        ),
    )
    table_options: Live[TableOptionsSection] = Field(
        default=TableOptionsSection(),
        description="what the file cannot prove about itself",
        json_schema_extra=documented(more="See below"),
    )
    compensation: Planned[Live[ByName[CompensationMode]]] = Field(
        default=CompensationMode.ON,
        description="on, shadow or off",
        json_schema_extra=documented(
            text=(
                "`on` corrects. `shadow` computes and shows corrections but passes positions unchanged: "
                "begin with it. `off` does neither; for an axis without a table it is no trouble. Write the "
                "key: without it an axis with a table is corrected, and `check` and each start warn"
            )
        ),
    )
    gain: Planned[Live[GainValue]] = Field(
        default=Gain(), description="share of the table that is applied, 0 to 1"
    )
    referenced: Planned[ByName[Reference]] = Field(
        description="how it is known that the axis knows where it is",
        json_schema_extra=documented(more="See below"),
    )
    home_approach: ByName[HomeApproach] = Field(
        default=HomeApproach.NONE,
        description="direction of the last movement of homing",
        json_schema_extra=documented(
            text=(
                "direction of the last movement of homing, hence the branch after it. `none`: half way "
                "between the branches until the first move"
            )
        ),
    )
    setpoints: Planned[ByName[Setpoints]] = Field(
        default=Setpoints.TARGETS,
        description="targets or a stream of setpoints",
        json_schema_extra=documented(
            text=("`targets`: the drive profiles each move; `stream`: a setpoint in every cycle")
        ),
    )
    max_speed: Planned[LengthOrZero] = Field(
        default=0.0,
        description="highest speed in units/s; 0: not known. Without it a target on the way of a moving axis "
        "is flagged if its reading is older than `fresh_ms`",
        json_schema_extra=documented(kind="units/s ≥ 0"),
    )
    hysteresis: LengthOrZero | None = Field(
        default=None,
        description="smallest reversal of a stream; jitter of measured positions",
        json_schema_extra=documented(
            text=(
                "`stream`: how far the setpoint must come back before the branch changes. `targets`: "
                "distance within which measured positions count as equal; every different target counts "
                "as a motion, however short. Refused if as long as travel or table"
            ),
            default=("2 counts, or 2 steps of registers that tell less than a count, at least 0.001 mm"),
        ),
    )
    in_position: LengthOrZero | None = Field(
        default=None,
        description="distance from its target within which an axis has arrived",
        json_schema_extra=documented(
            text=(
                "an axis has arrived if its done bit says so and its actual position is this close to "
                "its target. An axis unseen for `unseen_ms` but this close is still at its target. Never "
                "less than `hysteresis`"
            ),
            default="`0.02` mm",
        ),
    )
    repeat_within: CountsOrZero = Field(
        default=0.0,
        description="counts by which a target may differ from the last one and keep its branch",
        json_schema_extra=documented(
            text=(
                "`targets`: counts by which a target may differ from the last one and still be a "
                "jittering repeat, which keeps its branch (event `branch-hunts`)"
            ),
            kind="counts ≥ 0",
        ),
    )
    reversal: Planned[ReversalValue | None] = Field(default=None, description="blend between the branches")
    reload: ReloadSpec | None = Field(
        default=None,
        description="blend from one table to the next",
        json_schema_extra=documented(
            text=(
                "`stream`: setpoint travel over which one table blends into another; extended if "
                "necessary. No effect in `targets` (warned of)"
            ),
            kind="`{ distance = LENGTH }`",
            default="`1` mm",
        ),
    )
    outside: Planned[OutsideValue] = Field(default=Outside(), description="what holds outside the table")
    modulo: PositiveLength | None = Field(
        default=None,
        description="length of one turn of a rotary axis",
        json_schema_extra=documented(
            text=(
                "one turn of a rotary axis. The table must cover exactly one turn, with equal "
                'corrections at both ends; without a table `units` must be `"degree"`. The drive must '
                "count on over its turns, and go the way of the sign: with one that begins again at 0 or "
                "takes the shorter way, branch and reading are wrong"
            )
        ),
    )
    max_correction: Live[PositiveLength | None] = Field(
        default=None,
        description="largest correction allowed",
        json_schema_extra=documented(
            text="larger corrections, with backlash, are refused",
            default="`0.5` mm, or 0.3 mm/m of `travel` where that is more",
        ),
    )
    travel_margin: Live[LengthOrZero | None] = Field(
        default=None,
        description="how far a corrected position may lie outside travel",
        json_schema_extra=documented(
            text=("how far a corrected position may lie outside `travel` before it is refused"),
            default="`max_correction`",
        ),
    )
    max_slope: Planned[Live[Annotated[float, Field(gt=0.0, lt=1.0)]]] = Field(
        default=settings.DEFAULT_MAX_SLOPE,
        description="steepest table allowed",
        json_schema_extra=documented(
            text="steeper tables are refused: change of the correction per unit of travel"
        ),
    )
    fresh_ms: Planned[Milliseconds] = Field(
        default=settings.DEFAULT_FRESH_MS,
        description="age in milliseconds up to which a reading counts",
        json_schema_extra=documented(text="age up to which a measured position counts"),
    )
    backlash: BacklashSpec | None = Field(
        default=None,
        description="constant lost motion",
        json_schema_extra=documented(
            more="Beside a table of one direction, or without a table", kind="`{ width = LENGTH, kind = … }`"
        ),
    )
    thermal: ThermalSpec | None = Field(
        default=None,
        description="what a warm screw adds",
        json_schema_extra=documented(
            more=("Refused without `table` and `travel`, on a rotary axis and in a group")
        ),
    )
    cross: ListOf[CrossSpec] = Field(
        default=(),
        description="what the positions of other axes add",
        json_schema_extra=documented(
            more=("Refused without `table` and `travel`, and in a group"),
            kind="list of `{ axis, table, fresh_s }`",
        ),
    )
    budget_us: Planned[Live[Microseconds]] = Field(
        default=DEFAULT_BUDGET_US,
        description="microseconds that the gateway itself may take for one exchange",
        json_schema_extra=documented(
            text=(
                "the gateway's own time for one exchange of this axis, request plus reply: from the last "
                "byte in to the first byte out, without wires and drives"
            )
        ),
    )
    deadline_ms: Milliseconds | None = Field(
        default=None,
        description="age in milliseconds at which a target or its trigger is late",
        json_schema_extra=documented(
            text=(
                "age at which a target or its trigger is late, from its last byte from the controller to "
                "its first byte to the drive. A stop is never late"
            ),
            default="none",
        ),
    )
    late: ByName[Late] | None = Field(
        default=None,
        description="what happens to a late target",
        json_schema_extra=documented(
            text=(
                "a late target is sent anyway, so that no move ends short, or refused, because a stale "
                "setpoint is worse than none. Refused without `deadline_ms`"
            ),
            default='`"forward"` with `setpoints = "targets"`, `"reject"` with `"stream"`',
        ),
    )
    unmapped: ByName[Unmapped] = Field(
        default=Unmapped.REFUSE,
        description="writes to unmapped positions",
        json_schema_extra=documented(
            text=("writes to `position_like` registers while the axis is corrected: exception 2, or pass")
        ),
    )
    stored_moves: ByName[StoredMoves] = Field(
        default=StoredMoves.REFUSE,
        description="moves kept by the drive",
        json_schema_extra=documented(
            text=(
                "moves to positions stored in the drive, and triggers of targets that did not pass "
                "through the gateway: exception 4, or they run uncorrected and the axis is flagged"
            )
        ),
    )
    relative_unknown: ByName[Unmapped] = Field(
        default=Unmapped.REFUSE,
        description="relative moves from an unknown place",
        json_schema_extra=documented(
            text=("distances from an unknown position: exception 6, or they pass and are reported")
        ),
    )
    lost_ms: Planned[Milliseconds] = Field(
        default=1000.0,
        description="silence in milliseconds after which the drive may have been switched off",
        json_schema_extra=documented(
            text=(
                "a drive that left requests unanswered for longer than this, from first to last, may "
                "have been switched off: [what it forgets](wire-rules.md#when-a-link-is-lost). One lost "
                "reply is no silence"
            )
        ),
    )
    unseen_ms: Planned[Milliseconds] = Field(
        default=DEFAULT_UNSEEN_MS,
        description="time in milliseconds without a word of the axis after which it is looked at again",
        json_schema_extra=documented(
            text=(
                "`targets`: if the axis was neither read nor commanded for this long, it may have been "
                "jogged at the drive: the gateway reads its actual position before the next target, repeat "
                "or distance ([M6](wire-rules.md#m6-direction-and-arrival)). That read does not count "
                "towards `deadline_ms`. A status bit counts only if it is read again within this time. If "
                "reading is not allowed, the direction is flagged"
            )
        ),
    )
    added_frames: ByName[AddedFrames] = Field(
        default=AddedFrames.AUTO,
        description="frames that the gateway adds",
        json_schema_extra=documented(
            text=(
                "`never`: the gateway adds no frame. It refuses a trigger whose target must be rewritten "
                "and a distance whose start must be read. A direction that only a reading would show is "
                "kept and flagged"
            )
        ),
    )
    writers: ByName[Writers] = Field(
        default=Writers.ONE,
        description="how many controllers may move the axis at a time: one or any",
        json_schema_extra=documented(
            text=(
                "`one`: the controller that moves the axis holds it; moves from others get exception 6 "
                "(event `second-writer`), stops pass. `any`: all may move it at any time"
            )
        ),
    )
    writer_hold_s: Planned[Annotated[float, Field(gt=0.0, le=86_400.0)]] = Field(
        default=DEFAULT_WRITER_HOLD_S,
        description="seconds without a move after which another controller may move the axis",
        json_schema_extra=documented(
            text=(
                "how long a writer holds the axis after its last frame that moves it; at most 2 s after "
                "its last connection closed"
            )
        ),
    )

    @property
    def is_corrected(self) -> bool:
        """Whether the axis can be corrected: it has a table, or its own backlash."""
        return self.table is not None or self.backlash is not None


class GroupSection(StrictModel):
    """The axes of one gantry."""

    axes: Annotated[ListOf[Name], Field(min_length=2)] = Field(
        description="the axes of the group", json_schema_extra=documented(more="At least two")
    )
