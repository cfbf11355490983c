"""The status over HTTP: for browsers, Prometheus, probes of health, and the commands of this machine."""
