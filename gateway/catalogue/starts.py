"""Why a process does not start, and the exit codes of the command line.

How each sentence begins stands here; the place that finds the reason fills it in and goes on from there.
"""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StartEntry

EXIT_CODES: Final[Mapping[int, str]] = {
    0: "good; also a clean stop after SIGTERM or Ctrl-C",
    1: "the input is bad or something is in the way: standard error says what, one line a problem, with the "
    "remedy. `run` and `relay` also after a second signal, and `run` when its relay died",
    2: "wrong usage: an option or argument that the command does not have",
}

_CHOOSE_ANOTHER: Final = "do what it says, or choose another folder with `[gateway] state`"
_COMPILE: Final = "run `pitch-gateway check --compile CONFIG`; `run` does it by itself"

NOT_TOML: Final = StartEntry(
    "not TOML", "the configuration is no TOML", "run `pitch-gateway check CONFIG`: it says where"
)
NO_FOLDER_NAME: Final = StartEntry(
    "gateway.state: found {found!r}", "`[gateway] state` is no folder name", "write a folder in quotes"
)
NOT_COMPILED: Final = StartEntry(
    "it has not been compiled yet", "`relay` runs the compiled configuration only", _COMPILE
)
ANOTHER_CONFIGURATION: Final = StartEntry(
    "{plan} was compiled from {made_from}",
    "the state folder belongs to another configuration",
    f"{_COMPILE}, or give each gateway a state folder of its own",
)
CHANGED: Final = StartEntry(
    "{file} has changed since it was compiled", "somebody saved the file after the last start", _COMPILE
)
COMPILED_MEANWHILE: Final = StartEntry(
    "{plan}: another configuration was compiled meanwhile",
    "`check --compile` while the supervisor read the tables (told while it runs)",
    "nothing: what was compiled last counts, and the tables are read again",
    "the gateway goes on as it is",
)
ANOTHER_RELEASE: Final = StartEntry(
    "{plan} was made by release {release}", "the gateway was upgraded or put back", _COMPILE
)
TLS_FILE: Final = StartEntry(
    "tls.{problem}",
    "a file of `tls` is missing, another's or open to others since it was checked, or is not handed over",
    "do what it says; `pitch-gateway check CONFIG` looks at all of them",
)
DAMAGED: Final = StartEntry(
    "{plan} is damaged", "a disk that was full or failed, or another file in its place", _COMPILE
)
NOT_UNDERSTOOD: Final = StartEntry("{plan} is not understood", "the file was spoilt", _COMPILE)
ANOTHER_TABLE: Final = StartEntry(
    "{table} holds another table than its name says", "the file was spoilt", _COMPILE
)
SUPERVISOR_RUNS: Final = StartEntry(
    "gateway.state: {place} belongs to a supervisor that runs",
    "`supervise` beside `run`, or two of them",
    "stop the other one, or give this gateway a state folder of its own",
)
GATEWAY_RUNS: Final = StartEntry(
    "{place} belongs to a gateway that runs",
    "the gateway runs already, as a service perhaps",
    "stop it first, or give this one a state folder of its own",
)
NO_SOCKET: Final = StartEntry(
    "{path} is there and is no socket", "a file is called as the socket", "move the file away"
)
NEWER_RELEASE: Final = StartEntry(
    "{state} was written by a newer release",
    "the gateway was installed again in an older release",
    "install the newer one again, or move the state folder away while nothing runs: the axes then start "
    "without what they remember",
)
PATH_TOO_LONG: Final = StartEntry(
    "{path} has {length} bytes, and the path of a socket",
    "a deep state folder",
    "choose a shorter one with `[gateway] state`",
)
LINK_TO_NOTHING: Final = StartEntry(
    "{path} is a link to {target}", "the state folder is a link that leads nowhere", _CHOOSE_ANOTHER
)
NOT_A_FOLDER: Final = StartEntry(
    "{path} is {kind}, and no folder", "a file is in place of the state folder", _CHOOSE_ANOTHER
)
ANOTHER_FOLDER: Final = StartEntry(
    "{folder} is another folder than the one that the gateway uses",
    "somebody put another state folder in the place of the one in use (told while it runs)",
    "put the first one back, or start the gateway anew",
    "the gateway goes on, and can keep nothing",
)
OPEN_TO_ALL: Final = StartEntry(
    "every user may write to {folder}",
    "the mode of the state folder",
    "take the right away: `chmod o-w FOLDER`",
)
ANOTHER_OWNER: Final = StartEntry(
    "{folder} belongs to user {user}",
    "the owner of the state folder; or root ran what the user of the service should run",
    "run it as the gateway's user (`sudo -u pitch-gateway …`), or give the folder to who runs it",
)
IN_USE: Final = StartEntry(
    "{place} is in use by another program",
    "a port of the network or a serial port has one user only",
    "stop the other program: the sentence has the command that names it",
)
MAY_NOT_LISTEN: Final = StartEntry(
    "no permission to listen on {endpoint}",
    "a port below 1024",
    "give the capability to the unit: `pitch-gateway service CONFIG --systemd /etc/systemd/system`; or "
    "choose a higher port",
)
NO_ADDRESS_HERE: Final = StartEntry(
    "{endpoint} is no address of this machine",
    "`tcp` of a controller",
    "listen on one that `ip address` lists",
)
CANNOT_REJECT_WAITING: Final = StartEntry(
    "{endpoint}: those who waited cannot be turned away",
    "connections that systemd kept over the restart cannot be looked at",
    "restart the unit once more; systemd then gives up what it kept",
)
UNKNOWN_HOST: Final = StartEntry(
    "host name {host!r} is not known", "`tcp` of a controller", "write an address of this machine"
)
CANNOT_LISTEN: Final = StartEntry(
    "cannot listen on {endpoint}",
    "the system refuses it for another reason, which stands behind the address",
    "listen on another address that `ip address` lists, of IPv6 on none that begins with `fe80`",
)
MAY_NOT_OPEN: Final = StartEntry(
    "no permission for {device}",
    "the gateway's user may not open the serial port",
    "add the user to the group that owns it, `dialout` on Debian",
)
NO_SERIAL_PORT: Final = StartEntry(
    "{device} is not a serial port", "`rtu` names something else", "name a port of /dev/serial/by-id"
)
CANNOT_BE_SET: Final = StartEntry(
    "{device} cannot be set to {shape}",
    "the adapter does not do this format",
    "choose another format or adapter",
)
ABSENT: Final = StartEntry(
    "{device} is not there",
    "the adapter is not plugged in; the gateway starts, and opens it when it comes",
    "plug it in; check the name with `ls -l /dev/serial/by-id`",
    "the gateway waits for the port",
)
NOT_REACHED: Final = StartEntry(
    "{endpoint} cannot be reached",
    "drives on TCP that are off; the gateway starts, and tries again",
    "check power, address and network",
    "the gateway has no connection to the drives",
)
NO_ANSWER: Final = StartEntry(
    "{endpoint} did not answer within {seconds:g}",
    "drives on TCP behind a network that swallows packets; the gateway starts, and tries again",
    "check address and network",
    "the gateway has no connection to the drives",
)
RECORDING_EXISTS: Final = StartEntry(
    "{file} exists: record into a new file", "`record` overwrites nothing", "name a new file"
)
RECORDING_NOT_WRITTEN: Final = StartEntry(
    "{file} cannot be written", "the file of a recording", "name a place that can be written"
)

STARTS: Final = tuple(each for each in tuple(globals().values()) if isinstance(each, StartEntry))
"""What stands on standard error, and in the events that tell of ports which are waited for."""
