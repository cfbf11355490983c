"""Why a process does not start, and the exit codes of the command line."""

from collections.abc import Mapping
from typing import Final

from gateway.catalogue.entry import StartEntry

EXIT_CODES: Final[Mapping[int, str]] = {
    0: "good; also a clean stop after SIGTERM or Ctrl-C",
    1: "the input is bad or something is in the way: standard error says what, one line a problem, with the "
    "remedy. `run` and `relay` also after a second signal, and `run` when its relay died",
    2: "wrong usage: an option or argument that the command does not have",
}

_ANOTHER_FOLDER: Final = "do what it says, or choose another folder with `[gateway] state`"
_COMPILE: Final = "run `pitch-gateway check --compile CONFIG`; `run` does it by itself"

STARTS: Final = (
    StartEntry("not TOML", "the configuration is no TOML", "run `pitch-gateway check CONFIG`: it says where"),
    StartEntry("gateway.state: found …", "`[gateway] state` is no folder name", "write a folder in quotes"),
    StartEntry("it has not been compiled yet", "`relay` runs the compiled configuration only", _COMPILE),
    StartEntry(
        "… was compiled from …",
        "the state folder belongs to another configuration",
        f"{_COMPILE}, or give each gateway a state folder of its own",
    ),
    StartEntry(
        "… has changed since it was compiled", "somebody saved the file after the last start", _COMPILE
    ),
    StartEntry(
        "…: another configuration was compiled meanwhile",
        "`check --compile` while the supervisor read the tables (told while it runs)",
        "nothing: what was compiled last counts, and the tables are read again",
        "the gateway goes on as it is",
    ),
    StartEntry("… was made by release …", "the gateway was upgraded or put back", _COMPILE),
    StartEntry(
        "tls.…",
        "a file of `tls` is missing, another's or open to others since it was checked, or is not handed over",
        "do what it says; `pitch-gateway check CONFIG` looks at all of them",
    ),
    StartEntry("… is damaged", "a disk that was full or failed, or another file in its place", _COMPILE),
    StartEntry("… is not understood", "the file was spoilt", _COMPILE),
    StartEntry("… holds another table than its name says", "the file was spoilt", _COMPILE),
    StartEntry(
        "gateway.state: … belongs to a supervisor that runs",
        "`supervise` beside `run`, or two of them",
        "stop the other one, or give this gateway a state folder of its own",
    ),
    StartEntry(
        "… belongs to a gateway that runs",
        "the gateway runs already, as a service perhaps",
        "stop it first, or give this one a state folder of its own",
    ),
    StartEntry("… is there and is no socket", "a file is called as the socket", "move the file away"),
    StartEntry(
        "… was written by a newer release",
        "the gateway was installed again in an older release",
        "install the newer one again, or move the state folder away while nothing runs: the axes then start "
        "without what they remember",
    ),
    StartEntry(
        "… has … bytes, and the path of a socket",
        "a deep state folder",
        "choose a shorter one with `[gateway] state`",
    ),
    StartEntry("… is a link to …", "the state folder is a link that leads nowhere", _ANOTHER_FOLDER),
    StartEntry("… is …, and no folder", "a file is in place of the state folder", _ANOTHER_FOLDER),
    StartEntry(
        "… is another folder than the one that the gateway uses",
        "somebody put another state folder in the place of the one in use (told while it runs)",
        "put the first one back, or start the gateway anew",
        "the gateway goes on, and can keep nothing",
    ),
    StartEntry(
        "every user may write to …", "the mode of the state folder", "take the right away: `chmod o-w FOLDER`"
    ),
    StartEntry(
        "… belongs to user …",
        "the owner of the state folder; or root ran what the user of the service should run",
        "run it as the gateway's user (`sudo -u pitch-gateway …`), or give the folder to who runs it",
    ),
    StartEntry(
        "… is in use by another program",
        "a port of the network or a serial port has one user only",
        "stop the other program: the sentence has the command that names it",
    ),
    StartEntry(
        "no permission to listen on …",
        "a port below 1024",
        "give the capability to the unit: `pitch-gateway service CONFIG --systemd /etc/systemd/system`; or "
        "choose a higher port",
    ),
    StartEntry(
        "… is no address of this machine", "`tcp` of a controller", "listen on one that `ip address` lists"
    ),
    StartEntry(
        "…: those who waited cannot be turned away",
        "connections that systemd kept over the restart cannot be looked at",
        "restart the unit once more; systemd then gives up what it kept",
    ),
    StartEntry("host name … is not known", "`tcp` of a controller", "write an address of this machine"),
    StartEntry(
        "cannot listen on …",
        "the system refuses it for another reason, which stands behind the address",
        "listen on another address that `ip address` lists, of IPv6 on none that begins with `fe80`",
    ),
    StartEntry(
        "no permission for …",
        "the gateway's user may not open the serial port",
        "add the user to the group that owns it, `dialout` on Debian",
    ),
    StartEntry("… is not a serial port", "`rtu` names something else", "name a port of /dev/serial/by-id"),
    StartEntry(
        "… cannot be set to …", "the adapter does not do this format", "choose another format or adapter"
    ),
    StartEntry(
        "… is not there",
        "the adapter is not plugged in; the gateway starts, and opens it when it comes",
        "plug it in; check the name with `ls -l /dev/serial/by-id`",
        "the gateway waits for the port",
    ),
    StartEntry(
        "… cannot be reached",
        "drives on TCP that are off; the gateway starts, and tries again",
        "check power, address and network",
        "the gateway has no connection to the drives",
    ),
    StartEntry(
        "… did not answer within …",
        "drives on TCP behind a network that swallows packets; the gateway starts, and tries again",
        "check address and network",
        "the gateway has no connection to the drives",
    ),
    StartEntry("… exists: record into a new file", "`record` overwrites nothing", "name a new file"),
    StartEntry("… cannot be written", "the file of a recording", "name a place that can be written"),
)
"""What stands on standard error, and in the events that tell of ports which are waited for."""
