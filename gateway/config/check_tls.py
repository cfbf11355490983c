"""Whether Modbus/TCP Security can work: keys that belong together, and the files that they name."""

import os
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway.config.check_lines import controller_key
from gateway.config.findings import Findings
from gateway.config.named_files import is_out_of_reach
from gateway.config.rights_model import RightsKeys
from gateway.config.sections import Sections
from gateway.config.tls_model import ControllerTls
from gateway.config.toml_lines import KeyPath
from gateway.files import FileRefusedError
from gateway.secret_files import CREDENTIAL
from gateway.transport.certificate_times import TimeProblem, list_problem, time_problem
from gateway.transport.tls_files import TlsFileError, TlsFiles

if TYPE_CHECKING:
    from gateway.transport.certificate_facts import Facts

SERVER_REMEDY: Final = "have it made for a server; pitch-gateway certificate server makes one"


def check_tls_keys(findings: Findings) -> None:
    """Refuse keys that have no meaning together, as they stand in the file."""
    for path, raw in _raw_controllers(findings):
        has_tls = "tls" in raw
        if has_tls and "rtu" in raw:
            findings.refuse((*path, "tls"), "tls on a serial port", "tls belongs to tcp: leave it out here")
        if has_tls and "rtu_over_tcp" in raw:
            findings.refuse(
                (*path, "tls"), "tls around RTU frames", "Modbus/TCP Security is for tcp: leave it out here"
            )
        if "roles" in raw and not has_tls:
            findings.refuse(
                (*path, "roles"),
                "roles without tls",
                "give tls too: roles come by certificates; or write the rights of the controller itself",
            )
        if has_tls and not raw.get("roles"):
            findings.refuse(
                (*path, "tls"),
                "tls without roles",
                "needed: at least one [line.NAME.controllers.roles.ROLE], named as in the certificates",
            )
        for key in RightsKeys.model_fields if has_tls else ():
            if key in raw:
                findings.refuse(
                    (*path, key),
                    f"{key} beside tls",
                    "move it under roles: with tls rights come by the role in the certificate",
                )


def tls_files(tls: ControllerTls, folder: Path) -> TlsFiles:
    """Return the files by paths from the root; ``folder`` is that of the configuration file."""

    def place(name: str) -> str:
        return os.fspath((folder / name).absolute())

    key = tls.key if tls.key.startswith(CREDENTIAL) else place(tls.key)
    revoked = "" if tls.revoked is None else place(tls.revoked)
    return TlsFiles(place(tls.certificate), key, place(tls.clients), revoked)


def check_tls_files(findings: Findings, sections: Sections, now: datetime) -> None:
    """Refuse files that no connection could be had with; warn of what will end soon."""
    for name, line in sections.lines.items():
        for index, controller in enumerate(line.controllers):
            path = (*controller_key(findings, name, controller.name, index), "tls")
            if controller.tls is not None and not findings.is_refused(path):
                _Check(findings, path, tls_files(controller.tls, sections.folder), now).all()


def _raw_controllers(findings: Findings) -> Iterator[tuple[KeyPath, dict[str, Any]]]:
    lines = findings.document.tables.get("line")
    for name, line in lines.items() if isinstance(lines, dict) else ():
        controllers = line.get("controllers") if isinstance(line, dict) else None
        for index, controller in enumerate(controllers if isinstance(controllers, list) else ()):
            if isinstance(controller, dict):
                yield ("line", name, "controllers", index), controller


class _Check:
    """The files of one listener."""

    def __init__(self, findings: Findings, path: KeyPath, files: TlsFiles, now: datetime) -> None:
        self._findings = findings
        self._path = path
        self._files = files
        self._now = now

    def all(self) -> None:
        """Look at every file for itself, then at all together."""
        self._own()
        self._clients()
        if self._files.revoked:
            self._revoked()
        if is_out_of_reach(self._files.key):
            self._warn(
                "key",
                f"{self._files.key} was not looked at: it is handed over to the service alone",
                "start the service: it says what is wrong with it",
            )
            return
        from gateway.transport.tls import server_context

        try:
            server_context(self._files)
        except TlsFileError as error:
            if not self._findings.is_refused((*self._path, error.key)):
                self._refuse(error.key, error.found, error.remedy)

    def _own(self) -> None:
        facts = self._facts("certificate", self._files.certificate)
        if not facts:
            return
        own = facts[0]
        self._check_time("certificate", own)
        self._check_strength("certificate", own)
        if not (own.names_purpose and own.is_for_servers):
            found = f"{self._files.certificate} is not for a server: no extended key usage serverAuth"
            self._refuse("certificate", found, SERVER_REMEDY)
        if not own.hosts:
            self._warn(
                "certificate",
                f"{self._files.certificate} names no host (subjectAltName): controllers may refuse it",
                "have it made with the names and addresses that controllers connect to",
            )

    def _clients(self) -> None:
        for each in self._facts("clients", self._files.clients):
            if not each.is_authority:
                self._refuse(
                    "clients",
                    f"{self._files.clients}: {each.subject} is no authority",
                    "give the certificate of the authority that signs those of controllers",
                )
            self._check_time("clients", each)
            self._check_strength("clients", each)

    def _revoked(self) -> None:
        from gateway.transport.certificate_facts import list_ends

        try:
            _, ends = list_ends(Path(self._files.revoked))
        except FileRefusedError as error:
            self._refuse("revoked", f"{self._files.revoked}: {error.found}", error.remedy)
            return
        self._say("revoked", list_problem(self._files.revoked, ends, self._now))

    def _facts(self, key: str, name: str) -> "tuple[Facts, ...]":
        from gateway.transport.certificate_facts import read_facts

        try:
            return read_facts(Path(name))
        except FileRefusedError as error:
            self._refuse(key, f"{name}: {error.found}", error.remedy)
            return ()

    def _check_time(self, key: str, facts: "Facts") -> None:
        self._say(key, time_problem(facts, self._now))

    def _say(self, key: str, problem: TimeProblem | None) -> None:
        if problem is not None:
            say = self._warn if problem.is_good_now else self._refuse
            say(key, problem.found, problem.remedy)

    def _check_strength(self, key: str, facts: "Facts") -> None:
        if facts.weakness:
            self._refuse(
                key, f"{facts.subject} has a weak key: {facts.weakness}", "have it made anew with P-256"
            )

    def _refuse(self, key: str, found: str, remedy: str) -> None:
        self._findings.refuse((*self._path, key), found, remedy)

    def _warn(self, key: str, found: str, remedy: str) -> None:
        self._findings.warn((*self._path, key), found, remedy)
