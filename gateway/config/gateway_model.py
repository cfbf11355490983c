"""``[gateway]`` and ``[status_unit]``."""

from typing import Annotated

from pydantic import Field

from gateway.config.values import Name
from gateway.drives.strict import StrictModel
from gateway.ipc.state_folder import DEFAULT_STATE

Folder = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]


class GatewaySection(StrictModel):
    """What concerns the gateway as a whole."""

    name: Name = Field(default="gateway", description="name of this gateway in status and messages")
    tables: Folder = Field(
        default="tables", description="folder with the table files, relative to the configuration file"
    )
    state: Folder = Field(
        default=DEFAULT_STATE,
        description="folder of what the gateway keeps: the compiled configuration and tables, the records of "
        "the axes, and its socket while it runs; relative to the configuration file",
    )


class StatusUnitSection(StrictModel):
    """The unit id at which the gateway answers for itself."""

    id: Annotated[int, Field(ge=1, le=254)] = Field(
        description="unit id at which controllers read the state of the gateway; of no drive"
    )
