"""``thermal`` and ``cross`` of an axis: what is added to its table."""

from typing import Annotated, Final, Literal

from pydantic import BeforeValidator, Field

from gateway.compensation import settings
from gateway.config.mqtt_model import read_topic
from gateway.config.values import Length, Name, Tcp
from gateway.drives.strict import ByName, StrictModel
from gateway.drives.words import Address
from gateway.modbus.registers import RegisterType, WordOrder

LARGEST_ALPHA: Final = 1e-3
"""Ten times that of plastics."""
LONGEST_S: Final = 86_400.0
Celsius = Annotated[float, Field(ge=-100.0, le=300.0)]
Seconds = Annotated[float, Field(ge=1.0, le=LONGEST_S)]


class TemperatureSource(StrictModel):
    """Where the temperature of a screw is heard."""

    mqtt: Annotated[str, BeforeValidator(read_topic)] | None = Field(
        default=None, description="topic of the broker of [mqtt] that carries it"
    )
    modbus: Tcp | None = Field(default=None, description="HOST:PORT of a Modbus TCP device that has it")
    unit_id: Annotated[int, Field(ge=0, le=255)] = Field(
        default=1, description="Modbus unit id of the device"
    )
    address: Address | None = Field(default=None, description="first register of the value")
    function: Literal[3, 4] = Field(
        default=3, description="3 reads holding registers, 4 reads input registers"
    )
    type: ByName[RegisterType] = Field(default=RegisterType.INT16, description="how the value is stored")
    words: ByName[WordOrder] = Field(
        default=WordOrder.HIGH_FIRST, description="which word of a longer value comes first"
    )
    scale: Annotated[float, Field(gt=0.0, le=1000.0)] = Field(
        default=1.0, description="degrees Celsius in one step of the value"
    )
    every_s: Annotated[float, Field(ge=0.5, le=3600.0)] = Field(
        default=5.0, description="seconds between two readings"
    )


class ThermalSpec(StrictModel):
    """How the length of the screw follows its temperature."""

    alpha: Annotated[float, Field(gt=0.0, le=LARGEST_ALPHA)] = Field(
        description="expansion of the screw per kelvin, about 11.5e-6 for steel"
    )
    reference: Celsius = Field(default=20.0, description="temperature at which the table holds, in °C")
    fixed_at: Length = Field(
        default=0.0, description="machine position that stays where it is when the screw grows"
    )
    source: TemperatureSource = Field(description="where the temperature is heard")
    timeout_s: Seconds = Field(
        default=60.0, description="seconds without a temperature after which the sensor is silent"
    )
    hold_s: Annotated[float, Field(ge=0.0, le=LONGEST_S)] = Field(
        default=600.0, description="seconds for which the last temperature is held after that"
    )
    rate_per_min: Annotated[float, Field(gt=0.0, le=60.0)] = Field(
        default=settings.DEFAULT_KELVIN_PER_MIN,
        description="kelvins per minute that are followed at most",
    )
    largest_dt: Annotated[float, Field(gt=0.0, le=200.0)] = Field(
        default=settings.DEFAULT_LARGEST_DT,
        description="kelvins from the reference beyond which a value is no temperature of the screw",
    )


class CrossSpec(StrictModel):
    """What the position of another axis does to this one."""

    axis: Name = Field(description="the other axis, of this configuration")
    table: str = Field(
        description="table file: corrections of this axis over machine positions of the other one"
    )
    fresh_s: Seconds = Field(
        default=60.0,
        description="seconds for which the last position of the other axis counts when it is not known any "
        "more; as long again it fades",
    )
