"""``thermal`` and ``cross`` of an axis: terms that are added to its table."""

from typing import Annotated, Final, Literal

from pydantic import BeforeValidator, Field

from gateway.compensation import settings
from gateway.config.mqtt_model import read_topic
from gateway.config.values import Length, Name, Tcp
from gateway.drives.strict import ByName, Live, Planned, StrictModel, documented
from gateway.drives.words import Address
from gateway.modbus.registers import RegisterType, WordOrder

LARGEST_ALPHA: Final = 1e-3
"""Ten times that of plastics."""
LONGEST_S: Final = 86_400.0
Celsius = Annotated[float, Field(ge=-100.0, le=300.0)]
Seconds = Annotated[float, Field(ge=1.0, le=LONGEST_S)]


class TemperatureSource(StrictModel):
    """Source of a screw's temperature."""

    mqtt: Annotated[str, BeforeValidator(read_topic)] | None = Field(
        default=None,
        description="topic of the broker of [mqtt] that carries it",
        json_schema_extra=documented(
            text=(
                "topic of the broker of `[mqtt]`. A message is a number in °C, or JSON with a number "
                "under `temperature`, `celsius` or `value`"
            ),
            kind="topic",
        ),
    )
    modbus: Tcp | None = Field(
        default=None,
        description="HOST:PORT of a Modbus TCP device that has it",
        json_schema_extra=documented(
            text=(
                "HOST:PORT of the Modbus TCP device. If the sensor is on a bus of drives, a monitor's "
                "address of the gateway itself"
            ),
        ),
    )
    unit_id: Annotated[int, Field(ge=0, le=255)] = Field(
        default=1, description="Modbus unit id of the device"
    )
    address: Address | None = Field(
        default=None,
        description="first register of the value",
        json_schema_extra=documented(default="required beside `modbus`"),
    )
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

    alpha: Planned[Annotated[float, Field(gt=0.0, le=LARGEST_ALPHA)]] = Field(
        description="expansion of the screw per kelvin, about 11.5e-6 for steel",
        json_schema_extra=documented(
            text=("expansion of the screw per kelvin: about `11.5e-6` for steel"),
            kind="per kelvin, 0 to 0.001",
        ),
    )
    reference: Planned[Celsius] = Field(
        default=20.0, description="temperature at which the table holds, in °C"
    )
    fixed_at: Planned[Length] = Field(
        default=0.0,
        description="machine position that stays where it is when the screw grows",
        json_schema_extra=documented(
            text=(
                "machine position of the fixed bearing, on the scale of `travel`: it stays in place when "
                "the screw grows. It may lie outside `travel`"
            )
        ),
    )
    source: Live[TemperatureSource] = Field(
        description="where the temperature is heard",
        json_schema_extra=documented(
            kind="table",
            text=(
                "where the temperature comes from: `{ mqtt = … }` or `{ modbus = …, address = … }`, see below"
            ),
        ),
    )
    timeout_s: Planned[Seconds] = Field(
        default=60.0, description="seconds without a temperature after which the sensor is silent"
    )
    hold_s: Planned[Annotated[float, Field(ge=0.0, le=LONGEST_S)]] = Field(
        default=600.0,
        description="seconds for which the last temperature is held after that",
        json_schema_extra=documented(
            text=(
                "time after `timeout_s` during which the last temperature is held; then the correction "
                "returns to 0 at `rate_per_min`"
            )
        ),
    )
    rate_per_min: Planned[Annotated[float, Field(gt=0.0, le=60.0)]] = Field(
        default=settings.DEFAULT_KELVIN_PER_MIN,
        description="kelvins per minute that are followed at most",
        json_schema_extra=documented(
            text=("limit on the rate of the correction, so that a jumping sensor does no harm")
        ),
    )
    largest_dt: Planned[Annotated[float, Field(gt=0.0, le=200.0)]] = Field(
        default=settings.DEFAULT_LARGEST_DT,
        description="kelvins from the reference beyond which a value is no temperature of the screw",
        json_schema_extra=documented(
            text=(
                "a value further from `reference` is no screw temperature: it is refused, reported, and "
                "counts as silence"
            )
        ),
    )


class CrossSpec(StrictModel):
    """How the position of another axis affects this one."""

    axis: Name = Field(description="the other axis, of this configuration")
    table: str = Field(
        description="table file: corrections of this axis over machine positions of the other one",
        json_schema_extra=documented(
            text=(
                "table file in the tables folder, of any format and one direction: corrections of this "
                "axis at machine positions of the other. Read with the configuration, not watched"
            ),
            kind="file name",
        ),
    )
    fresh_s: Seconds = Field(
        default=60.0,
        description="seconds for which the last position of the other axis counts when it is not known any "
        "more; as long again it fades",
        json_schema_extra=documented(
            text=(
                "seconds for which the last position of the other axis counts once it is unknown; it "
                "then fades for as long"
            )
        ),
    )
