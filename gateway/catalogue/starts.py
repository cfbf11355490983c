"""Why a process does not start, and the exit codes of the command line.

The beginning of each sentence is here; the code that finds the reason fills it in and continues it.
"""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StartEntry

EXIT_CODES: Final[Mapping[int, str]] = {
    0: "success; also a clean stop after SIGTERM or Ctrl-C",
    1: "bad input or an obstacle: standard error has a line for each problem, with the remedy. Also `run` "
    "and `relay` after a second signal, and `run` when its relay died",
    2: "wrong usage: an unknown option or argument",
    3: "`status URL…`: every gateway gives a status, and the worst verdict is `error`",
    4: "`status URL…`: every gateway gives a status, and the worst verdict is `warning`",
}

_CHOOSE_ANOTHER: Final = "do what the message says, or choose another folder with `[gateway] state`"
_COMPILE: Final = "run `pitch-gateway check --compile CONFIG`"

NOT_TOML: Final = StartEntry(
    "not TOML", "a syntax error in the configuration", "run `pitch-gateway check CONFIG`: it names the place"
)
NO_FOLDER_NAME: Final = StartEntry(
    "gateway.state: found {found!r}", "`[gateway] state` is not a folder name", "write a folder in quotes"
)
NOT_COMPILED: Final = StartEntry(
    "it has not been compiled yet", "`relay` runs only a compiled configuration", _COMPILE
)
ANOTHER_CONFIGURATION: Final = StartEntry(
    "{plan} was compiled from {made_from}",
    "the state folder belongs to another configuration",
    f"{_COMPILE}. Or give each gateway its own state folder",
)
CHANGED: Final = StartEntry(
    "{file} has changed since it was compiled", "the file was saved after the last start", _COMPILE
)
INCLUDED: Final = StartEntry(
    "{file} is included, and was not when it was compiled",
    "a file came into a folder of `include` after the last start",
    _COMPILE,
)
COMPILED_MEANWHILE: Final = StartEntry(
    "{plan}: another configuration was compiled meanwhile",
    "`check --compile` while the supervisor read the tables (reported while it runs)",
    "nothing: the newest compilation counts, and the tables are read again",
    "the gateway continues",
)
ANOTHER_RELEASE: Final = StartEntry(
    "{plan} was made by release {release}", "an upgrade or downgrade of the gateway", _COMPILE
)
TLS_FILE: Final = StartEntry(
    "tls.{problem}",
    "a file of `tls` is missing, not handed over, of another user, or became readable by others",
    "do what the message says; `pitch-gateway check CONFIG` checks all of them",
)
DAMAGED: Final = StartEntry(
    "{plan} is damaged", "a full or faulty disk, or another file in its place", _COMPILE
)
NOT_UNDERSTOOD: Final = StartEntry("{plan} is not understood", "the file was damaged", _COMPILE)
ANOTHER_TABLE: Final = StartEntry(
    "{table} holds another table than its name says", "the file was damaged", _COMPILE
)
SUPERVISOR_RUNS: Final = StartEntry(
    "gateway.state: {place} belongs to a supervisor that runs",
    "two supervisors on one state folder: `supervise` beside `run`, or twice",
    "stop the other one, or give this gateway its own state folder",
)
GATEWAY_RUNS: Final = StartEntry(
    "{place} belongs to a gateway that runs",
    "the gateway is already running, perhaps as a service",
    "stop it first, or give this one its own state folder",
)
NO_SOCKET: Final = StartEntry(
    "{path} exists and is not a socket", "a file has the name of the socket", "move the file away"
)
NEWER_RELEASE: Final = StartEntry(
    "{state} was written by a newer release",
    "an older release of the gateway was installed",
    "install the newer one again. Or move the state folder away while nothing runs: the axes then start "
    "without their records",
)
PATH_TOO_LONG: Final = StartEntry(
    "{path} has {length} bytes, and the path of a socket",
    "a long path of the state folder",
    "choose a shorter one with `[gateway] state`",
)
LINK_TO_NOTHING: Final = StartEntry(
    "{path} is a link to {target}", "the state folder is a broken link", _CHOOSE_ANOTHER
)
NOT_A_FOLDER: Final = StartEntry(
    "{path} is {kind}, not a folder", "a file in place of the state folder", _CHOOSE_ANOTHER
)
ANOTHER_FOLDER: Final = StartEntry(
    "{folder} is another folder than the one that the gateway uses",
    "the state folder was replaced while in use (reported while the gateway runs)",
    "put the first one back, or restart the gateway",
    "the gateway continues but cannot save anything",
)
OPEN_TO_ALL: Final = StartEntry(
    "every user may write to {folder}",
    "mode of the state folder",
    "remove the right: `chmod o-w FOLDER`",
)
ANOTHER_OWNER: Final = StartEntry(
    "{folder} belongs to user {user}",
    "owner of the state folder, or root ran what the service's user should run",
    "run it as the gateway's user (`sudo -u pitch-gateway …`), or change the owner of the folder",
)
IN_USE: Final = StartEntry(
    "{place} is in use by another program",
    "a network or serial port can have one user only",
    "end the other program: the message has a command that names it",
)
MAY_NOT_LISTEN: Final = StartEntry(
    "no permission to listen on {endpoint}",
    "a port below 1024",
    "give the capability to the unit with `pitch-gateway service CONFIG --systemd /etc/systemd/system`, "
    "or choose a higher port",
)
NO_ADDRESS_HERE: Final = StartEntry(
    "{endpoint} is not an address of this machine",
    "`tcp` of a controller",
    "use one that `ip address` lists",
)
CANNOT_REJECT_WAITING: Final = StartEntry(
    "{endpoint}: those who waited cannot be turned away",
    "systemd kept connections over the restart that cannot be examined",
    "restart the unit once more: systemd then drops them",
)
UNKNOWN_HOST: Final = StartEntry(
    "host name {host!r} is not known", "`tcp` of a controller", "write an address of this machine"
)
CANNOT_LISTEN: Final = StartEntry(
    "cannot listen on {endpoint}",
    "the system refuses it; the reason follows the address",
    "use another address that `ip address` lists; for IPv6 none that begins with `fe80`",
)
MAY_NOT_OPEN: Final = StartEntry(
    "no permission for {device}",
    "the gateway's user may not open the serial port",
    "add the user to the group that owns it (`dialout` on Debian)",
)
NO_SERIAL_PORT: Final = StartEntry(
    "{device} is not a serial port", "`rtu` names something else", "name a port in /dev/serial/by-id"
)
CANNOT_BE_SET: Final = StartEntry(
    "{device} cannot be set to {shape}",
    "the adapter does not support this format",
    "choose another format or adapter",
)
ABSENT: Final = StartEntry(
    "{device} is not there",
    "the adapter is unplugged; the gateway opens it when it comes",
    "plug it in; check the name with `ls -l /dev/serial/by-id`",
    "the gateway waits for the port",
)
NOT_REACHED: Final = StartEntry(
    "{endpoint} cannot be reached",
    "TCP drives that are off; the gateway keeps trying",
    "check power, address and network",
    "the gateway has no connection to the drives",
)
NO_ANSWER: Final = StartEntry(
    "{endpoint} did not answer within {seconds:g}",
    "a network that drops packets; the gateway keeps trying",
    "check address and network",
    "the gateway has no connection to the drives",
)
RECORDING_EXISTS: Final = StartEntry(
    "{file} exists: record into a new file", "`record` overwrites no file", "name a new file"
)
RECORDING_NOT_WRITTEN: Final = StartEntry(
    "{file} cannot be written", "the file of a recording", "name a writable place"
)

STARTS: Final = tuple(each for each in tuple(globals().values()) if isinstance(each, StartEntry))
"""Texts on standard error, and in the events about ports that the gateway waits for."""
