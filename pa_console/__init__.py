"""PA Console: command a team of robots in plain language, safely, on an edge computer."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("pa-console")
except PackageNotFoundError:
    __version__ = "0.0.0"
