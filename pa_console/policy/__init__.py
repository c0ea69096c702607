"""The rulebook, its retrieval and its deterministic checks, independent of the simulator."""

import sys
from types import ModuleType

# Importing the CEL library also imports its command line and a line editor, which takes a tenth of
# the console's start-up time. The console uses neither.
sys.modules.setdefault("cel.cli", ModuleType("cel.cli"))
