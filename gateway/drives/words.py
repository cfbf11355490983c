"""Numbers that fit one Modbus register, and the addresses of registers."""

from typing import Annotated, Final

from pydantic import Field

LAST_ADDRESS: Final = 0xFFFF
LAST_BIT: Final = 15

Address = Annotated[int, Field(ge=0, le=LAST_ADDRESS)]
"""Address of a register as in the frame: counted from 0, not from 40001."""
Word = Annotated[int, Field(ge=0, le=0xFFFF)]
Bit = Annotated[int, Field(ge=0, le=LAST_BIT)]
