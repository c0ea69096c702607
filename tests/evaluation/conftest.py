"""The shipped checkpoint, loaded once."""

import pytest

from pa_console.station.assembly import Site, load_site


@pytest.fixture(scope="session")
def site() -> Site:
    """Return the checkpoint with its rules."""
    return load_site("checkpoint", "checkpoint")
