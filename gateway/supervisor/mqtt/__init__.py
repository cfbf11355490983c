"""What the gateway does, published over MQTT; and, where the configuration allows it, a few commands."""
