"""Publishes status and events over MQTT, and takes a few commands if the configuration allows them."""
