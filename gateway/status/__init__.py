"""The status model: what the gateway shows, one struct for each part.

The relay fills it in, and the supervisor adds what only it knows. ``status``, the page, MQTT and metrics show
these structs and nothing else. A missing value keeps its default: an older release may report less. A field
that is UNSET is left out of the JSON.
"""
