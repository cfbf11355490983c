"""``pitch-gateway table formats``: every readable format of table, and the options it needs."""

from collections.abc import Iterator

from gateway.cli.output import Format, show
from gateway.cli.table_options import AsJson
from gateway.plain import JsonObject
from gateway.tabfile import DIALECTS, OPTIONS, Dialect, UnitsOf
from gateway.tabfile.options import DECLARED

_UNITS = {
    UnitsOf.FILE: "in the file",
    UnitsOf.AXIS: "counts: units of the axis",
    UnitsOf.TOLD: "must be given",
}


def formats(*, json: AsJson = False) -> None:
    """List the table formats that can be read, and which options each needs.

    The text of a file tells its format. The options are those of the other commands; in a configuration they
    are under table_options, with _ for -. An option is needed only if the file does not state it.

    Examples:
      pitch-gateway table formats

      pitch-gateway table formats --json
    """
    show(_Formats(), Format.INDENTED if json else Format.TEXT)


class _Formats:
    """Every format."""

    def as_data(self) -> JsonObject:
        """Return them as plain data."""
        return {"formats": [_as_data(dialect) for dialect in DIALECTS]}

    def lines(self) -> Iterator[str]:
        """Yield them in words."""
        for dialect in DIALECTS:
            yield f"{dialect.name}: {dialect.title}"
            facts = [
                f"{'two directions' if dialect.directions == 2 else 'one correction for both directions'}",
                f"units: {_UNITS[dialect.units]}",
                f"files: *{dialect.suffix}" if dialect.suffix else "files: of any name",
                "read and written" if dialect.is_writable else "read only",
            ]
            yield f"  {'; '.join(facts)}"
            if options := _options(dialect):
                yield f"  may need {', '.join(options)}"


def _options(dialect: Dialect) -> list[str]:
    """Return the options that may be needed, as typed."""
    options = [DECLARED[name].typed for name in OPTIONS if name in dialect.uses]
    if dialect.units is not UnitsOf.FILE:
        options.insert(0, DECLARED["file_units"].typed)
    if any(other.recognise is dialect.recognise for other in DIALECTS if other is not dialect):
        options.insert(0, DECLARED["format"].typed)  # no text distinguishes the two
    return options


def _as_data(dialect: Dialect) -> JsonObject:
    return {
        "name": dialect.name,
        "title": dialect.title,
        "directions": dialect.directions,
        "units": dialect.units.value,
        "options": _options(dialect),
        "writable": dialect.is_writable,
        "suffix": dialect.suffix,
    }
