"""The page to leave open beside the machine: files that are served as they are.

There is no build step, and the page fetches only from the gateway: ``index.html`` at ``/``, its other files
at ``page/NAME``, and the data ``events``, ``status``, ``tables/AXIS``, ``history/AXIS``, ``frames/LINE``. It
sends only ``acknowledge``.
"""

from typing import Final

FILES: Final = (
    "index.html",
    "login.html",
    "page.css",
    "axes.css",
    "curves.css",
    "rooms.css",
    "frames.css",
    "alarms.css",
    "login.css",
    "icon.svg",
    "theme.js",
    "login.js",
    "page.js",
    "pointer.js",
    "sound.js",
    "axis_card.js",
    "banner.js",
    "chart.js",
    "curve.js",
    "dom.js",
    "event_list.js",
    "figures.js",
    "frames.js",
    "histogram.js",
    "history.js",
    "kept.js",
    "language.js",
    "latency.js",
    "line_cards.js",
    "model.js",
    "stream.js",
    "session.js",
    "tables.js",
    "terms.js",
    "words.js",
    "de.json",
)
"""Every file of the page, by its name in this folder; no other file is served."""
LOGIN_FILES: Final = (
    "page.css",
    "login.css",
    "theme.js",
    "login.js",
    "language.js",
    "kept.js",
    "de.json",
    "icon.svg",
)
"""Files of the login page: the only ones served without authentication."""
