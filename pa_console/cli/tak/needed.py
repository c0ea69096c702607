"""Names the library that a TAK map needs and that is not installed."""

from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def naming_what_is_missing() -> Generator[None]:
    """Raise ValueError with the package to install when an import in the block fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ValueError(
            f"TAK maps need a library that is not installed ({error.name}): "
            "pip install 'pa-console[tak]'"
        ) from error
