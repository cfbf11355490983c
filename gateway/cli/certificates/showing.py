"""What a file of certificates holds, in lines for people and as data."""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import Any

from gateway.files import FileRefusedError
from gateway.transport.certificates import Facts, list_ends, read_facts


def shown(path: Path, now: datetime) -> dict[str, Any]:
    """Return what is in a file, as data.

    Raises:
        FileRefusedError: it cannot be read, or holds neither certificates nor a list of revoked ones.
    """
    try:
        return {"certificates": [_as_data(each, now) for each in read_facts(path)]}
    except FileRefusedError as error:
        try:
            count, ends = list_ends(path)
        except FileRefusedError:
            raise error from None
    return {"revoked": count, "until": None if ends is None else ends.isoformat()}


def lines(found: dict[str, Any]) -> Iterator[str]:
    """Yield the same for people."""
    if "revoked" in found:
        yield f"a list of revoked certificates: {found['revoked']}, good until {str(found['until'])[:10]}"
        return
    for number, each in enumerate(found["certificates"]):
        if number:
            yield ""
        yield f"{each['kind']}: {each['subject']}"
        if each["role"]:
            yield f"  role    {each['role']}"
        elif each["kind"] == "controller":
            yield f"  role    none: {each['why_no_role']}"
        if each["hosts"]:
            yield f"  hosts   {', '.join(each['hosts'])}"
        days = f"{each['days_left']} days left" if each["days_left"] >= 0 else "expired"
        yield f"  good    from {each['from'][:10]} until {each['until'][:10]} ({days})"
        yield f"  key     {each['key']}{', too weak: ' + each['weakness'] if each['weakness'] else ''}"
        yield f"  serial  {each['serial']}"
        yield f"  signed  by {each['issuer']}"


def _as_data(facts: Facts, now: datetime) -> dict[str, Any]:
    return {
        "kind": _kind(facts),
        "subject": facts.subject,
        "role": facts.role or None,
        "why_no_role": facts.why_no_role or None,
        "hosts": list(facts.hosts),
        "from": facts.begins.isoformat(),
        "until": facts.ends.isoformat(),
        "days_left": (facts.ends - now).days,
        "key": facts.key,
        "weakness": facts.weakness or None,
        "serial": facts.serial,
        "issuer": facts.issuer,
    }


def _kind(facts: Facts) -> str:
    if facts.is_authority:
        return "authority"
    if facts.names_purpose and facts.is_for_servers:
        return "server"
    return "controller" if facts.is_for_clients else "certificate"
