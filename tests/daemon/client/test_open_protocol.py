"""Settings that the EPICS and GCS servers refuse before they listen; no daemon is needed."""

import pytest

from dehyst.daemon.main import main

SERVERS = (("epics",), ("serve", "--as", "gcs"))


@pytest.mark.parametrize("server", SERVERS, ids=lambda words: words[0])
@pytest.mark.parametrize("tolerance", ["-0.1", "-1e-9"])
def test_a_tolerance_that_no_stage_can_meet_is_refused(
    capsys: pytest.CaptureFixture[str], server: tuple[str, ...], tolerance: str
) -> None:
    assert main([*server, f"--tolerance={tolerance}"]) == 2
    assert "--tolerance" in capsys.readouterr().err


@pytest.mark.parametrize("server", SERVERS, ids=lambda words: words[0])
@pytest.mark.parametrize("host", ["0.0.0.0", "192.168.1.10", "::", "10.0.0.5"])
def test_an_address_beyond_this_machine_needs_leave(
    capsys: pytest.CaptureFixture[str], server: tuple[str, ...], host: str
) -> None:
    listen = host if server == ("epics",) else f"[{host}]:50000" if ":" in host else f"{host}:50000"
    assert main([*server, "--listen", listen]) == 2
    said = capsys.readouterr().err
    assert "has no passwords" in said
    assert "--without-passwords" in said
    assert len(said.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("server", "listen"),
    [
        (("epics",), "loopback"),
        (("serve", "--as", "gcs"), "127.0.0.1"),
        (("serve", "--as", "gcs"), "127.0.0.1:70000"),
    ],
)
def test_an_address_that_is_none_is_named(
    capsys: pytest.CaptureFixture[str], server: tuple[str, ...], listen: str
) -> None:
    assert main([*server, "--listen", listen]) == 2
    assert f"--listen {listen}: it must be" in capsys.readouterr().err
