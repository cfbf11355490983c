"""Plays the controller: goes to each target, in mm, and says where the axis is."""

import socket
import struct
import sys
import time

port, *targets = sys.argv[1:]


def connect():
    """Connect; a gateway that was just started needs a moment."""
    for _ in range(300):
        try:
            return socket.create_connection(("127.0.0.1", int(port)))
        except ConnectionRefusedError:
            time.sleep(0.1)
    sys.exit(f"No program listens on port {port}.")


with connect() as connection:
    replies = connection.makefile("rb")

    def ask(pdu):
        """Send a request to unit 1; return the reply."""
        connection.sendall(struct.pack(">HHHB", 1, 0, 1 + len(pdu), 1) + pdu)
        length = struct.unpack(">HHH", replies.read(6))[2]
        return replies.read(length)[1:]

    def position():
        """Return where the axis is, in counts; wait for a drive that is not there yet."""
        while (reply := ask(struct.pack(">BHH", 3, 0x0520, 2)))[0] != 3:
            time.sleep(0.1)
        return struct.unpack(">i", reply[2:])[0]

    position()
    for target in targets:
        counts = round(float(target) * 1000)
        reply = ask(struct.pack(">BHHBi", 16, 0x0606, 2, 4, counts))
        if reply[0] != 16:
            sys.exit(f"{target}: refused with exception {reply[1]}")
        while position() != counts:
            time.sleep(0.05)
    print(f"the axis is at {position() / 1000:.3f} mm")
