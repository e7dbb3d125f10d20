"""The service that the tests of this folder end, kill and damage."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.rigs.service import Service


@pytest.fixture
def service(tmp_path: Path, model: Path) -> Iterator[Service]:
    """`dehyst run` on the emulated bench, not yet started."""
    service = Service(tmp_path, model)
    try:
        yield service
    finally:
        service.close()
