"""HTTP and MQTT: what serves and publishes the status."""

from typing import Final

from gateway.catalogue.entry import EventEntry, Severity

HTTP_READY: Final = EventEntry(
    "http-ready", Severity.INFO, "the page is served at `address`", "a start, or another `[http] listen`"
)
HTTP_NOT_OPEN: Final = EventEntry(
    "http-not-open",
    Severity.WARNING,
    "the page or the socket `supervisor.sock` cannot be opened; the gateway keeps trying",
    "the port is taken, the address is not of this machine, or the state folder is not writable",
    "end the program that uses the port (`ss -ltnp` names it). Or change `[http] listen`, then "
    "`pitch-gateway reload CONFIG`",
)
HTTP_REFUSED: Final = EventEntry(
    "http-refused",
    Severity.WARNING,
    "a client without permission asked for the page, or sent an unsupported request",
    "a browser before its log-in, an unknown certificate, a scanner, or an attack",
    "nothing, if a person then logs in. For a program name a token in `[[http.tokens]]`, then "
    "`pitch-gateway reload CONFIG`. Otherwise find out what runs at that address",
)
TOKEN_REFUSED: Final = EventEntry(
    "token-refused",
    Severity.WARNING,
    "a token was wrong, or ignored after too many wrong ones",
    "a token that was changed, a program with an old one, or an attack",
    "give the program the current token, or find out what runs at that address",
)
TOKEN_UNUSABLE: Final = EventEntry(
    "token-unusable",
    Severity.WARNING,
    "the file of a token is unusable: the token is refused until the file is corrected",
    "the file was removed or emptied, or every user may read or write it",
    "do what the detail says; the file is read again automatically",
)
ALARM_ACKNOWLEDGED: Final = EventEntry(
    "alarm-acknowledged",
    Severity.INFO,
    "the token named `by` acknowledged an alarm. Nothing changes at the machine",
    "the button of the page, or `POST /acknowledge`",
)
ACKNOWLEDGEMENTS_LOST: Final = EventEntry(
    "acknowledgements-lost",
    Severity.WARNING,
    "earlier acknowledgements are lost: alarms show as new",
    "`acknowledged.json` in the state folder was changed, or the disk is bad",
    "acknowledge them again",
)
HTTP_FAILED: Final = EventEntry(
    "http-failed",
    Severity.ERROR,
    "an HTTP request failed: the client got status 500",
    "a bug in the gateway",
    "keep the log and report it",
)
MQTT_CONNECTED: Final = EventEntry(
    "mqtt-connected",
    Severity.INFO,
    "the gateway is connected to the broker",
    "a start, or the end of `mqtt-lost`",
)
MQTT_LOST: Final = EventEntry(
    "mqtt-lost",
    Severity.WARNING,
    "the broker is not connected. Reported once for each reason; retried at least once a minute",
    "the broker is off, refuses user or certificate, or another client has the same `client_id`",
    "do what the detail says; broker and password file are tried again automatically. If `[mqtt]` was "
    "wrong, run `pitch-gateway reload CONFIG`",
)
MQTT_COMMANDS_NOT_HEARD: Final = EventEntry(
    "mqtt-commands-not-heard",
    Severity.WARNING,
    "the broker does not let the gateway read commands or temperatures; publishing goes on",
    "the broker's access list",
    "allow the topic of the detail in the access list, then restart the broker: the gateway asks when it "
    "connects",
)
MQTT_COMMAND: Final = EventEntry(
    "mqtt-command",
    Severity.INFO,
    "a command came over MQTT, with its answer; a warning if it was refused",
    "a client published it",
    "if it was refused, do what `problems` says",
    also=Severity.WARNING,
)
MQTT_COMMAND_IGNORED: Final = EventEntry(
    "mqtt-command-ignored",
    Severity.WARNING,
    "a command retained by the broker was ignored, because it would be executed again at every start",
    "it was published with the retain flag",
    "clear it with the command in the detail, with `-h`, and `-u` and `-P` if the broker needs a log-in. "
    "Publish commands without retain",
)
MQTT_COMMANDS_TOO_MANY: Final = EventEntry(
    "mqtt-commands-too-many",
    Severity.WARNING,
    "commands came too fast, or waited when the gateway ended, and were not executed. The event gives "
    "their number and the last one",
    "a program in a loop, or an attack",
    "find out who publishes them. Send the last one again if it is still needed",
)
MQTT_TOPICS_NOT_NOTED: Final = EventEntry(
    "mqtt-topics-not-noted",
    Severity.WARNING,
    "the list of retained topics could not be written: messages of a removed axis would stay",
    "the state folder is full or not writable",
    "make room in the state folder",
)
