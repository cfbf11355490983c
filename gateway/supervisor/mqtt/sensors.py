"""Listening to the topics of sensors, on the connection that the status is published over."""

from collections.abc import Sequence

import aiomqtt
from paho.mqtt.reasoncodes import ReasonCode

from gateway.supervisor.mqtt.commander import FAILURE


async def subscribe_sensors(client: aiomqtt.Client, topics: Sequence[str]) -> str | None:
    """Ask for the messages of sensors; returns what the broker does not let us read, None where it does."""
    granted = await client.subscribe([(topic, 0) for topic in topics])
    codes = [code.value if isinstance(code, ReasonCode) else code for code in granted]
    denied = [topic for topic, code in zip(topics, codes, strict=True) if code >= FAILURE]
    if not denied:
        return None
    return f"the broker does not let the gateway read {', '.join(denied)}: allow it in its ACL"
