"""Access depends on the credentials shown and on the address they come from."""

import base64
from pathlib import Path

import pytest

from dehyst.daemon.bus.security import check_page
from dehyst.daemon.config import parse_config
from dehyst.daemon.main import main
from dehyst.daemon.page.people import People, same_origin
from dehyst.models.errors import BadInput

HERE, THERE = "192.0.2.1", "192.0.2.2"


@pytest.fixture
def passwords(tmp_path: Path) -> str:
    path = tmp_path / "passwords"
    path.write_text("alice:correct horse\nbob:battery staple\neve:is not named\n")
    path.chmod(0o600)
    return str(path)


def basic(name: str, password: str) -> dict[str, str]:
    text = base64.b64encode(f"{name}:{password}".encode()).decode()
    return {"authorization": f"Basic {text}"}


def test_on_this_machine_everybody_is_an_operator_or_with_observe_an_observer() -> None:
    assert People("").who({}, "", HERE).commands  # type: ignore[union-attr]
    assert not People("", observe=True).who({}, "", HERE).commands  # type: ignore[union-attr]
    with pytest.raises(BadInput, match="need `passwords`"):
        People("", operators=["alice"])


def test_roles_by_password_and_by_session(passwords: str) -> None:
    people = People(passwords, ["alice"], ["bob"])
    assert people.who({}, "", HERE) is None
    assert people.who({}, "guessed", HERE) is None
    assert people.check("alice", "battery staple", HERE) is None
    assert people.check("eve", "is not named", HERE) is None
    assert people.check("", "", HERE) is None
    alice, bob = (
        people.check("alice", "correct horse", THERE),
        people.check("bob", "battery staple", THERE),
    )
    assert alice is not None
    assert bob is not None
    assert (alice.commands, bob.commands) == (True, False)
    token = people.begin(bob)
    assert len(token) > 30
    assert people.who({}, token, HERE) == bob
    people.finish(token)
    assert people.who({}, token, THERE) is None
    assert people.who(basic("alice", "correct horse"), "", THERE) == alice
    assert people.who(basic("alice", "wrong"), "", THERE) is None
    assert people.who({"authorization": "Basic %%%"}, "", THERE) is None
    looking = People(passwords, ["alice"], ["bob"], observe=True)
    assert looking.check("alice", "correct horse", HERE) is None


@pytest.mark.parametrize(
    ("operators", "observers", "says"),
    [([], [], "nobody could log in"), (["zoe"], [], "zoe: no password")],
)
def test_names_and_passwords_must_fit(
    passwords: str, operators: list[str], observers: list[str], says: str
) -> None:
    with pytest.raises(BadInput, match=says):
        People(passwords, operators, observers)


def test_a_file_that_others_can_read_is_refused(passwords: str) -> None:
    Path(passwords).chmod(0o644)
    with pytest.raises(BadInput, match="read by everybody"):
        People(passwords, ["alice"])


@pytest.mark.parametrize(
    ("origin", "host", "same"),
    [
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("https://stage.lab:8443", "stage.lab:8443", True),
        ("http://127.0.0.1:8081", "127.0.0.1:8080", False),
        ("http://evil.example", "127.0.0.1:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("", "127.0.0.1:8080", False),
        ("http://", "", False),
    ],
)
def test_same_origin(origin: str, host: str, same: bool) -> None:
    assert same_origin({"origin": origin, "host": host}) is same


def test_without_passwords_only_this_machines_names_are_answered(passwords: str) -> None:
    people = People("")
    for host in ("localhost:8080", "127.0.0.1:8080", "[::1]:8080", "LOCALHOST", "[::1]"):
        assert people.knows_host(host), host
    for host in ("evil.example", "evil.example:8080", "127.0.0.1.evil.example:8080", ""):
        assert not people.knows_host(host), host
    assert People(passwords, ["alice"]).knows_host("stage.lab:8443")


def test_beyond_loopback_only_with_tls_and_passwords() -> None:
    check_page("127.0.0.1:8080", "", "", "")
    check_page("[::1]:8080", "", "", "")
    check_page("0.0.0.0:8443", "c.pem", "k.pem", "passwords")
    for given in (("", "", ""), ("c.pem", "k.pem", ""), ("", "", "passwords")):
        with pytest.raises(BadInput, match="anybody could move the stage"):
            check_page("0.0.0.0:8443", *given)
    with pytest.raises(BadInput, match="go together"):
        check_page("127.0.0.1:8443", "c.pem", "", "")
    for wrong in ("8080", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:http", "127.0.0.1:99999"):
        with pytest.raises(BadInput, match="is not an address"):
            check_page(wrong, "", "", "")


def test_the_command_says_so_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["page", "--listen", "0.0.0.0:8080"]) == 2
    said = capsys.readouterr().err
    assert "anybody could move the stage" in said
    assert said.count("\n") == 1
    assert main(["page", "--config", "x.toml", "--observe"]) == 2
    assert "--observe cannot be combined with --config" in capsys.readouterr().err


MINIMAL = """
name = "a"
model = {file = "m"}
actuator = {driver = "x"}
sensor = {driver = "x"}
limits = {min_v = 0.0, max_v = 1.0, slew_v_per_s = 1.0}
safe = {ramp_v_per_s = 1.0}
"""


def test_the_configuration_may_name_a_page() -> None:
    assert parse_config(MINIMAL).page is None
    page = parse_config(MINIMAL + "[page]\n").page
    assert page is not None
    assert page.listen == "127.0.0.1:8080"
    with pytest.raises(BadInput, match="page"):
        parse_config(MINIMAL + "[page]\nlissten = ''\n")
    with pytest.raises(BadInput, match="anybody could move"):
        parse_config(MINIMAL + "[page]\nlisten = '0.0.0.0:80'\n")
