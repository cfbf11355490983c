"""``[axis.NAME.table_options]``: the keys of what a table file cannot prove about itself.

They are declared with the readers, in :mod:`gateway.tabfile.options`; here they become a table of the schema.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import AfterValidator, Field, create_model

from gateway.config.values import CountsPerUnit, Length, PositiveLength
from gateway.drives.strict import StrictModel, documented
from gateway.tabfile import options
from gateway.tabfile.options import DECLARED, Declared, Quantity, TableOptions


class _Section(StrictModel):
    """What a table file cannot prove about itself."""

    def options(self) -> TableOptions:
        """Return the options for a table reader."""
        return TableOptions(**{name: getattr(self, name) for name in DECLARED})


_NUMBERS: Final[Mapping[Quantity, Any]] = {
    options.COUNTS_PER_UNIT: CountsPerUnit,
    options.LENGTH: Length,
    options.DISTANCE: PositiveLength,
}
"""Quantities for which the configuration has its own type, with bounds and words."""


def _type(declared: Declared) -> Any:
    """Return what the schema takes for an option."""
    quantity = declared.quantity
    if quantity is None:
        return declared.type if declared.type is str else Annotated[declared.type, Field(strict=False)]
    return _NUMBERS.get(quantity) or Annotated[float, AfterValidator(quantity.check)]


def _field(declared: Declared) -> Any:
    kind = declared.quantity.rule if declared.quantity and declared.quantity not in _NUMBERS else ""
    return (
        _type(declared) | None,
        Field(default=None, description=declared.option.description, json_schema_extra=documented(kind=kind)),
    )


if TYPE_CHECKING:
    TableOptionsSection = _Section
else:
    TableOptionsSection = create_model(
        "TableOptionsSection",
        __base__=_Section,
        __doc__=_Section.__doc__,
        **{name: _field(declared) for name, declared in DECLARED.items()},
    )
