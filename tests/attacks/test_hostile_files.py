"""No file of an operator costs more than half a second and a hundred megabytes, whatever is in it.

Times are printed by `python -m tests.attacks files`, which reads every file. Here memory and the
outcome are tested; of the kinds that share a reader of YAML, each is given a third of the tricks.
"""

from itertools import count
from pathlib import Path
from typing import Any, cast

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from pa_console.policy.rulebook import load_rules
from pa_console.resources import find_data
from pa_console.schema.document import MOST_BYTES, MOST_DEPTH, MOST_NODES, Document, DocumentError
from pa_console.sim.worlds.world_file import load_world
from tests.attacks.hostile_files import KINDS, bomb
from tests.attacks.read_hostile import costs

pytestmark = [pytest.mark.long, pytest.mark.invariant]

WORKFLOW = """\
name: own
rules:
  - id: WF-01
    domain: WF
    priority: medium
    text: "One after the other."
workflows:
  - id: own
    rule: WF-01
    starts: "true"
    phases:
      - name: first
        command: COMMAND
        done: "true"
"""


@pytest.mark.parametrize("kind", KINDS)
def test_every_hostile_file_is_read_or_refused_within_its_limits(kind: str) -> None:
    found = list(costs(kind, every=1 if kind in ("rules", "signature") else 3))
    assert len(found) > 15
    assert not [cost for cost in found if cost.amiss]


@pytest.mark.parametrize("kind", ["rules", "world", "scenario", "missions", "settings", "event"])
def test_a_bomb_is_refused_with_its_line(kind: str) -> None:
    with pytest.raises(DocumentError, match="each alias counted") as refused:
        Document(f"{kind}.yaml", bomb(9))
    assert refused.value.line == 5


class _Tree:
    """Draws YAML text with anchors and aliases, and what it holds in full."""

    def __init__(self, data: st.DataObject) -> None:
        self._draw, self._anchors, self._names = data.draw, dict[str, object](), count()

    def drawn(self, depth: int = 0) -> tuple[str, object]:
        """Return a value in flow style, and the value."""
        kinds = ["scalar", "alias", "list", "map"] if depth < 5 else ["scalar", "alias"]
        match self._draw(st.sampled_from(kinds)):
            case "alias" if self._anchors:
                name = self._draw(st.sampled_from(sorted(self._anchors)))
                return f"*{name} ", self._anchors[name]
            case "list":
                parts = [self.drawn(depth + 1) for _ in range(self._draw(st.integers(0, 4)))]
                text, value = f"[{', '.join(t for t, _ in parts)}]", [v for _, v in parts]
            case "map":
                pairs = [self.drawn(depth + 1) for _ in range(self._draw(st.integers(0, 4)))]
                text = "{" + ", ".join(f"k{n}: {t}" for n, (t, _) in enumerate(pairs)) + "}"
                value = {f"k{n}": v for n, (_, v) in enumerate(pairs)}
            case _:
                value = self._draw(st.sampled_from(["x", 7, True, None, 1.5]))
                text = yaml.safe_dump(value).split("\n")[0]
        if self._draw(st.booleans()):
            name = f"a{next(self._names)}"
            self._anchors[name] = value
            text = f"&{name} {text}"
        return text, value


def _read(text: str) -> Document | None:
    """Return the document that `text` is, None when it is refused."""
    try:
        return Document("any.yaml", text)
    except DocumentError:
        return None


def _inner(value: Any) -> list[Any]:
    """Return what stands directly in a list or a mapping."""
    if isinstance(value, dict):
        return list(cast(dict[str, Any], value).values())
    return cast(list[Any], value) if isinstance(value, list) else []


def _size(value: object) -> int:
    """Return how many keys and values there are in `value`."""
    keys = len(cast(dict[str, object], value)) if isinstance(value, dict) else 0
    return 1 + keys + sum(map(_size, _inner(value)))


def _height(value: object) -> int:
    inner = _inner(value)
    return isinstance(value, list | dict) + max(map(_height, inner), default=0)


@given(st.data())
@settings(deadline=None)
def test_a_document_is_what_yaml_says_or_is_refused(data: st.DataObject) -> None:
    text, value = _Tree(data).drawn()
    small = _size(value) <= MOST_NODES and _height(value) <= MOST_DEPTH
    document = _read(text)
    assert (document is not None) == small
    assert document is None or document.value == value


@given(st.integers(1, 40), st.integers(1, 40), st.integers(2, 12))
@settings(deadline=None)
def test_aliases_count_as_often_as_they_are_used(width: int, uses: int, levels: int) -> None:
    text = "a0: &a0 [" + "x, " * width + "]\n"
    for level in range(1, levels):
        text += f"a{level}: &a{level} [" + f"*a{level - 1}, " * uses + "]\n"
    held = [width + 1]
    for _ in range(1, levels):
        held.append(1 + uses * held[-1])
    small = 1 + levels + sum(held) <= MOST_NODES
    assert (_read(text) is not None) == small


def test_the_honest_anchors_of_mission_sets_still_load() -> None:
    text = "setup: &s [{kind: spawn, gate: EastGate}]\nmissions:\n" + "- {setup: *s}\n" * 500
    value = Document("set.yaml", text).value
    assert isinstance(value, dict)
    assert len(value["missions"]) == 500  # pyright: ignore[reportArgumentType]


def test_a_file_that_is_too_long_or_no_file_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "long.yaml"
    path.write_bytes(b"#" * (MOST_BYTES + 1))
    with pytest.raises(DocumentError, match="longer than 1,000,000 bytes"):
        load_rules(path)
    with pytest.raises(DocumentError, match="not a regular file"):
        load_world(Path("/dev/zero"))


@pytest.mark.parametrize(
    "command",
    ["{track:>3000000000}", "{track.__class__}", "{track[0]}", "{track!r:>99}", "{0}", "{}", "{{",
     "{track:{gate}}", "{ track }", "{gates}", "}"],
)  # fmt: skip
def test_placeholders_cannot_format(command: str, tmp_path: Path) -> None:
    path = tmp_path / "rules.yaml"
    path.write_text(WORKFLOW.replace("COMMAND", f'"Go to {command}"'))
    with pytest.raises(DocumentError, match=r"only \{track\} and") as refused:
        load_rules(path)
    assert refused.value.line == 13
    assert refused.value.field == "workflows.0.phases.0.command"


def test_a_name_that_is_put_in_is_not_read_again(tmp_path: Path) -> None:
    path = tmp_path / "rules.yaml"
    path.write_text(WORKFLOW.replace("COMMAND", '"Watch {track} at {gate}."'))
    (flow,) = load_rules(path).workflows
    assert flow.workflow.phases[0].mission("{gate}", "East") == "Watch {gate} at East."


def test_every_file_that_is_shipped_stays_far_from_the_limits() -> None:
    rules = find_data("rules", "checkpoint", "rules.yaml")
    world = find_data("worlds", "checkpoint", "world.yaml")
    files = [*rules.parent.glob("**/*.yaml"), *world.parent.parent.glob("**/*.yaml")]
    assert len(files) > 10
    for path in files:
        document = Document.read(path)
        assert document.value == yaml.safe_load(path.read_text(encoding="utf-8"))
        assert _size(document.value) < MOST_NODES / 4
