"""HEALTHCHECK of the container: asks ``/healthz`` on the supervisor's socket; exit code 0: all is well."""

import http.client
import socket
import sys
from pathlib import Path

SOCKET = Path(sys.argv[1] if len(sys.argv) > 1 else "/var/lib/pitch-gateway/supervisor.sock")
PATIENCE_S = 3.0
HEALTHY = 200


class Connection(http.client.HTTPConnection):
    """HTTP over a Unix socket."""

    def connect(self) -> None:
        """Connect to the supervisor."""
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(PATIENCE_S)
        self.sock.connect(str(SOCKET))


def main() -> int:
    """Ask once; what is wrong is for `docker inspect`."""
    connection = Connection("localhost")
    try:
        connection.request("GET", "/healthz")
        answer = connection.getresponse()
        text = answer.read().decode(errors="replace")
    except (OSError, http.client.HTTPException) as error:
        sys.stdout.write(f"{SOCKET}: {error}\n")
        return 1
    finally:
        connection.close()
    sys.stdout.write(text)
    return 0 if answer.status == HEALTHY else 1


if __name__ == "__main__":
    sys.exit(main())
