"""``[gateway]`` and ``[http]``."""

from typing import Annotated

from pydantic import AfterValidator, Field

from gateway.config.values import ADDRESS_RULE, Name, parse_address
from gateway.drives.strict import StrictModel
from gateway.ipc.state_folder import DEFAULT_STATE
from gateway.transport.endpoints import TcpEndpoint

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


def check_listen(text: str) -> str:
    """Check the address of the status page; empty for none.

    Raises:
        ValueError: it is neither an address nor empty.
    """
    if text:
        try:
            parse_address(text)
        except ValueError as error:
            rule = f'{ADDRESS_RULE}; or "" for none'
            raise ValueError(rule if str(error) == ADDRESS_RULE else f'{error}; or "" for none') from None
    return text


class HttpSection(StrictModel):
    """The status page."""

    listen: Annotated[str, AfterValidator(check_listen)] = Field(
        default="127.0.0.1:8480", description='address of the page, "" for none'
    )

    @property
    def endpoint(self) -> TcpEndpoint | None:
        """Where the page is; None where it is off."""
        return TcpEndpoint(*parse_address(self.listen)) if self.listen else None
