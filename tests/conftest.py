"""What all tests share."""

import os

# as `dehyst` itself does, before numpy is imported
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

from pathlib import Path

import pytest

from dehyst.daemon import kernelcache

ROOT = Path(__file__).resolve().parent.parent
kernelcache.drop_stale()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder with recordings/ and concealed/: $DEHYST_DATA, else ../shared beside the project."""
    folder = Path(os.environ.get("DEHYST_DATA") or ROOT.parent / "shared")
    if not (folder / "recordings").is_dir():
        pytest.skip(f"no recordings in {folder}; set DEHYST_DATA to the folder that holds them")
    return folder
