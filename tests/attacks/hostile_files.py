"""Fifty hostile files of each kind that an operator can be given, each named after its trick.

A kind is what reads it: rules, signature, world, scenario, missions, settings, event.
"""

from collections.abc import Callable, Iterator

KINDS = ("rules", "signature", "world", "scenario", "missions", "settings", "event")
MEGABYTE = 1_000_000

_RULE = """\
- id: ROE-01
  domain: ROE
  priority: critical
  text: "No force."
"""
_HEADS = {
    "rules": "name: own\nrules:\n" + _RULE,
    "signature": "name: own\nversion: ''\n",
    "world": "name: own\ntitle: Own\n",
    "scenario": "name: own\ntitle: Own\nabout: x\n",
    "missions": "name: own\nmissions:\n- {id: a, category: a, command: go}\n",
    "settings": "theme: nord\n",
    "event": "kind: spawn\ngate: EastGate\n",
}
_TEXTS = {
    "rules": "source", "signature": "name", "world": "title", "scenario": "about",
    "missions": "source", "settings": "theme", "event": "name",
}  # fmt: skip
"""A field of each kind that takes text."""


def hostile_files(kind: str) -> dict[str, str]:
    """Return fifty or more files of `kind`, by the name of their trick; none exceeds 1 MB."""
    found = {**dict(_anywhere(_HEADS[kind], _TEXTS[kind])), **dict(_OWN[kind]())}
    assert len(found) >= 50, f"{kind}: {len(found)}"
    assert all(len(text.encode()) <= MEGABYTE for text in found.values())
    return found


def bomb(levels: int, width: int = 10) -> str:
    """Return a list of lists of aliases: `width` to the power of `levels` words."""
    lines = ["a0: &a0 [" + ", ".join(["lol"] * width) + "]"]
    lines += [
        f"a{level}: &a{level} [" + ", ".join([f"*a{level - 1}"] * width) + "]"
        for level in range(1, levels)
    ]
    return "\n".join(lines) + "\n"


def _full(line: Callable[[int], str], size: int = MEGABYTE) -> str:
    """Return as many lines as fit into `size` bytes."""
    parts: list[str] = []
    length = number = 0
    while length + len(new := line(number)) <= size:
        parts.append(new)
        length += len(new)
        number += 1
    return "".join(parts)


def _anywhere(head: str, text: str) -> Iterator[tuple[str, str]]:
    """Yield tricks that need nothing of the kind but a field, or none at all."""
    room = MEGABYTE - len(head.encode()) - 100
    yield "bomb of 9 levels", bomb(9)
    yield "bomb of 9 levels after a sound head", head + bomb(9)
    yield "bomb of 40 levels", bomb(40, 2)
    yield "bomb of merged mappings", head + "".join(
        f"m{n}: &m{n} {{" + ", ".join(f"k{n}x{i}: *m{n - 1}" if n else f"k{i}: 1" for i in range(9))
        + "}\n" for n in range(9)
    )  # fmt: skip
    yield (
        "bomb of '<<'",
        head
        + "m0: &m0 {a: 1}\n"
        + "".join(
            f"m{n}: &m{n} {{<<: [" + ", ".join([f"*m{n - 1}"] * 9) + f"], b{n}: 1}}\n"
            for n in range(1, 9)
        ),
    )
    yield "bomb of one long text", head + f"x: &x '{'x' * 900_000}'\ny: [{'*x, ' * 20_000}]\n"
    yield "bomb in a text field", f"b: &b [[{'x, ' * 9000}]]\n{text}: [{'*b, ' * 9000}]\n"
    yield "alias of itself", f"{text}: &x [*x]\n"
    yield "alias of itself in a mapping", f"{text}: &x {{a: *x}}\n"
    yield "alias of nothing", f"{text}: *x\n"
    yield "alias as key", head + "x: &x a\n*x : 1\n"
    yield (
        "chain of aliases",
        "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}]\n" for n in range(1, 5000)),
    )
    yield "nested lists in a line", f"{text}: " + "[" * room
    yield "nested lists that end", f"{text}: " + "[" * 40_000 + "]" * 40_000
    yield "nested mappings in a line", f"{text}: " + "{a: " * (room // 4)
    yield "nested by dashes", "- " * (room // 2)
    yield "nested by question marks", "? " * (room // 2)
    yield "nested by indent", _full(lambda n: " " * n + "a:\n")
    yield "a megabyte of list", head + f"x: [{'x,' * (room // 2)}]\n"
    yield "a megabyte of dashes", _full(lambda n: "- a\n")
    yield "a megabyte of keys", head + _full(lambda n: f"k{n}: 1\n", room)
    yield "a megabyte of equal keys", head + _full(lambda n: f"{text}: x\n", room)
    yield "a megabyte of anchors", _full(lambda n: f"- &a{n} x\n")
    yield "a megabyte of tags", _full(lambda n: "- !!str a\n")
    yield "a megabyte of documents", _full(lambda n: "--- a\n")
    yield "a megabyte of comments", head + _full(lambda n: "# x\n", room)
    yield "a megabyte of empty lines", head + "\n" * room
    yield "a megabyte of text", f"{text}: '{'x' * (MEGABYTE - 100)}'\n"
    yield "a megabyte of escapes", f'{text}: "{chr(92)}n' + "\\n" * (room // 2) + '"\n'
    yield "a megabyte of key", "x" * (MEGABYTE - 10) + ": 1\n"
    yield "a megabyte of digits", f"{text}: {'9' * (MEGABYTE - 100)}\n"
    yield "a megabyte of hexadecimal", f"{text}: 0x{'f' * (MEGABYTE - 100)}\n"
    yield "a megabyte of base sixty", f"{text}: {'1:' * (room // 2)}1\n"
    yield "a megabyte of fraction", f"{text}: 0.{'1' * (MEGABYTE - 100)}\n"
    yield "a megabyte of date", f"{text}: 2026-01-01 {'0' * (MEGABYTE - 100)}\n"
    yield "numbers without end", f"{text}: .inf\n"
    yield "a tag that runs code", f"{text}: !!python/object/apply:os.system [id]\n"
    yield "a tag of a set", f"{text}: !!set {{a, b}}\n"
    yield "a key that is true", head + "yes: 1\n"
    yield "a key that is a list", head + "? [a, b]\n: 1\n"
    yield "a control sequence", f'{text}: "\\e]52;c;aGk=\\a"\n'
    yield "a reversed text", f'{text}: "\\u202e.ecrof oN"\n'
    yield "a lone surrogate", f'{text}: "\\ud800"\n'
    yield "no text at all", "\x00" * 1000


def _rules() -> Iterator[tuple[str, str]]:
    flow = "name: own\nrules:\n" + _RULE + "workflows:\n- id: own\n  rule: ROE-01\n"
    flow += "  starts: 'true'\n  phases:\n  - name: a\n    done: 'true'\n    command: "
    yield "placeholder that pads", flow + "'{track:>3000000000}'\n"
    yield "placeholder that looks inside", flow + "'{track.__class__}'\n"
    yield "placeholder that indexes", flow + "'{track[0]}'\n"
    yield "placeholder within one", flow + "'{track:{gate}}'\n"
    yield (
        "as many rules as fit",
        "name: own\nrules:\n" + _full(lambda n: _RULE.replace("ROE-01", f"ROE-{n:05}"), 990_000),
    )
    yield (
        "as many rules as may be",
        "name: own\nrules:\n"
        + "".join(_RULE.replace("ROE-01", f"ROE-{n:05}") for n in range(2900)),
    )
    yield "as many wrong rules as may be", "name: own\nrules:\n" + "- {a: 1}\n" * 9000


def _signature() -> Iterator[tuple[str, str]]:
    yield "a key of a megabyte", f"name: own\nkey: '{'0' * 900_000}'\n"
    yield "a list", "[]\n"
    yield "nothing", ""
    yield "a number", "1\n"
    yield "a signature of numbers", "name: own\nsignature: [" + "1, " * 20_000 + "]\n"
    yield "a number as name", "name: 1e400\n"


def _world() -> Iterator[tuple[str, str]]:
    base = """\
name: own
title: Own
standoff_m: 10.0
coverage_grace_s: 20.0
perimeter: [[-5000, -5000], [5000, -5000], [5000, 5000], [-5000, 5000]]
platforms:
  ugv: {speed_mps: 1, turn_rate_dps: 9, radius_m: 0.05, sensor_range_m: 9,
        drain_idle_pct_per_min: 0, drain_moving_pct_per_min: 0}
"""
    frames = "frames:\n  Base: {kind: base, at: [40, 0]}\n  Gate: {kind: gate, at: [0, 0]}\n"
    asset = "assets: {Ugv_T01: {kind: ugv, post: Base}}\n"
    yield (
        "walls without end",
        base
        + frames
        + asset
        + "walls:\n"
        + "".join(f"- {{start: [{n % 99}, {n}], end: [{n}, 7]}}\n" for n in range(4000)),
    )
    yield (
        "as many walls as may be",
        base
        + frames
        + asset
        + "walls:\n"
        + "".join(f"- {{start: [{n + 100}, 100], end: [{n + 100}, 4000]}}\n" for n in range(200)),
    )
    yield (
        "frames without end",
        base
        + asset
        + frames
        + "".join(f"  F{n}: {{kind: post, at: [{n}, {n}]}}\n" for n in range(3500)),
    )
    far = ", ".join(f"[{(-1) ** n * 5000}, {4000 + n % 900}]" for n in range(100))
    lane = f"lanes:\n  L: {{gate: Gate, points: [{far}]}}\n"
    yield "lane that never comes near", base + frames + asset + lane
    wide = "".join(
        f"  F{n}: {{kind: gate, at: [{n * 210 - 4000}, 0], radius_m: 100}}\n" for n in range(30)
    )
    base_frame = "  Base: {kind: base, at: [0, 900], radius_m: 100}\n"
    yield "frames of the largest size", base + asset + "frames:\n" + base_frame + wide
    yield (
        "a crowd at one frame",
        base
        + frames
        + "assets:\n"
        + "".join(f"  U{n}: {{kind: ugv, post: Base}}\n" for n in range(1900)),
    )
    yield "a perimeter like a comb", base.replace(
        "perimeter: [[-5000, -5000], [5000, -5000], [5000, 5000], [-5000, 5000]]",
        "perimeter: [" + ", ".join(f"[{n}, {n % 2 * 900}]" for n in range(99)) + ", [98, -9]]",
    ) + frames + asset  # fmt: skip


def _scenario() -> Iterator[tuple[str, str]]:
    head = "name: own\ntitle: Own\nabout: x\nevents:\n"
    spawn = "do: {kind: spawn, gate: EastGate}"
    chain = "".join(
        f"- {{name: e{n}, when: {{event: e{n - 1}}}, {spawn}}}\n" for n in range(1, 2200)
    )
    yield "a chain of events", head + f"- {{name: e0, at_s: 1, {spawn}}}\n" + chain
    tail = f"- {{name: e0, when: {{event: e2199}}, {spawn}}}\n"
    yield "a chain that bites its tail", head + tail + chain
    yield "events of one name", head + "- {name: e, at_s: 1, do: {kind: spawn}}\n" * 3000
    yield "events without a kind", head + "- {at_s: 1, do: {}}\n" * 5000
    yield "random without end", (
        "name: own\ntitle: Own\nabout: x\nrandom:\n- mean_s: 1\n  do: ["
        + "{kind: spawn, gate: EastGate}, " * 5000 + "]\n"
    )  # fmt: skip
    yield (
        "names of tracks without end",
        head
        + "".join(
            f"- {{at_s: 1, do: {{kind: spawn, gate: EastGate, name: T{n}}}}}\n" for n in range(2500)
        ),
    )


def _missions() -> Iterator[tuple[str, str]]:
    one = "name: own\nmissions:\n- {id: a, category: a, command: go, success: ["
    yield (
        "a world of a million gates",
        ("name: own\nworlds: {a: {gates: 1000000, assets: 1}}\nmissions: []\n"),
    )
    yield (
        "worlds without end",
        "name: own\nworlds:\n"
        + "".join(f"  w{n}: {{gates: 60, assets: 900, seed: {n}}}\n" for n in range(3000)),
    )
    yield "success in ten thousand terms", one + "'" + "true && " * 10_000 + "true']}\n"
    yield "success in parentheses", one + "'" + "(" * 10_000 + "true" + ")" * 10_000 + "']}\n"
    yield "success of negations", one + "'" + "!" * 990 + "true']}\n"
    yield (
        "as many missions as may be",
        "name: own\nmissions:\n"
        + "".join(f"- {{id: m{n}, category: a, command: go}}\n" for n in range(4200)),
    )


def _settings() -> Iterator[tuple[str, str]]:
    yield "keys without end", "keys:\n" + "".join(f"  k{n}: f1\n" for n in range(14_000))
    yield "a list instead", "- theme\n" * 9000
    yield "a setting nobody has", f"{'x' * 199}: 1\n"
    yield "settings nobody has", "".join(f"s{n}: 1\n" for n in range(14_000))
    yield "a theme of a megabyte", f"theme: '{'[/x]' * 240_000}'\n"
    yield "a path of a megabyte", f"logs: '/{'a/' * 490_000}'\n"


def _event() -> Iterator[tuple[str, str]]:
    yield "a track of a megabyte", f"kind: spawn\ngate: EastGate\nname: {'x' * 900_000}\n"
    yield "a kind of a megabyte", f"kind: {'x' * 900_000}\n"
    yield "fields without end", "kind: spawn\n" + "".join(f"f{n}: 1\n" for n in range(14_000))
    yield "a list of events", "- {kind: spawn, gate: EastGate}\n" * 5000
    yield "nothing", ""
    yield "a position out of the world", "kind: obstruct\nstart: [1e308, 1e308]\nend: [0, 0]\n"


_OWN: dict[str, Callable[[], Iterator[tuple[str, str]]]] = {
    "rules": _rules, "signature": _signature, "world": _world, "scenario": _scenario,
    "missions": _missions, "settings": _settings, "event": _event,
}  # fmt: skip
