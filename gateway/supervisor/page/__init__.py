"""The page that a person leaves open beside the machine: files that are served as they are.

Nothing is built, and nothing is fetched but from the gateway itself: ``index.html`` at ``/``, the others at
``page/NAME``, and of the gateway's own answers ``events``, ``status``, ``tables/AXIS``, ``history/AXIS``,
``frames/LINE``. The one thing that it sends is ``acknowledge``.
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
    "icon-trouble.svg",
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
"""Every file of the page, by its name in this folder; nothing else is served."""
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
"""What the page that asks for a token needs: strangers may have these, and nothing else of the page."""
