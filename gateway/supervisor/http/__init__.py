"""The status over HTTP: for browsers, Prometheus and health probes, and for commands on this machine."""
