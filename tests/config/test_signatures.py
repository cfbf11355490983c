"""``[gateway] allowed_signers``: a table that is not signed by one of them is not taken over."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from gateway.cli.configuration import compile_for_start_or_exit
from gateway.commissioning.recordings import plan_of
from gateway.config.compile import compile_into_state
from gateway.config.last_good import TableSource, settle
from gateway.config.load import load
from gateway.config.problems import ConfigErrors, Problem
from gateway.config.recording_header import header_of
from gateway.config.signatures import SignatureRefusedError, signature_path, signer_of
from gateway.state.last_good import last_plan
from tests.support.config import RAMP, STEEPER, axis, gateway_toml, line, written
from tests.support.signing import Signer, needs_ssh_keygen

pytestmark = needs_ssh_keygen
LINE = line(1, {"cnc": 2})
X = axis(compensation="on", table="x.tab")
SIGNED = gateway_toml(LINE, X, allowed_signers="signers")
PLAIN = gateway_toml(LINE, X)


@pytest.fixture(scope="module")
def eva(tmp_path_factory: pytest.TempPathFactory) -> Signer:
    return Signer(tmp_path_factory.mktemp("keys"), "eva")


@pytest.fixture(scope="module")
def bob(tmp_path_factory: pytest.TempPathFactory) -> Signer:
    return Signer(tmp_path_factory.mktemp("keys"), "bob")


@pytest.fixture
def config(tmp_path: Path, eva: Signer) -> Path:
    """A configuration that allows eva only, with a table that she has signed."""
    path = written(tmp_path, SIGNED)
    (tmp_path / "signers").write_text(eva.line())
    eva.sign(table(path))
    return path


def table(config: Path, name: str = "x.tab") -> Path:
    return config.parent / "tables" / name


def refused(config: Path) -> Problem:
    with pytest.raises(ConfigErrors) as caught:
        load(config)
    (problem,) = caught.value.problems
    return problem


def test_a_table_that_is_signed_by_who_may_counts(config: Path) -> None:
    loaded = load(config)
    assert loaded.warnings == ()
    assert loaded.tables["x"].signer == "eva@plant"
    assert load(written(config.parent, PLAIN)).tables["x"].signer == ""


def test_a_table_without_a_signature_is_refused_with_the_command_to_run(config: Path) -> None:
    signature_path(table(config)).unlink()
    assert str(refused(config)) == (
        f"{table(config)}: axis.x.table: not signed: there is no x.tab.sig; "
        f"sign it: ssh-keygen -Y sign -n pitch-gateway -f KEY {table(config)}"
    )


def test_a_table_that_changed_since_it_was_signed_is_refused(config: Path) -> None:
    table(config).write_text(RAMP.replace("0.05 0.05", "0.06 0.05"))
    problem = refused(config)
    assert problem.found == (
        "x.tab.sig is no signature of this content (Signature verification failed: incorrect signature)"
    )
    assert problem.remedy == f"sign it again: ssh-keygen -Y sign -n pitch-gateway -f KEY {table(config)}"


def test_a_table_that_is_signed_by_somebody_else_is_refused(config: Path, bob: Signer) -> None:
    bob.sign(table(config))
    problem = refused(config)
    signers = config.parent / "signers"
    assert problem.found.startswith("signed with ED25519 key SHA256:")
    assert problem.found.endswith(f", which {signers} does not allow (No principal matched.)")
    assert problem.remedy == (
        f"sign it with an allowed key: ssh-keygen -Y sign -n pitch-gateway -f KEY {table(config)}; "
        "or allow that key there"
    )


def test_the_signature_of_another_table_is_none_of_this(config: Path, eva: Signer) -> None:
    other = table(config, "other.tab")
    other.write_text(STEEPER)
    eva.sign(other).replace(signature_path(table(config)))
    assert "incorrect signature" in refused(config).found


def test_a_signature_for_something_else_is_none_of_a_table(config: Path, eva: Signer) -> None:
    eva.sign(table(config), namespace="git")
    assert "x.tab.sig is no signature of this content (Couldn't verify" in refused(config).found
    assert "namespace does not match" in refused(config).found


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ('namespaces="git"', 'key is not permitted for use in signature namespace "pitch-gateway"'),
        ('valid-before="20200101"', "key has expired"),
        ('valid-after="29991231"', "key is not yet valid"),
    ],
)
def test_an_allowed_key_is_allowed_as_far_as_its_line_says(
    config: Path, eva: Signer, options: str, why: str
) -> None:
    (config.parent / "signers").write_text(eva.line(options))
    found = refused(config).found
    assert found.startswith("signed with ED25519 key SHA256:")
    assert why in found


@pytest.mark.parametrize("options", ['namespaces="pitch-gateway"', 'valid-after="20200101"'])
def test_an_allowed_key_with_options_that_fit_counts(config: Path, eva: Signer, options: str) -> None:
    (config.parent / "signers").write_text(f"# who may\n{eva.line(options)}")
    assert load(config).tables["x"].signer == "eva@plant"


def test_of_several_that_may_each_may(config: Path, eva: Signer, bob: Signer) -> None:
    (config.parent / "signers").write_text(bob.line() + eva.line())
    assert load(config).tables["x"].signer == "eva@plant"
    bob.sign(table(config))
    assert load(config).tables["x"].signer == "bob@plant"


@pytest.mark.parametrize("damage", [b"", b"no signature\n", b"-----BEGIN SSH SIGNATURE-----\nAAAA\n"])
def test_a_damaged_signature_is_refused(config: Path, damage: bytes) -> None:
    signature_path(table(config)).write_bytes(damage)
    assert refused(config).found.startswith("x.tab.sig is no signature of this content (")


def test_every_byte_of_a_table_is_signed(config: Path) -> None:
    content = table(config).read_bytes()
    signers = config.parent / "signers"
    assert signer_of(table(config), content, signers) == "eva@plant"
    for at in (0, len(content) // 2, len(content) - 1):
        changed = bytearray(content)
        changed[at] ^= 1
        with pytest.raises(SignatureRefusedError, match="incorrect signature"):
            signer_of(table(config), bytes(changed), signers)


def test_what_is_checked_is_what_was_read_and_not_what_is_on_the_disk_by_then(config: Path) -> None:
    with pytest.raises(SignatureRefusedError, match="incorrect signature"):
        signer_of(table(config), STEEPER.encode(), config.parent / "signers")


def test_a_signature_that_is_no_file_is_not_opened(config: Path) -> None:
    signature_path(table(config)).unlink()
    signature_path(table(config)).mkdir()
    assert refused(config).found == f"{table(config)}.sig: a folder"
    signature_path(table(config)).rmdir()
    signature_path(table(config)).write_bytes(b"x" * 70_000)
    assert refused(config).found == f"{table(config)}.sig: more than 65536 bytes"


def test_a_name_with_blanks_can_be_copied_into_a_shell(config: Path) -> None:
    text = SIGNED.replace('"x.tab"', '"x y.tab"')
    table(config).rename(table(config, "x y.tab"))
    assert refused(written(config.parent, text)).remedy.endswith(f"-f KEY '{table(config, 'x y.tab')}'")


def test_a_table_of_another_axis_counts_signed_only_too(config: Path, eva: Signer) -> None:
    x = axis(compensation="on", table="x.tab", cross=[{"axis": "y", "table": "sag.tab"}])
    text = gateway_toml(LINE, x, axis("y", unit_id=2), allowed_signers="signers")
    written(config.parent, text, {"sag.tab": RAMP})
    problem = refused(config)
    assert (problem.key, problem.found) == (
        "axis.x.cross[1].table",
        "not signed: there is no sag.tab.sig",
    )
    eva.sign(table(config, "sag.tab"))
    assert load(config).crosses["x"][0].plan.table_name == "sag.tab"


# What is needed to check a signature.


def test_without_ssh_keygen_the_key_says_what_to_install(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(config.parent))
    problem = refused(config)
    assert (problem.file, problem.key) == (str(config), "gateway.allowed_signers")
    assert problem.line == config.read_text().split("allowed_signers")[0].count("\n") + 1
    assert problem.found == "there is no ssh-keygen, which checks signatures"
    assert problem.remedy == "install OpenSSH's client (Debian: apt install openssh-client)"


def test_without_the_file_of_signers_the_key_says_so(config: Path) -> None:
    (config.parent / "signers").unlink()
    problem = refused(config)
    assert problem.key == "gateway.allowed_signers"
    assert problem.found == f"{config.parent / 'signers'}: no such file"


def test_a_file_of_signers_that_everybody_may_write_is_warned_of(config: Path) -> None:
    (config.parent / "signers").chmod(0o666)
    (warning,) = load(config).warnings
    assert (warning.key, f"{config.parent}/signers" in warning.found) == ("gateway.allowed_signers", True)


def test_an_ssh_keygen_that_does_not_answer_is_not_waited_for(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = config.parent / "ssh-keygen"
    program.write_text(f"#!/bin/sh\nexec {shutil.which('tail')} -f /dev/null\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(config.parent))
    monkeypatch.setattr("gateway.config.signatures.TIMEOUT_S", 0.2)
    assert refused(config).found == "ssh-keygen has not answered within 0.2 s"


# What was in force before.


@pytest.fixture
def compiled(config: Path) -> Path:
    compile_into_state(load(config))
    return config


def source(config: Path, waiting: frozenset[str] = frozenset()) -> TableSource:
    loaded = load(config, forgives_tables=True)
    return settle(loaded, last_plan(loaded.state_folder), waiting=waiting).sources["x"]


def unsigned(config: Path, _bob: Signer) -> None:
    table(config).write_text(STEEPER)


def by_somebody_else(config: Path, bob: Signer) -> None:
    table(config).write_text(STEEPER)
    bob.sign(table(config))


@pytest.mark.parametrize("put", [unsigned, by_somebody_else])
def test_a_start_goes_on_with_the_last_good_table(
    compiled: Path, bob: Signer, put: Callable[[Path, Signer], None]
) -> None:
    put(compiled, bob)
    assert source(compiled) is TableSource.KEPT
    _, state, warnings = compile_for_start_or_exit(compiled)
    assert warnings[-1] == f"{table(compiled)}: axis x starts with the last good table"
    plan = last_plan(state)
    assert plan is not None
    assert plan.plan.lines[0].axes[0].table.max_correction() == 0.1  # type: ignore[union-attr]


def test_who_goes_out_of_the_file_of_signers_takes_no_correction_away(compiled: Path, bob: Signer) -> None:
    (compiled.parent / "signers").write_text(bob.line())
    assert "does not allow" in refused(compiled).found
    assert source(compiled) is TableSource.KEPT


def test_a_table_that_came_without_signature_does_not_stay_when_one_is_asked_for(config: Path) -> None:
    signature = signature_path(table(config))
    content = signature.read_bytes()
    signature.unlink()
    compile_into_state(load(written(config.parent, PLAIN)))
    written(config.parent, SIGNED)
    assert source(config) is TableSource.REFUSED
    assert source(config, frozenset({"x"})) is TableSource.REFUSED  # not while its file is saved either
    signature.write_bytes(content)
    assert source(config) is TableSource.FILE


def test_a_removed_table_is_removed_signed_or_not(compiled: Path) -> None:
    table(compiled).unlink()
    assert source(compiled) is TableSource.ABSENT


def test_a_recording_is_replayed_where_nobody_has_signed_anything(config: Path) -> None:
    (only,) = plan_of(header_of(load(config))).lines
    assert only.axes[0].table is not None
