"""The options of ``pitch-gateway init``."""

from pathlib import Path
from typing import Annotated

import typer

Option = typer.Option

TargetFile = Annotated[Path, typer.Argument(metavar="FILE", help="The file to write.")]
CompensationOff = Annotated[
    bool,
    Option(
        "--controller-compensation-off", help="The controller's own pitch and backlash compensation are off."
    ),
]
Drive = Annotated[str | None, Option(help="A profile of `pitch-gateway drives`, or a file.")]
DrivesAt = Annotated[
    str | None,
    Option(help="Where the drives are: /dev/…, HOST:PORT, or rtu://HOST:PORT for raw RTU over TCP."),
]
ControllerAt = Annotated[
    str | None, Option(help="Where the controller connects: /dev/…, or HOST:PORT to listen on.")
]
Name = Annotated[str | None, Option(help="Of this gateway; default: the name of this computer.")]
Baudrate = Annotated[int | None, Option(help="Of the drives' serial port; default: the drive's.")]
Parity = Annotated[str | None, Option(help="none, even or odd; default: the drive's.")]
StopBits = Annotated[int | None, Option(help="1 or 2; default: the drive's.")]
ControllerBaudrate = Annotated[
    int | None, Option(help="Of the controller's serial port; default: as the drives' is.")
]
ControllerParity = Annotated[str | None, Option(help="The same; default: as the drives' is.")]
ControllerStopBits = Annotated[int | None, Option(help="The same; default: as the drives' is.")]
Axis = Annotated[str, Option(help="Name of the axis.")]
UnitId = Annotated[int | None, Option(min=0, max=255, help="Modbus unit id of the drive.")]
AxisUnits = Annotated[str | None, Option(help="mm, inch or degree.")]
Counts = Annotated[
    float | None, Option(help="Counts of the drive in one unit; negative where it counts down.")
]
Travel = Annotated[tuple[float, float] | None, Option(help="Lowest and highest machine position.")]
Table = Annotated[str | None, Option(help="Name of the table file in the tables folder.")]
Referenced = Annotated[str | None, Option(help="absolute, drive-bit, homing or set-position.")]
HomeApproach = Annotated[str | None, Option(help="none, forward or backward.")]
Measure = Annotated[
    bool | None,
    Option(
        "--measure/--no-measure",
        help="Measure how long the drives take, and write the time-outs; default: ask, where they are there.",
    ),
]
Scan = Annotated[
    bool,
    Option(
        "--scan",
        help="Look for baud rate, parity and unit ids on a silent serial line; reads only, and asks first.",
    ),
]
Ask = Annotated[
    bool | None, Option("--ask/--no-ask", help="Ask for what is missing; default: on a terminal.")
]
Force = Annotated[bool, Option("--force", help="Overwrite FILE.")]
Systemd = Annotated[
    Path | None,
    Option(metavar="DIR", help="Fit systemd's units below DIR to it too; see `pitch-gateway service`."),
]
AsJson = Annotated[bool, Option("--json", help="Say what is left to do as JSON.")]
