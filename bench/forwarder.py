"""A Modbus TCP forwarder on pymodbus, as its documentation suggests: run with the bench's own environment.

    python forwarder.py LISTEN_PORT DRIVE_PORT

A device whose ``action`` is called for every access asks the drive through an ``AsyncModbusTcpClient``: what
was read goes into the device's registers, what is written is passed on before it counts.
"""

import asyncio
import sys
from typing import Final

from pymodbus.client import AsyncModbusTcpClient
from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

UNIT_ID: Final = 1
REGISTERS: Final = 1024
READ_HOLDING: Final = 3
HOST: Final = "127.0.0.1"


async def forward(listen_port: int, drive_port: int) -> None:
    """Serve until it is stopped."""
    drive = AsyncModbusTcpClient(HOST, port=drive_port)
    await drive.connect()

    async def action(  # noqa: PLR0917 - pymodbus calls it so
        function_code: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        if function_code == READ_HOLDING:
            answer = await drive.read_holding_registers(address, count=count, device_id=UNIT_ID)
            if not answer.isError():
                registers[address - start : address - start + count] = answer.registers
        else:
            answer = await drive.write_registers(address, [int(v) for v in values or ()], device_id=UNIT_ID)
        return ExcCodes.DEVICE_FAILURE if answer.isError() else None

    device = SimDevice(
        UNIT_ID, SimData(0, count=REGISTERS, values=0, datatype=DataType.REGISTERS), action=action
    )
    await ModbusTcpServer(device, address=(HOST, listen_port)).serve_forever()


if __name__ == "__main__":
    asyncio.run(forward(int(sys.argv[1]), int(sys.argv[2])))
