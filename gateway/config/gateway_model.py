"""``[gateway]``, ``[status_unit]`` and ``[capture]``."""

from typing import Annotated

from pydantic import AfterValidator, Field

from gateway.catalogue.events import EVENTS
from gateway.config.findings import suggest
from gateway.config.values import Name
from gateway.drives.strict import ListOf, Live, StrictModel, documented
from gateway.state.folder import DEFAULT_STATE


def _check_event(name: str) -> str:
    """Check that there is an event of this name. Raises ValueError otherwise."""
    if name not in EVENTS:
        raise ValueError(f"allowed: a name of an event; {suggest(name, list(EVENTS))}")
    return name


EventName = Annotated[str, AfterValidator(_check_event)]
Folder = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]


class GatewaySection(StrictModel):
    """What concerns the gateway as a whole."""

    name: Name = Field(default="gateway", description="name of this gateway in status and messages")
    tables: Live[Folder] = Field(
        default="tables",
        description="folder with the table files, relative to the configuration file",
        json_schema_extra=documented(kind="path"),
    )
    state: Folder = Field(
        default=DEFAULT_STATE,
        description="folder of what the gateway keeps: the compiled configuration and tables, the records of "
        "the axes, and its socket while it runs; relative to the configuration file",
        json_schema_extra=documented(
            text=(
                "folder of what the gateway keeps, relative to the configuration file: the compiled "
                "configuration and tables, the records of the axes, and `relay.sock` while it runs (see "
                "[services.md](services.md)). Made if it is missing; one for each gateway"
            ),
            kind="path",
        ),
    )


class StatusUnitSection(StrictModel):
    """The unit id at which the gateway answers for itself."""

    id: Annotated[int, Field(ge=1, le=254)] = Field(
        description="unit id at which controllers read the state of the gateway; of no drive",
        json_schema_extra=documented(
            more=(
                "Nor of another device on any line. Read-only ([registers](status-registers.md)). 248 "
                "and above are reserved on serial lines and free in practice; some panels reach 247 "
                "at most"
            )
        ),
    )


class CaptureSection(StrictModel):
    """What is kept of the frames of the last minutes."""

    size_mb: Annotated[float, Field(ge=0, le=256)] = Field(
        default=4,
        description="memory for the last frames of each line, in MB; 0: none are kept",
        json_schema_extra=documented(
            more=(
                "An exchange takes about 130 bytes: 4 MB are five minutes of a hundred exchanges in a "
                "second. Changed at the next start"
            )
        ),
    )
    on: Live[ListOf[EventName]] = Field(
        default=(),
        description="events that write the frames before and after them into a file",
        json_schema_extra=documented(
            more=(
                'As in `["drive-silent", "axis-blocked"]`; `pitch-gateway explain` knows '
                "all. The supervisor writes `capture-TIME-EVENT.jsonl` into the folder of "
                "the state, 2 s after the event, once a minute at most"
            ),
            kind="list of events",
        ),
    )
    keep: Live[Annotated[int, Field(ge=1, le=1000)]] = Field(
        default=8, description="so many files are kept; the oldest gives way"
    )

    @property
    def tape_bytes(self) -> int:
        """Bytes for each line."""
        return int(self.size_mb * 1_000_000)
