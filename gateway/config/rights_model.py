"""Keys for the rights of a controller, and of a role in TLS certificates."""

import re
from typing import Annotated, Final

from pydantic import BeforeValidator, Field

from gateway.drives.strict import ByName, ListOf, StrictModel, documented
from gateway.exchange.plan import Role
from gateway.exchange.rights import RegisterSpan, Rights

LARGEST_ADDRESS: Final = 0xFFFF
_NUMBER: Final = r"0[xX][0-9A-Fa-f]{1,4}|[0-9]{1,5}"
_SPAN: Final = re.compile(rf"({_NUMBER})(?:-({_NUMBER}))?")
SPAN_RULE: Final = 'allowed: addresses from 0 to 0xFFFF, as in 0x0606, "0x0606-0x0607" or "100-199"'


def read_span(raw: object) -> RegisterSpan:
    """Read an address, or the first and the last of a range.

    Raises:
        ValueError: anything else, also a first after its last.

    >>> read_span("0x0606-0x0607")
    RegisterSpan(first=1542, last=1543)
    """
    if isinstance(raw, int) and not isinstance(raw, bool):
        raw = str(raw)
    parts = _SPAN.fullmatch(raw) if isinstance(raw, str) else None
    if parts is None:
        raise ValueError(SPAN_RULE)
    first = int(parts[1], 16 if parts[1][:2] in {"0x", "0X"} else 10)
    last = first if parts[2] is None else int(parts[2], 16 if parts[2][:2] in {"0x", "0X"} else 10)
    if not first <= last <= LARGEST_ADDRESS:
        raise ValueError(SPAN_RULE)
    return RegisterSpan(first, last)


Span = Annotated[RegisterSpan, BeforeValidator(read_span)]
UnitId = Annotated[int, Field(ge=0, le=255)]
FunctionCode = Annotated[int, Field(ge=1, le=127)]


class RightsKeys(StrictModel):
    """What a client may do with the drives of a line."""

    role: ByName[Role] = Field(
        default=Role.MOTION,
        description="what the controller may do",
        json_schema_extra=documented(
            text=(
                "`motion`: everything, first in line. `operator`: read, and stop the axes. `monitor`: "
                "only read. Other requests get exception 1"
            )
        ),
    )
    read_only: bool = Field(
        default=False,
        description=("no write passes, whatever the role"),
        json_schema_extra=documented(more=("No stop either")),
    )
    unit_ids: ListOf[UnitId] = Field(
        default=(),
        description="unit ids that may be spoken to; none: all",
        json_schema_extra=documented(
            text=(
                "unit ids that it may address. On a serial line a broadcast (0) reaches every drive: it "
                "needs 0 and the unit ids of all axes of the line"
            ),
            default="all",
        ),
    )
    function_codes: ListOf[FunctionCode] = Field(
        default=(),
        description="function codes that may be used; none: all",
        json_schema_extra=documented(text="function codes that it may use", default="all"),
    )
    readable: ListOf[Span] = Field(
        default=(),
        description="addresses that may be read, each one or FIRST-LAST; none: all",
        json_schema_extra=documented(
            text=(
                'addresses that it may read, as in `[0x0520, "0x0606-0x0607"]`, for registers, coils and '
                "inputs alike. A request must stay inside one of them"
            ),
            kind="list of addresses",
            default="all",
        ),
    )
    writable: ListOf[Span] = Field(
        default=(),
        description="addresses that may be written, each one or FIRST-LAST; none: all",
        json_schema_extra=documented(
            text=("addresses that it may write; likewise"), kind="list of addresses", default="all"
        ),
    )
    requests_per_s: Annotated[float, Field(gt=0.0, le=1e6)] | None = Field(
        default=None,
        description="requests in a second, in the mean; not given: no limit",
        json_schema_extra=documented(
            kind="number > 0",
            text=(
                "average requests per second over all its connections; after a pause up to a second's "
                "worth at a time"
            ),
            default="no limit",
        ),
    )

    @property
    def rights(self) -> Rights:
        """The same in plain data, without the role."""
        return Rights(
            is_read_only=self.read_only,
            unit_ids=frozenset(self.unit_ids),
            function_codes=frozenset(self.function_codes),
            readable=self.readable,
            writable=self.writable,
            requests_per_s=self.requests_per_s or 0.0,
        )


class RoleKeys(RightsKeys):
    """The rights of a role in a certificate; none if the keys are missing."""

    role: ByName[Role] = Field(
        description="what a controller with this role may do",
        json_schema_extra=documented(
            text=(
                "`motion`: everything, first in line. `operator`: read, and stop the axes. `monitor`: "
                "only read. Other requests get exception 1"
            )
        ),
    )
