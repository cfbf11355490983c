"""Keys that only a newer release has, after a return to an older one."""

from dataclasses import replace

from gateway.config.findings import UNKNOWN_KEY, Document
from gateway.config.problems import ConfigErrors, Problem
from gateway.state.folder import DEFAULT_STATE
from gateway.state.plan import newer_release


def with_newer_release(errors: ConfigErrors, document: Document) -> ConfigErrors:
    """Return the same errors. If a newer release compiled this configuration, unknown keys say so."""
    if not any(problem.found == UNKNOWN_KEY for problem in errors.problems):
        return errors
    section = document.tables.get("gateway", {})
    named = section.get("state", DEFAULT_STATE) if isinstance(section, dict) else DEFAULT_STATE
    if not isinstance(named, str) or not named or "\0" in named:
        return errors
    release = newer_release(document.path.parent / named)
    if not release:
        return errors
    return ConfigErrors([_with_release(each, release) for each in errors.problems], errors.warnings)


def _with_release(problem: Problem, release: str) -> Problem:
    if problem.found != UNKNOWN_KEY:
        return problem
    hint = (
        f"or a key of release {release}, which ran here before: install that release again, or remove the key"
    )
    return replace(problem, remedy=f"{problem.remedy}; {hint}")
