"""One simulated drive of a known make on the bench, talked to in hexadecimal PDUs, with its own clock."""

import tomllib
from pathlib import Path

from gateway.simulator.bus import DriveBus
from gateway.simulator.drives.catalogue import DRIVES
from gateway.simulator.drives.motor_drive import Motor, MotorDrive
from gateway.simulator.ledger import MoveKind
from gateway.simulator.mechanics import Encoder, Mechanics
from gateway.simulator.motion import Dynamics
from gateway.simulator.screw import Screw

ABSOLUTE, RELATIVE, HOME, STOP, SET_POSITION, OTHER = (
    MoveKind.ABSOLUTE,
    MoveKind.RELATIVE,
    MoveKind.HOME,
    MoveKind.STOP,
    MoveKind.SET_POSITION,
    MoveKind.OTHER,
)
Moves = list[tuple[MoveKind, int | None]]
LONG_S = 60.0
"""By then every move and every homing of a test has ended."""
GOLDEN_FRAMES = {
    frame["name"]: frame
    for frame in tomllib.loads(
        (Path(__file__).parents[1] / "data" / "golden_frames.toml").read_text("utf-8")
    )["frame"]
}


def motor(name: str = "x") -> Motor:
    """1000 counts per mm, 100 mm/s reached in 0.1 s: 10 000 counts take 0.2 s and are half done at 0.1 s."""
    return Motor(name, Mechanics(Screw(), Encoder(1000.0), dynamics=Dynamics(100.0, 1000.0)))


class Drive:
    """A drive, its clock and what it did."""

    def __init__(self, name: str, unit_id: int = 1, axes: int = 1) -> None:
        self.unit: MotorDrive = DRIVES[name](unit_id, [motor(axis) for axis in "xy"[:axes]])
        self.bus = DriveBus([self.unit])
        self.motor = self.unit.motor
        self.now_s = 0.0

    def ask(self, request: str) -> str:
        """Send a PDU; the reply comes back in the same notation, "" where there is none."""
        reply = self.bus.answer(self.unit.unit_id, bytes.fromhex(request), self.now_s)
        return "" if reply is None else spaced(reply)

    def does(self, *requests: str) -> None:
        """Send writes, each of which must be answered as Modbus says."""
        for request in requests:
            pdu = bytes.fromhex(request)
            expected = pdu[:5] if pdu[0] in (15, 16) else pdu
            assert self.ask(request) == spaced(expected), request

    def finishes(self, *requests: str) -> None:
        """The same, and let every motion end."""
        self.does(*requests)
        self.wait()

    def read(self, address: int, count: int = 1, function: int = 3) -> list[int]:
        """Read registers."""
        request = bytes((function,)) + address.to_bytes(2) + count.to_bytes(2)
        reply = self.bus.answer(self.unit.unit_id, request, self.now_s)
        assert reply is not None
        assert reply[:2] == bytes((function, 2 * count)), reply.hex(" ")
        return [int.from_bytes(reply[i : i + 2]) for i in range(2, len(reply), 2)]

    def bit(self, address: int, bit: int) -> bool:
        """Read one bit of a register."""
        return bool(self.read(address)[0] >> bit & 1)

    def input(self, address: int, function: int = 2) -> bool:
        """Read one discrete input (or coil)."""
        return self.ask(f"{function:02x} {address:04x} 0001").endswith("01")

    def high(self, address: int) -> int:
        """Read a signed number with the high word first."""
        return signed(*self.read(address, 2))

    def low(self, address: int) -> int:
        """Read a signed number with the low word first."""
        return signed(*reversed(self.read(address, 2)))

    def wait(self, seconds: float = LONG_S) -> None:
        """Let time pass."""
        self.now_s += seconds
        self.unit.refresh(self.now_s)

    @property
    def moves(self) -> Moves:
        """What the drive was made to do, with targets in counts; it is forgotten."""
        moves = self.bus.ledger.moves_of(self.unit.unit_id)
        self.bus.ledger.moves.clear()
        return moves


READY = {
    "iai-robo-cylinder": ["05 0403 FF00"],
    "smc-lec": ["05 0030 FF00", "05 0019 FF00"],
    "oriental-az": ["10 007C 0002 04 0000 0001"],
    "oriental-blv-r": ["10 007C 0002 04 0000 0001"],
    "kinco-fd": ["06 3500 0001", "06 3100 000F"],
    "mitsubishi-mr-je-c": [
        "10 6060 0001 02 0001",
        *(f"10 6040 0001 02 {word}" for word in ("0006", "0007", "000F")),
    ],
}
"""Frames after which a drive has its power on, where it needs some."""


def ready(name: str) -> Drive:
    """Return a drive that can be moved."""
    drive = Drive(name, unit_id=255 if name == "mitsubishi-mr-je-c" else 1)
    drive.does(*READY.get(name, ()))
    return drive


def signed(high: int, low: int) -> int:
    """Return the signed number of two words."""
    value = high << 16 | low
    return value - (1 << 32) if value >> 31 else value


def spaced(pdu: bytes) -> str:
    """Write a PDU as the tests do: the function code, then words."""
    return pdu.hex(" ").upper()
