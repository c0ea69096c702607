"""The security page names a test that exists for each attacker that anything is guarded against."""

import re
from pathlib import Path

import pa_console
from pa_console.manual_pages import load_manual

ROOT = Path(pa_console.__file__).parents[1]
UNGUARDED = "The operator's own account and the kernel"
ENTRY = re.compile(r"^- \*\*(.+?)\*\*(.*?)(?=^- |\Z)", re.DOTALL | re.MULTILINE)
TEST = re.compile(r"^(async )?def test_|^Test\w+ = ", re.MULTILINE)


def attackers() -> dict[str, list[str]]:
    """Return the tests that the page names for each attacker."""
    page = load_manual().find("security").text
    section = page.partition("\n## Attackers\n")[2].partition("\n## ")[0]
    return {name: re.findall(r"`([^`]+)`", text) for name, text in ENTRY.findall(section)}


def test_each_attacker_has_a_test_that_exists() -> None:
    found = attackers()
    assert len(found) > 15
    assert found.pop(UNGUARDED) == []
    assert [attacker for attacker, tests in found.items() if not tests] == []
    named = {test for tests in found.values() for test in tests}
    assert [test for test in sorted(named) if not (ROOT / test).is_file()] == []
    assert [test for test in named if not TEST.search((ROOT / test).read_text("utf-8"))] == []
