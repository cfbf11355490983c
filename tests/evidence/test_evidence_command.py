"""``pitch-gateway evidence``: the folder as an auditor gets it, and why it is refused."""

import hashlib
import json
import re
import tomllib
from pathlib import Path

import pytest

from gateway.commissioning.evidence.folder import Evidence, EvidenceError, gather, without_secrets, write
from gateway.config.findings import read_document
from gateway.config.load import load
from gateway.drives import library
from gateway.state.interventions import Intervention, files_in
from tests.support.commands import Typed, typed
from tests.support.config import RAMP, axis, gateway_toml, line, one_axis, section, tcp
from tests.support.config import written as written_config
from tests.support.interventions import written as written_journal
from tests.support.signing import Signer, needs_ssh_keygen

SECRET = "marker-of-a-secret"
PEM = f"-----BEGIN PRIVATE KEY-----\n{SECRET}\n-----END PRIVATE KEY-----\n" + SECRET * 20
FILES_OF_SECRETS = ("people.token", "page.key", "mqtt.password", "mqtt.key", "modbus.key")
CERTIFICATES = {"certificate": "cert.pem", "clients": "ca.pem"}
TLS = {**CERTIFICATES, "key": "modbus.key"}
PAGE = {
    "listen": "127.0.0.1:8480",
    "tokens": [{"name": "people", "file": "people.token"}, {"name": "panel", "file": "credential:panel"}],
    "tls": {**CERTIFICATES, "key": "page.key"},
}
BROKER = {
    "username": "mill",
    "password_file": "mqtt.password",
    "tls": {"cert": "cert.pem", "key": "mqtt.key"},
}
CNC = {**tcp(5021), "tls": TLS, "roles": {"Operator": {"role": "motion"}}}
GUARDED = (
    f"# The password of the broker was {SECRET} once.\n"
    + section("[gateway]", {"name": "mill-1"})
    + section("[http]", PAGE)
    + section("[mqtt]", BROKER)
    + line(5020, {"cnc": CNC})
    + axis(compensation="on", table="x.tab")
    + f"# {SECRET}\n"
)


def written(folder: Path, text: str = GUARDED) -> Path:
    """Write a configuration with a secret in each of its files, and a journal of two entries."""
    config = written_config(folder, text)
    for name in FILES_OF_SECRETS:
        (folder / name).write_text(PEM)
    (folder / "state").mkdir()
    written_journal(
        folder / "state" / "interventions",
        Intervention("table", "file", "x", "x.tab", "1" * 64, "2" * 64),
        Intervention("gain", "socket", "x", None, 1.0, 0.5, {"user": "anna"}),
    )
    return config


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Typed]:
    """A folder, its configuration, and what the command said with --json."""
    config = written(tmp_path_factory.mktemp("machine"))
    out = config.parent / "evidence"
    return out, config, typed("evidence", str(config), "--out", str(out), "--json")


def names(out: Path) -> set[str]:
    return {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}


def test_it_has_every_part_and_only_its_user_may_read_it(made: tuple[Path, Path, Typed]) -> None:
    out, config, said = made
    assert said.returncode == 0
    assert names(out) == {
        *("INDEX.md", "manifest.sha256", "sbom.cdx.json", "vex.cdx.json", "journal.jsonl"),
        *("iec-62443-4-2.md", "iec-62443-4-2.csv", "limits.md", "substantial-modification.md"),
        *("configuration.toml", "tables/x.tab", "tables/x-x.tab.html"),
    }
    for path in (out, *out.rglob("*")):
        assert path.stat().st_mode & 0o077 == 0, path
    assert (out / "tables" / "x.tab").read_bytes() == (config.parent / "tables" / "x.tab").read_bytes()
    assert not list(config.parent.glob(".evidence*"))


def test_each_digest_is_right(made: tuple[Path, Path, Typed]) -> None:
    out, config, said = made
    digests = {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in names(out)}
    rows = (out / "manifest.sha256").read_text().splitlines()
    manifest = {name: digest for digest, name in (row.split("  ") for row in rows)}
    assert manifest == {name: digest for name, digest in digests.items() if name != "manifest.sha256"}
    index = (out / "INDEX.md").read_text()
    listed = dict(re.findall(r"^\| `(\S+)` \| .+ \| `([0-9a-f]{64})` \|$", index, re.MULTILINE))
    assert listed == {name: digest for name, digest in manifest.items() if name != "INDEX.md"}
    assert {each["name"]: each["sha256"] for each in json.loads(said.stdout)["files"]} == digests
    assert hashlib.sha256(config.read_bytes()).hexdigest() in index


def test_no_secret_is_in_any_file_nor_said(made: tuple[Path, Path, Typed]) -> None:
    out, _, said = made
    for name in names(out):
        assert SECRET.encode() not in (out / name).read_bytes(), name
    assert SECRET not in said.stdout + said.stderr


def test_the_configuration_keeps_its_values_and_the_paths_of_secrets(made: tuple[Path, Path, Typed]) -> None:
    out, config, _ = made
    text = (out / "configuration.toml").read_text()
    assert tomllib.loads(text) == tomllib.loads(config.read_text())
    assert "#" not in text


def test_the_journal_is_whole_and_its_result_stands_in_the_index(made: tuple[Path, Path, Typed]) -> None:
    out, config, _ = made
    [kept] = files_in(config.parent / "state" / "interventions")
    assert (out / "journal.jsonl").read_bytes() == kept.read_bytes()
    verified = typed("journal", "verify", str(out / "journal.jsonl"))
    assert verified.returncode == 0
    index = (out / "INDEX.md").read_text()
    assert all(f"- {said}\n" in index for said in verified.stdout.splitlines())


def test_settings_are_judged_against_this_configuration(made: tuple[Path, Path, Typed]) -> None:
    text = (made[0] / "iec-62443-4-2.md").read_text()
    assert "| CR 1.1 People are identified and authenticated | met with this setting: set here<br>" in text
    assert "`line.controllers.tls.revoked`: not set<br>`http.tls.revoked`: not set |" in text
    assert "| CR 3.6 Outputs have a known state when it fails | met with this setting: not set here" in text


def test_forms_have_the_facts_and_nothing_is_invented(made: tuple[Path, Path, Typed]) -> None:
    out, config, _ = made
    digest = hashlib.sha256(config.read_bytes()).hexdigest()
    form = (out / "substantial-modification.md").read_text()
    assert f"| configuration | SHA-256 `{digest}` |" in form
    # 0.5 mm is the default of max_correction for 100 mm of travel.
    assert "| x | 0 to 100 mm | on | 0.5 mm | " in form
    assert "| its manufacturer | |" in form
    assert "| x | 0.5 mm |" in (out / "limits.md").read_text()
    index = (out / "INDEX.md").read_text()
    assert "| support until | not filled in |\n| answers within 24 hours | not filled in |" in index
    assert "| gateway | mill-1 |" in index


def test_the_owner_is_asked_in_the_list_of_the_owner() -> None:
    places = (Path(__file__).parents[2] / ".github" / "OWNER.md").read_text()
    assert "| `gateway/commissioning/evidence/owner.toml` |" in places


@pytest.mark.parametrize("typed_in", [SECRET, PEM], ids=["a password", "a key"])
@pytest.mark.parametrize("name", FILES_OF_SECRETS)
def test_a_secret_that_stands_in_place_of_its_file_is_taken_out(
    tmp_path: Path, name: str, typed_in: str
) -> None:
    config = written(tmp_path, GUARDED.replace(json.dumps(name), json.dumps(typed_in)))
    text = without_secrets(read_document(config))
    assert SECRET not in text
    assert text.count('"taken out: names no file"') == 1
    assert all(json.dumps(other) in text for other in FILES_OF_SECRETS if other != name)


def test_what_is_not_whole_is_said_and_the_rest_is_written(tmp_path: Path) -> None:
    config = written(tmp_path)
    [journal] = files_in(tmp_path / "state" / "interventions")
    journal.write_bytes(journal.read_bytes().replace(b'"axis":"x"', b'"axis":"y"', 1))
    (tmp_path / "tables" / "x.tab").write_text("no table\n")
    out = tmp_path / "evidence"
    out.mkdir()
    said = typed("evidence", str(config), "--out", str(out))
    assert said.returncode == 1
    assert said.stdout == f"{out}: 11 files; begin with INDEX.md\n"
    index = (out / "INDEX.md").read_text()
    for start in ("journal: 000001.jsonl:1: entry 1 was changed", f"axis x: {tmp_path}/tables/x.tab:1: "):
        assert f"\n- {start}" in index
        assert f"\n{start}" in f"\n{said.stderr}"
    assert "- not whole: see above\n" in index
    assert (out / "tables" / "x.tab").read_text() == "no table\n"
    assert "tables/x-x.tab.html" not in names(out)


def test_a_table_that_is_gone_is_said_and_the_rest_is_there(tmp_path: Path) -> None:
    config = written_config(tmp_path, one_axis(5020, 5021), {"other.tab": RAMP})
    made = gather(load(config, forgives_tables=True), lambda step: None)
    [problem] = made.problems
    lines = config.read_text().splitlines()
    number = lines.index('table = "x.tab"') + 1
    assert problem.startswith(
        f"axis x: {config}:{number}: axis.x.table: there is no x.tab in {tmp_path}/tables; "
    )
    assert not [name for name in made.files if name.startswith("tables/")]


def test_each_step_is_said_and_what_check_warns_of_and_each_named_file_is_there(tmp_path: Path) -> None:
    text = gateway_toml(
        line(5020, {"cnc": {"tcp": "0.0.0.0:5021", "role": "motion"}}),
        axis(compensation="on", table="x.tab", cross=[{"axis": "y", "table": "xy.tab"}]),
        axis("y", None, unit_id=2, compensation="off", drive="./drives/mine.toml"),
    )
    config = written_config(tmp_path, text, {"x.tab": RAMP, "xy.tab": RAMP})
    (tmp_path / "drives").mkdir()
    drive = library.text_of("oriental-az").encode()
    (tmp_path / "drives" / "mine.toml").write_bytes(drive)
    steps: list[str] = []
    made = gather(load(config), steps.append)
    assert steps == ["journal of interventions", "what is installed", "IEC 62443-4-2", "table x.tab"]
    assert made.problems == []
    where = tmp_path / "state" / "interventions"
    assert f"{where}: there is no journal; the supervisor begins one when it first runs" in made.notes
    [warning] = [note for note in made.notes if "may move the drives" in note]
    index = made.files["INDEX.md"].decode()
    assert f"\n- {warning}\n" in index
    assert "## Journal of interventions\n\n- none\n" in index
    assert "journal.jsonl" not in made.files
    assert made.files["drives/drives_mine.toml"] == drive
    assert made.files["tables/xy.tab"] == RAMP.encode()
    assert "| `tables/xy.tab` | correction table | `" in index


def refused(config: Path, out: Path) -> str:
    before = sorted(config.parent.rglob("*"))
    said = typed("evidence", str(config), "--out", str(out))
    assert (said.returncode, said.stdout) == (1, "")
    assert sorted(config.parent.rglob("*")) == before
    return said.stderr


def test_a_folder_that_cannot_be_made_is_named_with_the_remedy(tmp_path: Path) -> None:
    config = written_config(tmp_path, one_axis(5020, 5021))
    assert refused(config, tmp_path) == f"{tmp_path}: the folder is not empty; name a new one, or empty it\n"
    assert refused(config, config) == f"{config}: this is no folder; name a new one\n"
    missing = tmp_path / "a" / "b"
    assert refused(config, missing) == f"{missing}: make the folder {missing.parent} first: there is none\n"


def test_a_configuration_with_a_problem_is_named_as_check_does(tmp_path: Path) -> None:
    config = written_config(tmp_path, one_axis(5020, 5021).replace('units = "mm"', 'units = "m"'))
    assert refused(config, tmp_path / "out") == typed("check", str(config)).stderr
    missing = tmp_path / "missing.toml"
    assert refused(missing, tmp_path / "out") == typed("check", str(missing)).stderr


def test_a_folder_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    out = tmp_path / "out"
    # The second file needs a folder where the first one is.
    with pytest.raises(EvidenceError, match=r"^\S+/out: .+; name a new folder of your own$"):
        write(Evidence({"a": b"", "a/b": b""}), out)
    assert list(tmp_path.iterdir()) == []
    # Something came into the folder after it was checked: it stays.
    out.mkdir()
    (out / "mine").touch()
    with pytest.raises(EvidenceError, match="Directory not empty"):
        write(Evidence({"a": b""}), out)
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "mine"]


def parts_of(config: Path) -> Evidence:
    return gather(
        load(config, checks_times=False, forgives_tables=True, is_elsewhere=True), lambda _line: None
    )


def test_included_files_are_merged_and_listed_with_their_digests(tmp_path: Path) -> None:
    plant = tmp_path / "plant.toml"
    plant.write_text(f"# {SECRET}\n[axis.x]\nmax_slope = 0.005\n")
    made = parts_of(written(tmp_path, f'include = ["plant.toml"]\n{GUARDED}'))
    configuration = made.files["configuration.toml"].decode()
    assert tomllib.loads(configuration)["axis"]["x"]["max_slope"] == 0.005
    assert SECRET not in configuration
    digest = hashlib.sha256(plant.read_bytes()).hexdigest()
    assert f"| included files | `{plant}`, SHA-256 `{digest}` |" in made.files["INDEX.md"].decode()


@needs_ssh_keygen
def test_signatures_are_there_and_the_index_says_whose_they_are(tmp_path: Path) -> None:
    eva = Signer(tmp_path, "eva")
    (tmp_path / "signers").write_text(eva.line())
    signed = GUARDED.replace('name = "mill-1"', 'name = "mill-1"\nallowed_signers = "signers"', 1)
    config = written(tmp_path, signed)
    assert "x.tab: not signed: there is no x.tab.sig; sign it: " in parts_of(config).problems[0]
    signature = eva.sign(tmp_path / "tables" / "x.tab")
    made = parts_of(config)
    assert made.problems == []
    assert "x.tab: signed by eva@plant" in made.notes
    assert made.files["tables/x.tab.sig"] == signature.read_bytes()
    assert made.files["allowed_signers"] == eva.line().encode()
    assert eva.key.read_bytes() not in made.files.values()
