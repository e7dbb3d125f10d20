"""Driver plugins: the real ones of this package, and made-up good and bad ones."""

import importlib.metadata
import textwrap

import pytest

from dehyst.drivers import registry
from dehyst.drivers.interface import DriverConfigError
from dehyst.drivers.mdt693b import Mdt693b

PLUGIN = """
    class Good:
        "A good amplifier."
        @classmethod
        def from_settings(cls, settings): return cls()
        def open(self): pass
        def write(self, volts): pass
        def output(self): return 0.0
        def reconnect(self): pass
        def close(self): pass

    class NoWrite:
        @classmethod
        def from_settings(cls, settings): return cls()
        def open(self): pass

    something = 3
"""

ENTRY_POINTS = """
[dehyst.actuators]
good = made_up_plugin:Good
incomplete = made_up_plugin:NoWrite
noclass = made_up_plugin:something
missing = made_up_plugin:Absent
raising = made_up_raising:Any
mdt693b = made_up_plugin:Good
"""


@pytest.fixture
def made_up_plugins(tmp_path, monkeypatch):
    """Install a distribution on sys.path with one good and several broken plugins."""
    (tmp_path / "made_up_plugin.py").write_text(textwrap.dedent(PLUGIN))
    (tmp_path / "made_up_raising.py").write_text("raise RuntimeError('no licence\\nfor this')\n")
    info = tmp_path / "made_up-2.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: made-up\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.invalidate_caches()


def test_the_drivers_of_this_package_are_found():
    names = {(p.kind, p.name) for p in registry.list_plugins()}
    assert {
        ("actuator", name) for name in ("mdt693b", "mdt694b", "kpz101", "kpc101", "bpc303")
    } <= names
    assert {("sensor", name) for name in ("ksg101", "kpc101", "bpc303", "simulated")} <= names
    assert registry.load_actuator("mdt693b") is Mdt693b


def test_an_unknown_name_lists_what_exists():
    with pytest.raises(DriverConfigError, match=r"'nope'.*mdt693b.*simulated"):
        registry.load_actuator("nope")
    with pytest.raises(DriverConfigError, match="no sensor driver 'mdt693b'"):
        registry.load_sensor("mdt693b")


def test_a_plugin_of_another_package_is_found_and_loaded(made_up_plugins):
    assert registry.load_actuator("good").__name__ == "Good"
    plugin = next(p for p in registry.list_plugins() if p.name == "good")
    assert (plugin.package, plugin.error) == ("made-up 2.0", "")
    assert plugin.summary == "A good amplifier."


@pytest.mark.parametrize(
    ("name", "error"),
    [
        ("incomplete", "lacks write, output, reconnect, close"),
        ("noclass", "it is a int, not a class"),
        ("missing", "AttributeError"),
        ("raising", "RuntimeError: no licence for this"),
        ("mdt693b", "the name is also taken by"),
    ],
)
def test_broken_plugins_are_listed_with_their_error(made_up_plugins, name, error):
    listed = [p for p in registry.list_plugins() if p.name == name and p.kind == "actuator"]
    assert all(error in p.error for p in listed)
    assert listed
    with pytest.raises(DriverConfigError, match=error):
        registry.load_actuator(name)
