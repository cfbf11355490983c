"""The complete model: the gateway, its lines and axes, the supervisor, and the alarms."""

from collections.abc import Mapping
from typing import Annotated, Any, Final

from msgspec import UNSET, Struct, UnsetType, field, to_builtins

from gateway.plain import JsonObject
from gateway.status.axis import AxisStatus, WholeAxis, WriterConflictStatus
from gateway.status.counters import Counter, counters_of
from gateway.status.line import (
    LINE_COUNTERS,
    CertificateStatus,
    ControllerStatus,
    CutThroughStatus,
    DrivesStatus,
    Forwarded,
    LineStatus,
    TlsStatus,
    UnitStatus,
)


class Scheduling(Struct, frozen=True, kw_only=True):
    """The kernel's scheduling of the relay's thread; ``fifo`` 0: normal."""

    fifo: int = 0
    cpus: list[int] = []
    memory_locked: bool = False


class Garbage(Struct, frozen=True, kw_only=True):
    """Collections of garbage."""

    collections: int = 0
    full: int = 0
    forced: int = 0
    collected: int = 0
    longest_us: int = 0


class Loop(Struct, frozen=True, kw_only=True):
    """The longest step of the relay's loop."""

    longest_us: float = 0.0
    longest: str | None = None


class GatewayStatus(Struct, kw_only=True):
    """The gateway itself. Fields from the relay are UNSET until it was reached."""

    name: str = ""
    version: str = ""
    compiled: bool | UnsetType = UNSET
    uptime_s: float | None = None
    relay: str = ""
    snapshot_age_s: float | None = None
    scheduling: Scheduling | UnsetType = UNSET
    garbage: Garbage | UnsetType = UNSET
    loop: Loop | UnsetType = UNSET
    latency_bounds_us: list[int] | UnsetType = UNSET


class ConfigurationStatus(Struct, frozen=True, kw_only=True):
    """The configuration file."""

    file: str = ""
    problem: str | None = None


class FolderStatus(Struct, frozen=True, kw_only=True):
    """A folder that the supervisor watches."""

    folder: str = ""
    problem: str | None = None


class HttpStatus(Struct, frozen=True, kw_only=True):
    """The page."""

    listen: str = ""
    address: str | None = None
    problem: str | None = None
    certificates: list[CertificateStatus] = []


class MqttStatus(Struct, frozen=True, kw_only=True):
    """MQTT; the state is ``off`` without an MQTT configuration."""

    problem: str | None = None
    state: str = "off"
    broker: str | None = None
    connects: Annotated[int, Counter("connects", "connections to the MQTT broker since the start")] = 0
    published: Annotated[int, Counter("published", "messages to the MQTT broker since the start")] = 0
    dropped_events: Annotated[
        int,
        Counter(
            "dropped events",
            "events not published over MQTT, because the broker was away too long",
            "check the broker; the log has these events",
        ),
    ] = 0


class AlarmOutputStatus(Struct, frozen=True, kw_only=True):
    """The contact that opens when something is wrong."""

    contact: str | None = None
    """Address of the device, unit id and coil; None: there is none."""
    is_closed: bool | None = None
    """As the device last acknowledged; None: it has not."""
    problem: str | None = None


class JournalStatus(Struct, frozen=True, kw_only=True):
    """The newest entry of the journal of interventions; None: none yet."""

    seq: int | None = None
    digest: str | None = None


class SupervisorStatus(Struct, frozen=True, kw_only=True):
    """The supervisor's own status; a ``problem`` is None if all is well."""

    configuration: ConfigurationStatus = ConfigurationStatus()
    tables_folder: FolderStatus = FolderStatus()
    state_folder: FolderStatus = FolderStatus()
    http: HttpStatus = HttpStatus()
    mqtt: MqttStatus = MqttStatus()
    alarm_output: AlarmOutputStatus = AlarmOutputStatus()
    journal: JournalStatus = JournalStatus()


class AcknowledgedBy(Struct, frozen=True, kw_only=True):
    """Who has seen an alarm, and when."""

    by: str = ""
    at: str = ""


class AlarmStatus(Struct, frozen=True, kw_only=True):
    """An active alarm."""

    kind: str = ""
    severity: str = ""
    audience: str = "operator"
    """The same for all: a filter by it shows every alarm."""
    where: str = ""
    what: str = ""
    says: Any = None
    """The same as template and values (``catalogue.text``)."""
    remedy: str = ""
    since: str = ""
    axes: list[str] = []
    acknowledged: AcknowledgedBy | None = None


class Verdict(Struct, frozen=True, kw_only=True):
    """The overall state of the gateway."""

    state: str = ""
    since: str = ""
    errors: int = 0
    warnings: int = 0


class RelayModel(Struct, kw_only=True):
    """The relay's part of the model."""

    gateway: GatewayStatus = field(default_factory=GatewayStatus)
    lines: dict[str, LineStatus] = {}
    axes: dict[str, AxisStatus] = {}


class Model(Struct, kw_only=True):
    """The status model: the relay's part, with the additions of the supervisor."""

    gateway: GatewayStatus = field(default_factory=GatewayStatus)
    lines: dict[str, LineStatus] = {}
    axes: dict[str, WholeAxis] = {}
    supervisor: SupervisorStatus | None = None
    """None: there is no supervisor."""
    troubles: list[AlarmStatus] = []
    verdict: Verdict = Verdict()
    """Empty from an older release."""

    def as_data(self) -> JsonObject:
        """Return it as plain data."""
        data: dict[str, Any] = to_builtins(self)
        return data


_PARTS: Final = (
    UnitStatus,
    ControllerStatus,
    TlsStatus,
    DrivesStatus,
    WriterConflictStatus,
    Forwarded,
    CutThroughStatus,
    MqttStatus,
)
COUNTERS: Final[Mapping[str, Counter]] = {
    **LINE_COUNTERS,
    **{name: each for part in _PARTS for name, each in counters_of(part).items()},
}
"""Every counter, by its key in the status."""
