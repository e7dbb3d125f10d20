"""The model of the simulated stage, identified once in each process of the tests."""

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from dehyst.daemon.bench.simulated import simulated_model
from dehyst.daemon.files.models import save_model
from dehyst.models.model import Model


@cache
def kept_model() -> Model:
    """Return the model of the default stage; it must not be changed."""
    return simulated_model()


@cache
def model_text() -> str:
    """Return the model in its file format."""
    with TemporaryDirectory() as folder:
        save_model(kept_model(), Path(folder) / "model.toml")
        return (Path(folder) / "model.toml").read_text()
