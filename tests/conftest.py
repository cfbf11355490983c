"""What every test needs."""

import signal

# A shell that starts us in the background, as some CI runners do, has us ignore SIGINT, and so would every
# program that a test starts: Ctrl-C would then go unheard.  With Python's own handler here, they hear it.
signal.signal(signal.SIGINT, signal.default_int_handler)
