"""``[gateway]``, ``[status_unit]``, ``[alarm_output]`` and ``[capture]``."""

from collections.abc import Collection
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from gateway.catalogue.events import EVENTS
from gateway.config.findings import suggest
from gateway.config.line_model import DrivesEndpoint
from gateway.config.values import FileName, Name
from gateway.drives.strict import ListOf, Live, StrictModel, documented
from gateway.drives.words import Address
from gateway.state.folder import DEFAULT_STATE


def _check_event(name: str) -> str:
    """Check that an event of this name exists. Raises ValueError otherwise."""
    if name not in EVENTS:
        raise ValueError(f"allowed: a name of an event; {suggest(name, list(EVENTS))}")
    return name


EventName = Annotated[str, AfterValidator(_check_event)]
Folder = Annotated[str, Field(min_length=1, pattern=r"^[^\x00]*$")]


class GatewaySection(StrictModel):
    """Settings of the whole gateway."""

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
                "folder for the gateway's own data, relative to the configuration file: the compiled "
                "configuration and tables, axis records, and `relay.sock` ([services.md](services.md)). "
                "Created if missing; each gateway needs its own"
            ),
            kind="path",
        ),
    )
    allowed_signers: Live[FileName | None] = Field(
        default=None,
        description="file of those who may sign tables; a table without their signature is not taken",
        json_schema_extra=documented(
            text=(
                "file of those who may sign tables (`man ssh-keygen`, ALLOWED SIGNERS), relative to the "
                "configuration file. A table without a signature of one of them is not taken over "
                "([below](#signed-tables)). Without the key none is asked for"
            ),
        ),
    )


class StatusUnitSection(StrictModel):
    """The gateway's own unit id."""

    id: Annotated[int, Field(ge=1, le=254)] = Field(
        description="unit id at which controllers read the state of the gateway; of no drive",
        json_schema_extra=documented(
            text=(
                "unit id of the gateway's read-only [registers](status-registers.md); no drive or other "
                "device may have it. 248 and above are reserved on serial lines but free in practice; "
                "some panels reach only 247"
            ),
        ),
    )


def _read_chip(raw: object) -> str:
    """Read the path of a GPIO chip. Raises ValueError otherwise."""
    if not isinstance(raw, str) or not raw.startswith("/") or "\0" in raw:
        raise ValueError('allowed: the full path of a GPIO chip, as in "/dev/gpiochip0"')
    return raw


class GpioLine(StrictModel):
    """A line of a GPIO chip, by the names of libgpiod."""

    chip: Annotated[str, BeforeValidator(_read_chip)] = Field(
        description="path of the chip, as in /dev/gpiochip0",
        json_schema_extra=documented(kind="path from `/`", more="`gpiodetect` lists them"),
    )
    line: Annotated[int, Field(ge=0, le=65535)] = Field(
        description="number of the line in the chip",
        json_schema_extra=documented(more="`gpioinfo` lists them. It is no number of a pin of the header"),
    )
    active_low: bool = Field(default=False, description="a low level closes the contact")


def why_no_gpio() -> str:
    """Return why GPIO lines cannot be used here, with the remedy; "" if they can."""
    try:
        import gpiod
    except ImportError:
        why = "the Python package gpiod is not installed"
    else:
        if hasattr(gpiod, "request_lines"):
            return ""
        why = "the Python package gpiod is older than version 2"
    return f"{why}; pip install 'pitch-gateway[gpio]' where pitch-gateway is installed"


class AlarmOutputSection(StrictModel):
    """A contact that opens when something is wrong, or when the gateway is dead."""

    device: DrivesEndpoint | None = Field(
        default=None,
        description="the device that has the contact: { tcp = … } or { rtu = … }",
        json_schema_extra=documented(
            kind="table",
            default="required",
            text=(
                "the device that has the contact: `tcp`, `rtu` or `rtu_over_tcp`, with the keys of "
                "[`drives`](#linename). It has an address or a serial port of its own: that of no line. "
                "In place of `device` and `coil` you can write `gpio`"
            ),
        ),
    )
    gpio: GpioLine | None = Field(
        default=None,
        description="the GPIO line that switches the contact: { chip = …, line = … }",
        json_schema_extra=documented(
            kind="table",
            text=(
                "in place of `device`, the GPIO line that switches the contact: "
                '`{ chip = "/dev/gpiochip0", line = 17, active_low = false }`. It needs '
                "`pip install 'pitch-gateway[gpio]'`, and has never run on a chip"
            ),
        ),
    )
    unit_id: Annotated[int, Field(ge=0, le=255)] = Field(
        default=1,
        description="Modbus unit id of the device",
        json_schema_extra=documented(more="0 only with `tcp`"),
    )
    coil: Address | None = Field(
        default=None,
        description="coil of the contact: 1 closes it",
        json_schema_extra=documented(default="required", more="Only with `device`"),
    )
    opens_on: Literal["error", "warning"] = Field(
        default="error",
        description="the lightest verdict that opens it",
        json_schema_extra=documented(
            text="the lightest [verdict](messages.md#troubles) that opens it: `error`, or also `warning`"
        ),
    )
    every_s: Annotated[float, Field(ge=0.1, le=60.0)] = Field(
        default=1.0,
        description="seconds between two writes; the watchdog of the device must wait longer",
        json_schema_extra=documented(
            text=(
                "seconds between two writes. Set the device's own watchdog to three times that, and at least "
                "to 3 s"
            )
        ),
    )

    @property
    def modbus(self) -> DrivesEndpoint:
        """The device, where the contact is no GPIO line."""
        assert self.device is not None, "a section has a device or a line"
        return self.device

    @model_validator(mode="after")
    def _one_contact(self) -> Self:
        rule = broken_contact_rule(self.model_fields_set)
        if rule:
            raise ValueError(rule)
        return self


def broken_contact_rule(keys: Collection[str]) -> str:
    """Return the rule about its keys that ``[alarm_output]`` breaks, "" for none; values are not checked.

    >>> broken_contact_rule({"gpio", "coil"})
    'coil belongs to device: leave out beside gpio'
    """
    if ("device" in keys) == ("gpio" in keys):
        return "allowed: exactly one of device, gpio"
    if "device" in keys:
        return "" if "coil" in keys else "needed: coil, the coil of the contact: 1 closes it"
    stray = [key for key in ("unit_id", "coil") if key in keys]
    verb = "belongs" if len(stray) == 1 else "belong"
    return f"{', '.join(stray)} {verb} to device: leave out beside gpio" if stray else ""


class CaptureSection(StrictModel):
    """How much of the recent frames is kept."""

    size_mb: Annotated[float, Field(ge=0, le=256)] = Field(
        default=4,
        description="memory for the last frames of each line, in MB; 0: none are kept",
        json_schema_extra=documented(
            text=(
                "memory for the last frames of each line, in MB; 0: none. An exchange takes about 130 "
                "bytes: 4 MB hold five minutes of a hundred exchanges a second. Needs a restart"
            ),
        ),
    )
    on: Live[ListOf[EventName]] = Field(
        default=(),
        description="events that write the frames before and after them into a file",
        json_schema_extra=documented(
            kind="list of events",
            text=(
                'events that save the frames around them, as in `["drive-silent", "axis-blocked"]`; '
                "`pitch-gateway explain` lists all. 2 s after the event, at most once a minute, the "
                "supervisor writes `capture-TIME-EVENT.jsonl` to the state folder"
            ),
        ),
    )
    keep: Live[Annotated[int, Field(ge=1, le=1000)]] = Field(
        default=8,
        description="so many files are kept; the oldest gives way",
        json_schema_extra=documented(text=("number of files kept; the oldest is deleted")),
    )

    @property
    def tape_bytes(self) -> int:
        """Bytes for each line."""
        return int(self.size_mb * 1_000_000)
