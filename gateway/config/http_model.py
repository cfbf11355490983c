"""``[http]``."""

from typing import Annotated, Final

from pydantic import AfterValidator, Field

from gateway.config.values import ADDRESS_RULE, FileName, Name, parse_address
from gateway.drives.strict import ListOf, Secret, StrictModel, documented
from gateway.transport.endpoints import TcpEndpoint

MOST_TOKENS: Final = 16


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


class TokenSection(StrictModel):
    """A token that permits viewing, and acknowledging alarms if its key says so."""

    name: Name = Field(description="who or what has it, for the log")
    file: Secret[FileName] = Field(
        description="file that holds the token and nothing else, relative to the configuration file, or "
        "credential:NAME; pitch-gateway token makes one"
    )
    acknowledge: bool = Field(
        default=False, description="this token may acknowledge alarms; the log and the page show its name"
    )


class HttpTlsSection(StrictModel):
    """The gateway's certificate, and which client certificates permit viewing."""

    certificate: FileName = Field(
        description="file with the certificate of the page, and those between it and its authority"
    )
    key: Secret[FileName] = Field(description="file with the key of that certificate, or credential:NAME")
    clients: FileName | None = Field(
        default=None,
        description="file with the authorities that sign certificates of clients: a client with one may look",
    )
    revoked: FileName | None = Field(
        default=None, description="file with the list of certificates of clients that were revoked"
    )


class HttpSection(StrictModel):
    """The status page."""

    listen: Annotated[str, AfterValidator(check_listen)] = Field(
        default="127.0.0.1:8480",
        description='address of the page, "" for none',
        json_schema_extra=documented(
            text=(
                'address of the page and of all HTTP services ([http](http.md)); `""`: no TCP. `[::]`: '
                "IPv6 only"
            ),
            kind='`"HOST:PORT"`, `"[IPv6]:PORT"` or `""`',
        ),
    )

    tokens: Annotated[ListOf[TokenSection], Field(max_length=MOST_TOKENS)] = Field(
        default=(),
        description="tokens of the people and programs that may look; none: the page asks for none",
        json_schema_extra=documented(
            text=(
                '`[{ name = "prometheus", file = "prometheus.token" }]`: a client with one of these '
                "tokens may look; with `acknowledge = true` also acknowledge alarms "
                "([http](http.md#post-acknowledge)). `file` holds the token on one line (`pitch-gateway "
                "token FILE` makes one) and is read again on changes. Required over TCP, on this machine "
                "too; not on the Unix socket"
            ),
            kind="list of tables, 16 at most",
            default="none: the page asks for none",
        ),
    )
    tls: HttpTlsSection | None = Field(
        default=None,
        description="encrypt; needed beyond this machine",
        json_schema_extra=documented(
            text=(
                "`certificate` and its `key`, both PEM, the key unencrypted. `clients`: authorities "
                "whose clients may look by certificate, with or without a token, except those in "
                "`revoked`. Read again by `reload`"
            ),
            default="none: no TLS",
        ),
    )

    @property
    def endpoint(self) -> TcpEndpoint | None:
        """Address of the page; None if it is off."""
        return TcpEndpoint(*parse_address(self.listen)) if self.listen else None
