"""The daemon's configuration: one TOML file. Unknown keys are errors; every value is checked."""

from dehyst.daemon.config.controller import Controller, load_config, load_controller
from dehyst.daemon.config.file import parse_config
from dehyst.daemon.config.sections import (
    ActuatorConfig,
    AuthConfig,
    BusConfig,
    ChannelConfig,
    Config,
    LoopConfig,
    PageConfig,
    SafeConfig,
    SetpointConfig,
    TrimConfig,
)

__all__ = (
    "ActuatorConfig",
    "AuthConfig",
    "BusConfig",
    "ChannelConfig",
    "Config",
    "Controller",
    "LoopConfig",
    "PageConfig",
    "SafeConfig",
    "SetpointConfig",
    "TrimConfig",
    "load_config",
    "load_controller",
    "parse_config",
)
