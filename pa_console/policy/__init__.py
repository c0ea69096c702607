"""The rulebook, its retrieval and its deterministic checks; it knows no simulator."""

import sys
from types import ModuleType

# The CEL library imports its own command line, and with it an editor of command lines: a tenth of
# the console's start. Nothing of it is used here.
sys.modules.setdefault("cel.cli", ModuleType("cel.cli"))
