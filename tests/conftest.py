"""Nothing that the user of this machine has chosen reaches a test."""

import os
from collections.abc import Iterator

import pytest

from pa_console.settings.schema import describe_settings

KEPT = ("cache",)
"""The tests' model is looked for where the user keeps models."""


@pytest.fixture(scope="session", autouse=True)
def _no_settings_of_the_users(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, setting in describe_settings().items():
            if name not in KEPT and setting.variable in os.environ:
                patch.delenv(setting.variable)
        file = tmp_path_factory.mktemp("settings") / "settings.yaml"
        patch.setenv("PA_CONSOLE_SETTINGS", str(file))
        yield
