"""HTTP and MQTT: what serves and publishes the status."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

HTTP_READY: Final = EventEntry(
    "http-ready", Severity.INFO, "the page is served at `address`", "a start, or another `[http] listen`"
)
HTTP_NOT_OPEN: Final = EventEntry(
    "http-not-open",
    Severity.WARNING,
    "the page, or the socket `supervisor.sock`, cannot be opened; tried again, everything else goes on",
    "the port is taken, an address that this machine has not, a state folder that cannot be written",
    "end what has taken the port (`ss -ltnp` names it): it is opened by itself; or change `[http] listen`, "
    "then `pitch-gateway reload CONFIG`",
)
HTTP_REFUSED: Final = EventEntry(
    "http-refused",
    Severity.WARNING,
    "somebody asked for the page who may not look, or in a way that is not answered; told at most once a "
    "minute for each "
    "address, with how often it happened",
    "a browser before its log-in, a certificate that is not known here, a scanner, or somebody who tries",
    "do nothing about a person who then logs in; name a token in `[[http.tokens]]` for a program that may "
    "look, as a monitoring system, then `pitch-gateway reload CONFIG`; else find out what runs at that "
    "address",
)
TOKEN_REFUSED: Final = EventEntry(
    "token-refused",
    Severity.WARNING,
    "a token was wrong, or was not looked at after too many wrong ones; told at most once a minute for each "
    "address. The "
    "token is never shown",
    "a token that was changed, a program with an old one, or somebody who guesses",
    "give the program the token of today; else find out what runs at that address",
)
TOKEN_UNUSABLE: Final = EventEntry(
    "token-unusable",
    Severity.WARNING,
    "the file of a token cannot be used any more: nobody gets in by it until it is mended",
    "the file was removed, emptied, or may be read or written by every user",
    "do what the detail says; the file is read again by itself",
)
ALARM_ACKNOWLEDGED: Final = EventEntry(
    "alarm-acknowledged",
    Severity.INFO,
    "an alarm was acknowledged: `by` is the name of the token. Nothing changes at the machine",
    "the button of the page, or `POST /acknowledge`",
)
ACKNOWLEDGEMENTS_LOST: Final = EventEntry(
    "acknowledgements-lost",
    Severity.WARNING,
    "which alarms were acknowledged before the restart is not known: they stand there as new ones",
    "`acknowledged.json` in the state folder was changed, or the disk is bad",
    "acknowledge them again",
)
HTTP_FAILED: Final = EventEntry(
    "http-failed",
    Severity.ERROR,
    "a request over HTTP could not be answered: the client got status 500",
    "a mistake in the gateway",
    "keep the log and report it",
)
MQTT_CONNECTED: Final = EventEntry(
    "mqtt-connected", Severity.INFO, "the broker has let the gateway in", "a start, or the end of `mqtt-lost`"
)
MQTT_LOST: Final = EventEntry(
    "mqtt-lost",
    Severity.WARNING,
    "there is no connection to the broker; told once for each reason, and tried again after up to a minute",
    "the broker is off, refuses user or certificate, or another client has the same `client_id`",
    "do what the detail says: the broker and the password file are tried again by themselves; where `[mqtt]` "
    "was wrong, `pitch-gateway reload CONFIG`",
)
MQTT_COMMANDS_NOT_HEARD: Final = EventEntry(
    "mqtt-commands-not-heard",
    Severity.WARNING,
    "the broker does not let the gateway read its commands, or its temperatures; publishing goes on",
    "the broker's access list",
    "allow the topic of the detail in the broker's access list, then start the broker again: the gateway "
    "asks when it connects",
)
MQTT_COMMAND: Final = EventEntry(
    "mqtt-command",
    Severity.INFO,
    "a command came over MQTT, and this is its answer; a warning where it was refused",
    "a client of the broker published it",
    "where it was refused do what `problems` says",
    also=Severity.WARNING,
)
MQTT_COMMAND_IGNORED: Final = EventEntry(
    "mqtt-command-ignored",
    Severity.WARNING,
    "a command that the broker keeps was ignored: it would be obeyed again at every start",
    "it was published with the retain flag",
    "take it away with the command of the detail, to which `-h` with the broker belongs, and `-u` and `-P` "
    "where it asks who; publish commands without retain",
)
MQTT_COMMANDS_TOO_MANY: Final = EventEntry(
    "mqtt-commands-too-many",
    Severity.WARNING,
    "commands came faster than they are taken, or waited when the gateway ended, and were not carried out: "
    "how many, and the last of them",
    "a program in a loop, or somebody who means harm",
    "find out who publishes them; give the last one again if it is to hold",
)
MQTT_TOPICS_NOT_NOTED: Final = EventEntry(
    "mqtt-topics-not-noted",
    Severity.WARNING,
    "the list of what the broker keeps for the gateway could not be written: messages of an axis that "
    "is taken away would stay there",
    "the state folder is full or cannot be written",
    "make room in the state folder",
)
