"""Data of others that isn't part of the project; tests that use it are skipped, and say so, where it isn't there."""

import os
from pathlib import Path

import pytest

# In $BASENET_JAX_DATA, else in `shared/data` beside the checkout.
FOLDER = Path(os.environ.get("BASENET_JAX_DATA") or Path(__file__).parents[2] / "shared" / "data")


def shared_file(name: str) -> Path:
    """A file of it, or the test is skipped."""
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{name} isn't in {FOLDER} (its place is set by BASENET_JAX_DATA)")
    return path
