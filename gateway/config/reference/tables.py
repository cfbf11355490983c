"""The tables of the reference: which keys each one lists, and what it says about them."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from pydantic import BaseModel

from gateway.config.axis_model import AxisSection, GroupSection, TableOptions
from gateway.config.gateway_model import CaptureSection, GatewaySection, StatusUnitSection
from gateway.config.http_model import HttpSection
from gateway.config.line_model import ControllerSection, DrivesEndpoint, LineSection
from gateway.config.mqtt_model import MqttSection
from gateway.config.reference import axis_texts, line_texts, register_texts, service_texts
from gateway.config.reference.kinds import default_text, kind_text
from gateway.config.reference.text import Said, Texts
from gateway.config.relay_model import RelaySection
from gateway.config.rights_model import RoleKeys
from gateway.config.terms_model import CrossSpec, TemperatureSource, ThermalSpec
from gateway.config.tls_model import ControllerTls
from gateway.drives.registers import ActualSpec, BitSpec, CommandSpec, PositionSpec, RegisterMap
from gateway.drives.rules import ModeSpec, TriggerSpec


@dataclass(frozen=True, slots=True)
class KeyTable:
    """One table: the keys of ``models``, each once, without those that stand elsewhere."""

    models: tuple[type[BaseModel], ...]
    texts: Texts
    elsewhere: frozenset[str] = frozenset()
    """Keys of the same meaning in another table, which the text around this one points to."""

    def fields(self) -> Iterator[tuple[type[BaseModel], str]]:
        """Yield every key with the model that has it."""
        seen = set(self.elsewhere)
        for model in self.models:
            for key in model.model_fields:
                if key not in seen:
                    seen.add(key)
                    yield model, key


@dataclass(frozen=True, slots=True)
class Row:
    """A key, as the reference shows it."""

    key: str
    kind: str
    default: str
    meaning: str


_SERIAL: Final = frozenset({"baudrate", "parity", "stop_bits", "data_bits", "low_latency"})

TABLES: Final[Mapping[str, KeyTable]] = {
    "gateway": KeyTable((GatewaySection,), service_texts.GATEWAY),
    "relay": KeyTable((RelaySection,), service_texts.RELAY),
    "line": KeyTable((LineSection,), line_texts.LINE),
    "line.drives": KeyTable((DrivesEndpoint,), line_texts.DRIVES),
    "line.controllers": KeyTable((ControllerSection,), line_texts.CONTROLLERS, _SERIAL),
    "line.controllers.tls": KeyTable((ControllerTls,), line_texts.TLS),
    "line.controllers.roles": KeyTable((RoleKeys,), line_texts.ROLES),
    "axis": KeyTable((AxisSection,), axis_texts.AXIS),
    "axis.table_options": KeyTable((TableOptions,), axis_texts.TABLE_OPTIONS),
    "axis.thermal": KeyTable((ThermalSpec,), axis_texts.THERMAL),
    "axis.thermal.source": KeyTable((TemperatureSource,), axis_texts.SOURCE),
    "axis.cross": KeyTable((CrossSpec,), axis_texts.CROSS),
    "axis.registers": KeyTable((RegisterMap,), register_texts.REGISTERS),
    "axis.registers.position": KeyTable((PositionSpec, ActualSpec, CommandSpec), register_texts.POSITION),
    "axis.registers.bit": KeyTable((BitSpec,), register_texts.BIT),
    "axis.registers.mode": KeyTable((ModeSpec,), register_texts.MODE),
    "axis.registers.trigger": KeyTable(
        (TriggerSpec,), register_texts.TRIGGER, frozenset(ModeSpec.model_fields) - {"address", "mask"}
    ),
    "http": KeyTable((HttpSection,), service_texts.HTTP),
    "mqtt": KeyTable((MqttSection,), service_texts.MQTT),
    "status_unit": KeyTable((StatusUnitSection,), service_texts.STATUS_UNIT),
    "capture": KeyTable((CaptureSection,), service_texts.CAPTURE),
    "group": KeyTable((GroupSection,), service_texts.GROUP),
}
"""By the name of their markers in the document."""


def rows(table: KeyTable) -> list[Row]:
    """Return what a table lists."""
    found = []
    for model, key in table.fields():
        field, said = model.model_fields[key], table.texts.get(key, Said())
        found.append(
            Row(
                key,
                said.kind or kind_text(model, key),
                said.default or default_text(field),
                said.meaning or ". ".join(filter(None, (field.description, said.more))),
            )
        )
    return found
