"""Process 2: tables, MQTT, HTTP, metrics, page. Filled by a later release."""
