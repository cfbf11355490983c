"""I/O only: tcp, serial, timers."""
