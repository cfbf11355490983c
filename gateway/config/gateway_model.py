"""``[gateway]``, ``[http]`` and ``[mqtt]``."""

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
        default="tables", description="folder with the .tab files, relative to the configuration file"
    )
    state: Folder = Field(
        default=DEFAULT_STATE,
        description="folder of what the gateway keeps: the compiled configuration and tables, the records of "
        "the axes, and its socket while it runs; relative to the configuration file",
    )


class HttpSection(StrictModel):
    """The status page."""

    listen: str = Field(default="127.0.0.1:8480", description='address of the page, "" for none')


class MqttSection(StrictModel):
    """The broker that status is published to."""

    host: Annotated[str, Field(min_length=1)] = Field(default="127.0.0.1", description="the broker")
    port: Annotated[int, Field(ge=1, le=65535)] = Field(default=1883, description="the broker's port")
    base_topic: Annotated[str, Field(min_length=1)] = Field(
        default="pitch-gateway", description="what every topic begins with"
    )
    interval_s: Annotated[float, Field(gt=0.0, le=3600.0)] = Field(
        default=0.5, description="seconds between two messages of an axis"
    )
