"""All simulated drives by name. A new one is a class and one entry in :data:`DRIVES`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gateway.simulator.drives.applied_motion import AppliedMotion16, AppliedMotion32
from gateway.simulator.drives.delta_asda import DeltaAsda
from gateway.simulator.drives.festo_cmmo_fhpp import FestoCmmoFhpp
from gateway.simulator.drives.festo_cmmt_111 import FestoCmmt111
from gateway.simulator.drives.iai_robo_cylinder import IaiRoboCylinder
from gateway.simulator.drives.igus_dryve_d1 import IgusDryveD1
from gateway.simulator.drives.jmc_rc import JmcRc
from gateway.simulator.drives.kinco_fd import KincoFd
from gateway.simulator.drives.kollmorgen_akd2g import KollmorgenAkd2g
from gateway.simulator.drives.leadshine import LeadshineEl7, LeadshinePr
from gateway.simulator.drives.makerbase_servo42d import MakerbaseServo42d
from gateway.simulator.drives.mitsubishi_mr_je_c import MitsubishiMrJeC
from gateway.simulator.drives.motor_drive import Motor, MotorDrive
from gateway.simulator.drives.oriental_az import OrientalAz
from gateway.simulator.drives.oriental_blv_r import OrientalBlvR
from gateway.simulator.drives.smc_lec import SmcLec
from gateway.simulator.drives.stepperonline_ess_rs import StepperonlineEssRs
from gateway.simulator.drives.tl_r import TlR

DriveFactory = Callable[[int, Sequence[Motor]], MotorDrive]
"""Takes the unit id and the motors, in the order of the configuration."""

DRIVES: Final[Mapping[str, DriveFactory]] = {
    "applied-motion-16": AppliedMotion16,
    "applied-motion-32": AppliedMotion32,
    "delta-asda": DeltaAsda,
    "festo-cmmo-fhpp": FestoCmmoFhpp,
    "festo-cmmt-111": FestoCmmt111,
    "iai-robo-cylinder": IaiRoboCylinder,
    "igus-dryve-d1": IgusDryveD1,
    "jmc-rc": JmcRc,
    "kinco-fd": KincoFd,
    "kollmorgen-akd2g": KollmorgenAkd2g,
    "leadshine-el7": LeadshineEl7,
    "leadshine-pr": LeadshinePr,
    "makerbase-servo42d": MakerbaseServo42d,
    "mitsubishi-mr-je-c": MitsubishiMrJeC,
    "oriental-az": OrientalAz,
    "oriental-blv-r": OrientalBlvR,
    "smc-lec": SmcLec,
    "stepperonline-ess-rs": StepperonlineEssRs,
    "tl-r": TlR,
}
