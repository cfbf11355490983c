"""``pitch-gateway table drift``: the drift of one position while the machine warms up or rests."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.output import Format, show
from gateway.cli.table_options import AsJson
from gateway.cli.table_reading import problems
from gateway.files import FileRefusedError, read_regular_file
from gateway.metrology.readings import small_unit
from gateway.metrology.warm_up import DriftTest, evaluate_drift, read_samples
from gateway.plain import JsonObject
from gateway.tabfile import FileProblem, TabFileError
from gateway.tabfile.text import MAX_BYTES, decode


def drift(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="CSV: time_min, measured_um, temperature_c.",
            show_default=False,
            readable=False,
        ),
    ],
    *,
    json: AsJson = False,
) -> None:
    """Evaluate a drift test in the manner of ISO 230-3: one position, read for hours.

    It shows the range over the whole test, the largest change within an hour, the rate at the end (whether
    the machine has settled), and, with temperatures, the change per kelvin. Measure an axis when an hour
    changes less than the required accuracy.

    Examples:
      pitch-gateway table drift warm-up.csv
    """
    with problems():
        try:
            data = read_regular_file(file, MAX_BYTES, "a file of a drift test")
        except FileRefusedError as error:
            raise TabFileError(FileProblem(str(file), str(error), "")) from None
        samples, units = read_samples(decode(data, str(file), "a drift test"))
        found = _Drifted(file, len(samples), evaluate_drift(samples, units))
    show(found, Format.INDENTED if json else Format.TEXT)


@dataclass(frozen=True, slots=True)
class _Drifted:
    """The results of a drift test file."""

    file: Path
    readings: int
    test: DriftTest

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        found, small = self.test, small_unit(self.test.units)
        per_kelvin = None if found.per_kelvin is None else found.per_kelvin * small.factor
        return {
            "file": str(self.file),
            "minutes": found.minutes,
            f"range_{small.key}": found.span * small.factor,
            f"largest_hour_{small.key}": found.largest_hour * small.factor,
            "largest_hour_from_min": found.hour_began,
            f"last_hour_{small.key}_per_h": found.last_rate * small.factor,
            f"{small.key}_per_kelvin": per_kelvin,
            "explained": found.explained,
        }

    def lines(self) -> Iterator[str]:
        """Yield it in words."""
        found, small = self.test, small_unit(self.test.units)
        yield f"{self.file}: {self.readings} readings in {found.minutes:g} min"
        yield f"range over the test: {small.text(found.span)}"
        yield (
            f"largest change within an hour: {small.text(found.largest_hour)}, "
            f"from minute {found.hour_began:g} on"
        )
        yield f"rate in the last hour: {found.last_rate * small.factor:+.2f} {small.name}/h"
        if found.per_kelvin is not None and found.explained is not None:
            yield (
                f"each kelvin changes it by {found.per_kelvin * small.factor:+.2f} {small.name}; this "
                f"explains {found.explained:.0%} of the drift"
            )
