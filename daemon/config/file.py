"""Turn TOML text into a checked Config of one axis: the only one, or one of several."""

from pathlib import Path
from typing import Any, TypeVar

import msgspec

from dehyst.daemon.bus.security import check_open, check_page, check_routers
from dehyst.daemon.config.checked_tables import check_tables
from dehyst.daemon.config.sections import Config, ModelConfig
from dehyst.daemon.input_file import NotReadable, read_text
from dehyst.daemon.prepared import resolve_classes
from dehyst.models.errors import BadInput
from dehyst.models.modelfile import SHIPPED
from dehyst.models.toml_text import parse_toml

LARGEST_BYTES = 1 << 18  # a configuration has a few kB; a larger file is another one
Section = TypeVar("Section", bound=msgspec.Struct)
resolve_classes(Config)


def read_tables(path: Path) -> dict[str, Any]:
    """Read the tables of a configuration file. Raises BadInput."""
    try:
        text = read_text(path, LARGEST_BYTES)
    except NotReadable as error:
        raise BadInput(f"{path}: cannot be read: {error}") from None
    return _tables(text, str(path))


def parse_config(text: str, where: str = "configuration") -> Config:
    """Parse the TOML text of one axis. Raises BadInput naming the key."""
    data = _tables(text, where)
    if isinstance(data.get("axis"), dict):
        raise BadInput(f"{where}: it has several axes; choose one")
    return checked_config(data, where)


def checked_config(data: dict[str, Any], where: str) -> Config:
    """Convert tables to a Config and check it. Raises BadInput naming the key."""
    check_tables(Config, data, where)
    config = msgspec.convert(data, Config, strict=True)
    _check(config, where)
    return config


def resolved_config(config: Config, folder: Path) -> Config:
    """Return the config with its relative paths resolved against the folder of its file."""
    name = config.model.file
    model = folder / name
    # a file that is nowhere is named with the folder in which it was looked for
    if model.exists() or not (Path(name).exists() or name in SHIPPED):
        config = msgspec.structs.replace(config, model=ModelConfig(file=str(model.resolve())))
    if config.bus.auth is not None:
        files = ("passwords", "certificates", "credentials")
        auth = _resolved(config.bus.auth, folder, *files)
        bus = msgspec.structs.replace(config.bus, auth=auth)
        config = msgspec.structs.replace(config, bus=bus)
    if config.page is not None:
        page = _resolved(config.page, folder, "certificate", "key", "passwords", "credentials")
        config = msgspec.structs.replace(config, page=page)
    return config


def _tables(text: str, where: str) -> dict[str, Any]:
    try:
        return parse_toml(text)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None


def _check(config: Config, where: str) -> None:
    limits, safe = config.limits, config.safe
    if limits.max_v <= limits.min_v:
        raise BadInput(f"{where}: limits.max_v must be greater than limits.min_v")
    if not limits.min_v <= safe.voltage_v <= limits.max_v:
        raise BadInput(
            f"{where}: safe.voltage_v is {safe.voltage_v:g} V, outside the limits "
            f"{limits.min_v:g} to {limits.max_v:g} V"
        )
    if safe.ramp_v_per_s > limits.slew_v_per_s:
        raise BadInput(
            f"{where}: safe.ramp_v_per_s ({safe.ramp_v_per_s:g}) is faster than "
            f"limits.slew_v_per_s ({limits.slew_v_per_s:g})"
        )
    try:
        check_routers(config.bus.listen, config.bus.connect, config.bus.auth)
        check_open(config.bus.listen, config.bus.auth is not None)
        if (page := config.page) is not None:
            check_page(page.listen, page.certificate, page.key, page.passwords, page.public_url)
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from None
    doctor = config.doctor
    if doctor.trial_limit_s is not None and doctor.trial_limit_s < doctor.trial_s:
        raise BadInput(
            f"{where}: doctor.trial_limit_s ({doctor.trial_limit_s:g}) is shorter than "
            f"doctor.trial_s ({doctor.trial_s:g}): no trial could see enough motion"
        )
    if config.sensor.scale == 0:
        raise BadInput(f"{where}: sensor.scale must not be 0")
    for name, channel in config.channels.items():
        if bool(channel.driver) == bool(channel.axis):
            raise BadInput(
                f"{where}: channels.{name} needs one of `driver` (a sensor) and `axis` (another "
                "axis of this amplifier)"
            )
        if channel.axis and channel.axis == config.axis:
            raise BadInput(f"{where}: channels.{name} follows its own axis {channel.axis}")
        if channel.axis and not config.axis:
            raise BadInput(
                f"{where}: channels.{name} follows axis {channel.axis}, and this controller has "
                "one axis only"
            )


def _resolved(section: Section, folder: Path, *keys: str) -> Section:
    """Return the section with the paths in `keys` resolved against `folder`."""
    paths = {key: str(folder.resolve() / value) for key in keys if (value := getattr(section, key))}
    return msgspec.structs.replace(section, **paths)
