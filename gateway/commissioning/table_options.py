"""Options about readings and tables, in groups, for commands and programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Annotated, Final

from gateway.compensation.settings import DEFAULT_MAX_SLOPE
from gateway.compensation.table import CorrectionTable
from gateway.compensation.units import Units
from gateway.metrology.build import Fit, HomeCase, HomeReference
from gateway.metrology.drift import at_20_degrees
from gateway.metrology.errors import ReadingsError
from gateway.metrology.formats import FORMATS, ReadingsContext, Runs
from gateway.metrology.lead import Period, periods_of
from gateway.metrology.readings import Survey
from gateway.metrology.uncertainty import UncertaintyInputs, inputs_of
from gateway.options import Option, Options
from gateway.tabfile import DIALECTS, ErrorSense, FileContext, TableOptions, WriteOptions
from gateway.tabfile.options import DECLARED

if TYPE_CHECKING:
    from gateway.metrology.band import Band
    from gateway.metrology.screw import MeasuredScrew

NAMES: Final = ", ".join(each.name for each in FORMATS)


class SlopeError(ReadingsError):
    """The given ``max_slope`` is not a slope."""


def format_names() -> Sequence[str]:
    """Return the name of every format of tables."""
    return sorted(dialect.name for dialect in DIALECTS)


def writable_names() -> Sequence[str]:
    """Return the name of every format of tables that can be written."""
    return sorted(dialect.name for dialect in DIALECTS if dialect.is_writable)


Force = Annotated[bool, Option("Overwrite OUT.")]
ToSense = Annotated[ErrorSense | None, Option("What OUT calls an error, if its format leaves that open.")]
ToFileAxis = Annotated[
    str | None, Option("What OUT calls the axis, if its format names axes.", metavar="NAME")
]
Counts = Annotated[
    float | None, Option("Counts of the drive per machine unit, signed.", "counts-per-unit", metavar="N")
]
AxisLetter = Annotated[str | None, Option("Axis of the table.", metavar="LETTER")]
Home = Annotated[
    HomeCase | None,
    Option(
        "Where the correction is 0. switch-positive: positions are positive, and the home switch is at "
        "the negative end. switch-negative: positions are negative, and the switch is at the positive "
        "end. mark: a reference mark at 0."
    ),
]
MaxSlope = Annotated[
    float | None,
    Option(
        "Largest allowed slope, like max_slope of the axis. Default: the line '# max_slope' of the "
        "readings, or 0.01."
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions(Options, TableOptions):
    """Options for reading a table file: every declared option, and the axis.

    ``units`` also gives the ``file_units`` of a file that states none.
    """

    format: Annotated[
        str | None,
        Option(
            DECLARED["format"].option.help, metavar=DECLARED["format"].option.metavar, one_of=format_names
        ),
    ] = None
    travel: Annotated[
        tuple[float, float] | None,
        Option("Travel limits of the axis, in machine units of the table.", metavar="LO HI"),
    ] = None
    units: Annotated[Units | None, Option(DECLARED["file_units"].option.help)] = None
    axis: AxisLetter = None

    def context(self, counts_per_unit: float | None = None) -> FileContext:
        """Return it for a reader; ``counts_per_unit`` is the drive's.

        Raises:
            ContextError: a part of it is impossible.
        """
        return FileContext(
            **self.given(),
            travel=self.travel,
            units=self.units,
            axis=self.axis,
            counts_per_unit=counts_per_unit,
        )


@dataclass(frozen=True, slots=True)
class FormatOptions(Options):
    """Facts that files of readings do not contain."""

    readings_format: Annotated[
        str | None, Option(f"Format of the readings, if it is not clear: {NAMES}.", metavar="NAME")
    ] = None
    runs: Annotated[Runs | None, Option("Directions of the runs, if the file does not prove them.")] = None

    def context(self, units: Units | None, axis: str | None) -> ReadingsContext:
        """Return it for a reader, with the given facts about the axis."""
        return ReadingsContext(self.readings_format, units, axis, self.runs)


@dataclass(frozen=True, slots=True)
class ScrewOptions(Options):
    """Known facts about the screw."""

    lead: Annotated[
        float | None,
        Option(
            "Lead of the screw, in the units of the readings: the error may repeat once and twice a "
            "turn. Default: the line '# lead' of the readings."
        ),
    ] = None
    period: Annotated[
        list[float] | None,
        Option(
            "Another length after which the error may repeat: a turn of motor or gear; repeat it for more."
        ),
    ] = None
    to_20c: Annotated[
        float | None,
        Option(
            "Normalise to 20 °C: expansion of the screw in µm per metre and kelvin, 11.5 for steel. "
            "The readings need temperatures.",
            metavar="COEFFICIENT",
        ),
    ] = None

    def periods(self, survey: Survey) -> tuple[Period, ...]:
        """Return the possible periods of the error: the given ones, or those in the readings.

        Raises:
            ReadingsError: a lead or a period that is not a valid length.
        """
        lead = self.lead
        if lead is None and (stated := survey.facts.get("lead")) is not None:
            lead = _number(survey.source, "lead", stated, "in the units of the targets", "lead")
        return periods_of(lead, self.period or ())

    def normalised(self, survey: Survey) -> Survey:
        """Return the readings at 20 °C, if requested.

        Raises:
            ReadingsError: see :func:`gateway.metrology.drift.at_20_degrees`.
        """
        return survey if self.to_20c is None else at_20_degrees(survey, self.to_20c)


@dataclass(frozen=True, slots=True)
class StatedOptions(Options):
    """What a person knows about the instrument and the temperatures. Default: the lines of the readings."""

    u_instrument: Annotated[
        float | None,
        Option(
            "Uncertainty of the instrument over the length, k = 2, in µm (arcsec). Default: the line "
            "'# u_instrument' of the readings, or 0.",
            min=0.0,
        ),
    ] = None
    u_alignment: Annotated[
        float | None,
        Option(
            "How far beam or scale leave the axis over its length, in mm; also a line '# u_alignment'.",
            min=0.0,
        ),
    ] = None
    u_temperature: Annotated[
        float | None,
        Option("Possible range of the screw's temperature, in K; also a line '# u_temperature'.", min=0.0),
    ] = None
    u_environment: Annotated[
        float | None,
        Option(
            "Change within an hour of a drift test, in µm (arcsec); also a line '# u_environment'.", min=0.0
        ),
    ] = None

    def given(self) -> dict[str, float]:
        """Return the given values, by the names of their lines in a file of readings."""
        values = {name: getattr(self, name) for name in self.__slots__}
        return {name: value for name, value in values.items() if value is not None}

    def inputs(self, survey: Survey) -> UncertaintyInputs:
        """Return the given values, or those in the readings, in the units of the readings.

        Raises:
            ReadingsError: a value that is not a number of 0 or more.
        """
        numbers = [self._stated(survey, name) or 0.0 for name in self.__slots__]
        return inputs_of(survey.units, *numbers)

    def missing(self, survey: Survey) -> tuple[str, ...]:
        """Return what nobody stated, with its option; for a walk of a block with the line of its file."""
        if any(name in survey.facts for name in ("block_grade", "block_uncertainty_um")):
            walked = {
                "dial_error_um": "the dial over its range",
                "block_temperature_range": "the temperatures of block and axis",
            }
            return tuple(f"{what} (# {name})" for name, what in walked.items() if name not in survey.facts)
        named = {"u_instrument": "the instrument", "u_temperature": "the temperature of the screw"}
        return tuple(
            f"{what} (--{name.replace('_', '-')})"
            for name, what in named.items()
            if self._stated(survey, name) is None
        )

    def band(
        self,
        screw: "MeasuredScrew | None",
        table: CorrectionTable,
        home: HomeReference | None,
        survey: Survey,
    ) -> "Band | None":
        """Return the uncertainty of a table along the axis; None: the readings do not tell it."""
        inputs = self.inputs(survey)
        if screw is None:
            return None
        from gateway.metrology.band import band_of

        return band_of(screw, table, home, inputs, self.missing(survey))

    def _stated(self, survey: Survey, name: str) -> float | None:
        value: float | None = getattr(self, name)
        if value is None and (stated := survey.facts.get(name)) is not None:
            value = _number(survey.source, name, stated, "0 or more", name.replace("_", "-"))
            if not 0.0 <= value < inf:
                raise ReadingsError(f"{survey.source}: # {name}: {stated}: it must be 0 or more")
        return value


@dataclass(frozen=True, slots=True)
class ShapeOptions(Options):
    """How a table follows readings."""

    one_way: Annotated[bool, Option("One curve for both directions, from all readings.")] = False
    fit: Annotated[
        Fit, Option("Shape between the targets; auto: the one that leaves the smallest error.")
    ] = Fit.AUTO
    screw: ScrewOptions = ScrewOptions()


@dataclass(frozen=True, slots=True)
class OutOptions(Options):
    """Options for writing OUT, besides its format."""

    to_counts_per_unit: Annotated[
        float | None, Option("Encoder counts per unit of the control that will read OUT.", metavar="N")
    ] = None
    to_sense: ToSense = None
    to_file_axis: ToFileAxis = None

    def writing(self, axis: str | None) -> WriteOptions:
        """Return it for a writer, with the letter of the axis."""
        return WriteOptions(axis, self.to_counts_per_unit, file_axis=self.to_file_axis, sense=self.to_sense)


def steep_allowed(survey: Survey, given: float | None) -> float:
    """Return the slope limit of a table: the given one, that of the readings, or the default of axes.

    Raises:
        SlopeError: the given value is not a slope below 1.
        ReadingsError: the value in the readings is not one.
    """
    if given is not None:
        if not 0.0 < given < 1.0:
            raise SlopeError(f"{given:g}: it must be above 0 and below 1, as max_slope of the axis")
        return given
    if (stated := survey.facts.get("max_slope")) is None:
        return DEFAULT_MAX_SLOPE
    limit = _number(survey.source, "max_slope", stated, "above 0 and below 1", "max-slope")
    if not 0.0 < limit < 1.0:
        raise ReadingsError(f"{survey.source}: # max_slope: {stated}: it must be above 0 and below 1")
    return limit


def _number(source: str, name: str, stated: str, what: str, option: str) -> float:
    try:
        return float(stated)
    except ValueError:
        raise ReadingsError(
            f"{source}: # {name}: {stated}: it must be a number, {what}; correct this line, or remove it "
            f"and give --{option}"
        ) from None
