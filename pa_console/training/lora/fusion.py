"""Element-wise steps compiled into one loop: each reads and writes its tensors once.

Needs a C++ compiler; where that fails, the steps are computed one by one, as they are written.
"""

import logging
from collections.abc import Callable
from typing import Any, TypeVar

import torch

torch._dynamo.config.suppress_errors = True
torch._logging.set_logs(dynamo=logging.ERROR)

F = TypeVar("F", bound=Callable[..., Any])


def fused(function: F) -> F:
    """Return `function` compiled at its first call, for tensors of any length."""
    return torch.compile(function, dynamic=True)
