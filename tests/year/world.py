"""A machine with its gateway, whole: the process of the relay again and again, until the time is over."""

import gc
import hashlib
import os
import random
import signal
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from gateway.compensation.settings import Setpoints
from gateway.exchange.plan import AxisPlan, ControllerPlan, Late, LineTiming, Reference, Role
from gateway.ipc.log import LogEntry
from gateway.relay.errors import StartError
from gateway.relay.run import run_relay
from gateway.state.folder import StateError
from gateway.state.plan import ControllerLink, GatewayPlan, LinePlan, read_plan
from gateway.transport.endpoints import SerialEndpoint, TcpEndpoint
from tests.ledger.drives import Drive
from tests.ledger.frames import open_mbap, open_rtu
from tests.ledger.layouts import Layout, Style, axis_plan
from tests.ledger.screws import Screw, random_screw
from tests.year import stores
from tests.year.account import Account, Axis, Book, FindingError, Line
from tests.year.disk import WRITTEN_BACK_S, Disk
from tests.year.faults import Faults
from tests.year.field import (
    PATIENCE_MS,
    TIMEOUT_MS,
    Bus,
    Manner,
    SerialController,
    SerialDrives,
    Site,
    TcpController,
    TcpDrives,
    make_drive,
    program,
)
from tests.year.groups import Group
from tests.year.homing import HomedDrive, with_homing
from tests.year.loop import LogAtOnce, SimulatedLoop
from tests.year.machine import MS, KilledError, S, SpinningError
from tests.year.network import Address, Network, Peer
from tests.year.serial_ports import Wire, exchange
from tests.year.supervisor import TABLES, Supervisor, table_name
from tests.year.system import MACHINE

DRIVES: Final = SerialEndpoint("/dev/drives", 115200, "E")
CNC: Final = SerialEndpoint("/dev/cnc", 115200, "E")
Z_DRIVES: Final = TcpEndpoint("10.0.0.20", 502)
HMI_PORT, PLC_PORT, PANEL_PORT = 1502, 1503, 1504
XY: Final = (
    Layout("x", 1, Style.DIRECT, low_first=True),
    Layout("y", 2, Style.PLAIN, counts_per_unit=-1000.0, zero_counts=3_000),
)
Z: Final = (
    Layout("z", 1, Style.TRIGGERED),
    Layout("w", 2, Style.DIRECT, counts_per_unit=-1250.0, zero_counts=-70_000),
)
BEAM: Final = (Z[0], Layout("w", 2, Style.TRIGGERED, counts_per_unit=-1250.0, zero_counts=-70_000))
ZW: Final = (Layout("z", 1, Style.PLAIN), *Z[1:])


class Job(NamedTuple):
    """What a line is for: its axes, and how their controller works."""

    layouts: tuple[Layout, ...]
    manner: Manner
    references: tuple[Reference, ...] = ()
    """Of its axes, if their drives have to be homed."""


HOMED: Final = Job(BEAM, Manner.SEQUENCE, (Reference.DRIVE_BIT, Reference.HOMING))
XY_JOBS: Final = (Job(XY, Manner.STREAM), Job(XY, Manner.SETPOINTS), Job(XY, Manner.BEAM))
Z_JOBS: Final = (Job(Z, Manner.SEQUENCE), Job(ZW, Manner.SETPOINTS), Job(BEAM, Manner.BEAM), HOMED)
"""A machine has one of each."""
TOO_OLD_MS: Final = 200.0
"""Age at which a setpoint of a stream is refused."""
STARTS_NS: Final = S
"""After its end the service manager starts the process again (RestartSec)."""
CUT_THROUGH: Final = 0.25
"""Share of the machines whose serial line cuts through (W12)."""
STOPS_NS: Final = 10 * S
"""A stop that takes longer hangs."""
SPEC: Final = "simulated"


class World:
    """One machine, made from a seed; ``folder`` is empty and has the state."""

    def __init__(self, seed: int, folder: Path, level: str, without: Collection[str] = ()) -> None:
        rng = random.Random(f"{seed} world")
        MACHINE.random.seed(f"{seed} machine")
        stores.install()
        self.book = Book(MACHINE)
        self.faults = Faults(seed, level, without)
        self._network = Network(MACHINE, random.Random(f"{seed} network"), self._tell_tcp)
        self._disk = Disk(folder)
        self._is_over = self._are_others = False
        jobs = random.Random(f"{seed} jobs")
        self._xy_job, self._z_job = jobs.choice(XY_JOBS), jobs.choice(Z_JOBS)
        layouts = (*self._xy_job.layouts, *self._z_job.layouts)
        screws = {layout.name: [random_screw(rng) for _ in range(TABLES)] for layout in layouts}
        self.xy = Line("xy", _axes(self._xy_job, rng), open_rtu)
        self.z = Line("z", _axes(self._z_job, rng), lambda data: open_mbap(data)[1:])
        self.xy.may_abort = random.Random(f"{seed} cut-through").random() < CUT_THROUGH
        self.account = Account(MACHINE, self.book, {"xy": self.xy, "z": self.z})
        self._supervisor = Supervisor(
            MACHINE, self.account, self._disk, screws, random.Random(f"{seed} supervisor")
        )
        self._drives_wire = self._wire(seed, DRIVES)
        self._cnc_wire = self._wire(seed, CNC)
        self._buses = {
            line.name: Bus(
                MACHINE,
                self.account,
                line,
                random.Random(f"{seed} {line.name}"),
                self.faults.share(line.name),
                is_tcp=line is self.z,
            )
            for line in (self.xy, self.z)
        }
        SerialDrives(self._buses["xy"], self._drives_wire, random.Random(f"{seed} damage"))
        self._network.servers[Z_DRIVES.host, Z_DRIVES.port] = self._z_server
        self._begin_controllers(seed)
        plan = _plan(screws, self._xy_job, self._z_job, cut_through=self.xy.may_abort)
        self._supervisor.begin(plan)
        self._later(random.Random(f"{seed} disk"), WRITTEN_BACK_S, self._disk.write_back)
        self.faults.arrange(MACHINE, self._troubles())

    def run(self, until_ns: int) -> None:
        """Run until an instant; what is wrong is in the book."""
        MACHINE.at(until_ns, self._end)
        try:
            while not self._is_over:
                self._run_process()
                if self.book.finding:
                    break  # raised where something else ended the process
                if not self._is_over:
                    MACHINE.run_until(MACHINE.now_ns + STARTS_NS)
        except (FindingError, SpinningError) as error:
            self.book.finding = self.book.finding or f"{type(error).__name__} at {MACHINE.now_ns / S:.6f} s"
        for name, content in sorted(self._disk.content().items()):
            self.book.note(f"file {name}", hashlib.sha256(content).digest())

    # --- the process

    def _run_process(self) -> None:
        before = _open_descriptors()
        MACHINE.begin_process()
        self.account.began()
        self.book.note("process begins")
        self.book.seen["processes"] += 1
        try:
            compiled = read_plan(self._disk.folder, Path(SPEC), is_compared=False)
            run_relay(
                compiled.plan,
                self._take,
                state=self._disk.folder,
                shape=compiled.shape,
                make_loop=partial(SimulatedLoop, self._network),
                make_log=LogAtOnce,
            )
        except KilledError:
            self._trouble("process was killed")
        except (StartError, StateError) as error:
            self.book.find("does-not-start", str(error))
        finally:
            MACHINE.end_process()
            self._supervisor.hang_up()
            _forget(before)

    def _take(self, entry: LogEntry) -> None:
        if not MACHINE.is_dead:
            detail = str(entry.fields.get("detail", "")).replace(str(self._disk.folder), "state")
            self.book.note(f"event {entry.event}", detail.encode())
            self.account.event(entry.event, entry.fields)

    def _end(self) -> None:
        self._is_over = True
        self._supervisor.hang_up()
        MACHINE.signal(signal.SIGTERM)
        MACHINE.after(STOPS_NS, self.book.find, "does-not-stop", f"after {STOPS_NS // S} s")

    # --- what it sends

    def _tell_tcp(self, _what: str, address: Address, data: bytes) -> None:
        if address == (Z_DRIVES.host, Z_DRIVES.port):
            self.account.left(self.z, data, MACHINE.now_ns)

    def _tell_serial(self, device: str, data: bytes) -> None:
        if device == DRIVES.device:
            self.account.left(self.xy, data, self._drives_wire.began_ns)
        else:
            self.book.note(device, data)

    # --- what is around it

    def _wire(self, seed: int, endpoint: SerialEndpoint) -> Wire:
        wire = Wire(MACHINE, endpoint, random.Random(f"{seed} {endpoint.device}"), self._tell_serial)
        wire.is_fine = self.xy.may_abort
        wire.splits = 0.0 if wire.is_fine else 0.05
        return wire

    def _z_server(self) -> Peer | None:
        bus = self._buses["z"]
        return None if bus.is_silent else TcpDrives(bus)

    def _begin_controllers(self, seed: int) -> None:
        cnc = SerialController(self._site(seed, "cnc", self.xy, self._xy_job.manner))
        cnc.over(self._cnc_wire)
        hmi = TcpController(self._site(seed, "hmi", self.xy, Manner.WATCH))
        hmi.over(self._network, "10.0.0.30", HMI_PORT, hangs_up=False)
        plc = TcpController(self._site(seed, "plc", self.z, self._z_job.manner))
        plc.over(self._network, "10.0.0.31", PLC_PORT, hangs_up=True)
        panel = TcpController(self._site(seed, "panel", self.z, Manner.WATCH))
        panel.over(self._network, "10.0.0.30", PANEL_PORT, hangs_up=False)
        for number, controller in enumerate((cnc, hmi, plc, panel)):
            MACHINE.after((2_000 + 37 * number) * MS, controller.begin)

    def _site(self, seed: int, name: str, line: Line, manner: Manner) -> Site:
        rng = random.Random(f"{seed} {name}")
        programs = partial(program, manner, list(line.axes.values()), MACHINE, rng)
        return Site(name, MACHINE, self.account, line, programs)

    def _later(self, rng: random.Random, between_s: tuple[float, float], what: Callable[[], None]) -> None:
        def again() -> None:
            what()
            self._later(rng, between_s, what)

        MACHINE.after(int(rng.uniform(*between_s) * S), again)

    # --- faults

    def _troubles(self) -> dict[str, Callable[[random.Random], bool]]:
        return {
            "reset": self._reset,
            "stall": self._stall,
            "unplug": self._unplug,
            "swap-adapters": self._swap_adapters,
            "other-drives": self._answer_by_others,
            "drive-off": self._drive_off,
            "reboot": self._reboot,
            "zero-shift": self._shift_zero,
            "halt": self._halt,
            "kill": self._kill,
            "kill-at-write": self._kill_at_write,
            "kill-at-store": self._kill_at_store,
            "power-cut-at-store": self._power_cut_at_store,
            "restart": self._restart,
            "power-cut": self._power_cut,
            "clock-step": self._step_clock,
            "slow-store": self._slow_store,
            "disk-full": self._fill_disk,
        }

    def _trouble(self, what: str, lasts_ns: int = 0) -> None:
        self.book.note(f"fault {what}", f"{lasts_ns / S:.3f} s".encode())
        for line in (self.xy, self.z):
            self.account.trouble(line, lasts_ns)

    def _reset(self, rng: random.Random) -> bool:
        streams = self._network.streams
        if not streams:
            return False
        self._trouble("reset")
        peer = rng.choice(streams).peer
        if peer is not None:
            peer.close(is_reset=True)
            peer.closed()
        return True

    def _stall(self, rng: random.Random) -> bool:
        streams = self._network.streams
        if not streams:
            return False
        ns = int(rng.choice((0.1, 0.4, 2.0, 20.0)) * rng.uniform(0.5, 1.5) * S)
        self._trouble("stall", ns)
        rng.choice(streams).stall(ns)
        return True

    def _unplug(self, rng: random.Random) -> bool:
        wire = rng.choice((self._drives_wire, self._cnc_wire))
        if not wire.is_plugged:
            return False
        ns = int(rng.choice((0.05, 1.0, 30.0)) * rng.uniform(0.5, 1.5) * S)
        self._trouble("unplug", ns)
        wire.plug(is_plugged=False)
        MACHINE.after(ns, partial(wire.plug, is_plugged=True))
        return True

    def _swap_adapters(self, rng: random.Random) -> bool:
        """Both adapters vanish, and come back by the name of the other one, for a while."""
        wires = self._drives_wire, self._cnc_wire
        if self.xy.is_swapped or not all(wire.is_plugged for wire in wires):
            return False
        ns = int(rng.uniform(5.0, 60.0) * S)
        self._trouble("swap-adapters", ns)
        self.xy.is_swapped = True
        heard = self._cnc_wire.heard
        self._cnc_wire.heard = lambda _data: None  # no reply to the controller: what the gateway asks drives
        self._change_names()
        MACHINE.after(ns, self._change_names)
        MACHINE.after(ns, setattr, self._cnc_wire, "heard", heard)
        MACHINE.after(ns, setattr, self.xy, "is_swapped", False)
        return True

    def _change_names(self) -> None:
        for wire in (self._drives_wire, self._cnc_wire):
            wire.plug(is_plugged=False)
            MACHINE.after(S, partial(wire.plug, is_plugged=True))
        exchange(self._drives_wire, self._cnc_wire)

    def _answer_by_others(self, rng: random.Random) -> bool:
        """Behind the address of the drives there are others of the same kind, for a while."""
        if self._are_others:
            return False
        ns = int(rng.uniform(5.0, 60.0) * S)
        self._trouble("other-drives", ns)
        self._are_others = True
        own = {axis: axis.drive for axis in self.z.axes.values()}
        for axis in own:
            is_homed = isinstance(axis.drive, HomedDrive)
            self._replace_drive(axis, make_drive(axis.layout, MACHINE, rng, is_homed=is_homed))
        for axis, drive in own.items():
            MACHINE.after(ns, self._replace_drive, axis, drive)
        MACHINE.after(ns, setattr, self, "_are_others", False)
        return True

    def _replace_drive(self, axis: Axis, drive: Drive) -> None:
        for stream in list(self._network.streams):
            if isinstance(stream.peer, TcpDrives):
                stream.peer.close(is_reset=True)
        axis.drive = drive
        axis.move_unseen()
        self._trouble(f"other drive of {axis.name}")

    def _drive_off(self, rng: random.Random) -> bool:
        bus = rng.choice(tuple(self._buses.values()))
        if bus.is_silent:
            return False
        ns = int(rng.choice((0.3, 3.0, 30.0)) * rng.uniform(0.5, 1.5) * S)
        self._trouble("drive-off", ns)
        bus.is_silent = True
        MACHINE.after(ns, setattr, bus, "is_silent", False)
        return True

    def _reboot(self, rng: random.Random) -> bool:
        """A drive reboots: it stops, and if it has to be homed it counts from anywhere."""
        bus = rng.choice(tuple(self._buses.values()))
        axis = rng.choice(tuple(bus.axes.values()))
        if axis.layout.unit in bus.silent_units:
            return False
        ns = int(rng.choice((0.05, 0.5, 5.0)) * rng.uniform(0.5, 1.5) * S)
        self._trouble(f"reboot {axis.name}", ns)
        bus.silent_units.add(axis.layout.unit)
        MACHINE.after(ns, bus.silent_units.discard, axis.layout.unit)
        axis.drive.motor.go(axis.drive.motor.at(MACHINE.now_ns), MACHINE.now_ns)
        if isinstance(axis.drive, HomedDrive):
            axis.drive.reboot(rng)
        axis.move_unseen()
        return True

    def _shift_zero(self, rng: random.Random) -> bool:
        """A drive counts from another zero, and says nothing."""
        axis = rng.choice(tuple(self.z.axes.values()))
        if not isinstance(axis.drive, HomedDrive):
            return False
        self._trouble(f"zero-shift {axis.name}")
        axis.shifts(rng.choice((300, 8_000_000, 8_000_000)) * rng.choice((-1, 1)))
        return True

    def _halt(self, rng: random.Random) -> bool:
        if MACHINE.is_dead:
            return False
        ns = int(rng.choice((0.01, 0.1, 0.8, 4.0)) * rng.uniform(0.5, 1.5) * S)
        self._trouble("halt", ns)
        MACHINE.halt(ns)
        return True

    def _kill(self, _rng: random.Random) -> bool:
        if not MACHINE.is_dead:
            self._trouble("kill")
            MACHINE.kill()
        return False

    def _kill_at_write(self, rng: random.Random) -> bool:
        if MACHINE.is_dead or MACHINE.writes_left:
            return False
        MACHINE.writes_left = rng.randint(1, 40)
        return True

    def _kill_at_store(self, rng: random.Random) -> bool:
        return self._at_store(rng, self._killed_at_store)

    def _killed_at_store(self) -> None:
        self.book.seen["process was killed at a store"] += 1
        self._trouble("kill at a store")
        for axis in (*self.xy.axes.values(), *self.z.axes.values()):
            axis.was_known = False  # the first record after an empty one may be the one that is torn

    def _power_cut_at_store(self, rng: random.Random) -> bool:
        return self._at_store(rng, partial(self._begin_cut, rng))

    @staticmethod
    def _at_store(rng: random.Random, what: Callable[[], object]) -> bool:
        if MACHINE.is_dead or MACHINE.stores_left:
            return False
        MACHINE.stores_left, MACHINE.at_store = rng.randint(1, 40), what
        return True

    def _restart(self, _rng: random.Random) -> bool:
        if MACHINE.is_dead:
            return False
        self._trouble("restart")
        MACHINE.signal(signal.SIGTERM)
        return True

    def _power_cut(self, rng: random.Random) -> bool:
        if not MACHINE.is_dead:
            self._begin_cut(rng)
            MACHINE.kill()
        return False

    def _begin_cut(self, rng: random.Random) -> None:
        self._trouble("power-cut")
        MACHINE.on_end.append(partial(self._cut, rng))

    def _cut(self, rng: random.Random) -> None:
        self._disk.cut(rng)
        MACHINE.reboot()
        for line in (self.xy, self.z):
            for axis in line.axes.values():
                axis.doubt()

    def _slow_store(self, rng: random.Random) -> bool:
        """The process waits for the disk in the middle of its work."""
        if MACHINE.is_dead or MACHINE.slow_store_ns:
            return False
        MACHINE.slow_store_ns = int(rng.choice((0.01, 0.3, 4.0)) * rng.uniform(0.5, 1.5) * S)
        MACHINE.at_slow_store = partial(self._trouble, "slow-store", MACHINE.slow_store_ns)
        return True

    def _fill_disk(self, rng: random.Random) -> bool:
        if MACHINE.is_disk_full:
            return False
        ns = int(rng.uniform(1.0, 60.0) * S)
        self.book.note("fault disk-full")
        MACHINE.is_disk_full = True
        MACHINE.after(ns, setattr, MACHINE, "is_disk_full", False)
        return True

    def _step_clock(self, rng: random.Random) -> bool:
        self.book.note("fault clock-step")
        MACHINE.wall_ahead_ns += int(rng.choice((-86_400, -3600, -1, 1, 3600, 86_400)) * S)
        return True


def _axes(job: Job, rng: random.Random) -> dict[int, Axis]:
    is_stream = job.manner is Manner.SETPOINTS
    drives = [make_drive(layout, MACHINE, rng, is_homed=bool(job.references)) for layout in job.layouts]
    axes = [Axis(drive.layout.name, drive.layout, drive, is_stream=is_stream) for drive in drives]
    for axis, reference in zip(axes, job.references, strict=False):
        axis.reference = reference
    if job.manner is Manner.BEAM:
        group = Group(axes)
        for axis in axes:
            axis.group = group
    return {axis.layout.unit: axis for axis in axes}


def _groups(job: Job) -> tuple[tuple[str, ...], ...]:
    return (tuple(each.name for each in job.layouts),) if job.manner is Manner.BEAM else ()


def _plan(screws: Mapping[str, Sequence[Screw]], xy: Job, z: Job, *, cut_through: bool) -> GatewayPlan:
    def axes(job: Job) -> tuple[AxisPlan, ...]:
        is_stream = job.manner is Manner.SETPOINTS
        plans = [_axis(layout, screws[layout.name][0], is_stream=is_stream) for layout in job.layouts]
        return tuple(map(with_homing, plans, job.references)) if job.references else tuple(plans)

    timing = LineTiming(response_timeout_ms=TIMEOUT_MS, drain_ms=80.0)
    return GatewayPlan(
        "year",
        (
            LinePlan(
                "xy",
                DRIVES,
                (
                    ControllerLink(ControllerPlan("cnc", timeout_ms=PATIENCE_MS, serial=True), CNC),
                    _link("hmi", Role.MONITOR, HMI_PORT),
                ),
                axes(xy),
                timing,
                groups=_groups(xy),
                cut_through=cut_through,
                tape_bytes=1 << 20,
            ),
            LinePlan(
                "z",
                Z_DRIVES,
                (_link("plc", Role.MOTION, PLC_PORT), _link("panel", Role.MONITOR, PANEL_PORT)),
                axes(z),
                timing,
                groups=_groups(z),
            ),
        ),
    )


def _axis(layout: Layout, screw: Screw, *, is_stream: bool) -> AxisPlan:
    plan = replace(axis_plan(layout, screw), table_name=table_name(layout.name, 0))
    if not is_stream:
        return plan
    settings = replace(plan.settings, setpoints=Setpoints.STREAM)
    return replace(plan, settings=settings, deadline_ms=TOO_OLD_MS, late=Late.REJECT)


def _link(name: str, role: Role, port: int) -> ControllerLink:
    return ControllerLink(ControllerPlan(name, role, timeout_ms=PATIENCE_MS), TcpEndpoint("0.0.0.0", port))


def _open_descriptors() -> set[int]:
    return set(map(int, os.listdir("/proc/self/fd")))  # noqa: PTH208 - names only


def _forget(before: set[int]) -> None:
    """Free what a killed process leaves: its objects, then its real descriptors that no object owns."""
    gc.unfreeze()
    gc.enable()
    gc.collect()
    for number in _open_descriptors() - before:
        try:
            os.close(number)
        except OSError:
            continue  # the folder of /proc that was listed
