"""All controllers of one console, by the names that the registry of actions calls them."""

from dataclasses import dataclass

from pa_console.tui.controllers.approval import ApprovalController
from pa_console.tui.controllers.browsing import BrowsingController
from pa_console.tui.controllers.commands import CommandController
from pa_console.tui.controllers.composing import ComposingController
from pa_console.tui.controllers.copying import CopyController
from pa_console.tui.controllers.leaving import LeavingController
from pa_console.tui.controllers.replay import ReplayController
from pa_console.tui.controllers.rules import RulesController
from pa_console.tui.controllers.settings import SettingsController


@dataclass(frozen=True)
class Controllers:
    """The controllers of the operator's actions."""

    browsing: BrowsingController
    composing: ComposingController
    copying: CopyController
    replay: ReplayController
    commands: CommandController
    approval: ApprovalController
    rules: RulesController
    settings: SettingsController
    leaving: LeavingController
