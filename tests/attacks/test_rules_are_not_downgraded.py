"""A rule set that is less than the one used before is refused, and said wherever it is accepted."""

import json
from contextlib import aclosing
from pathlib import Path

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pa_console.policy.authoring.examples import (
    MISSION_TEXT,
    WORLD,
    example_plan,
    example_rehearsal,
    example_sightings,
)
from pa_console.policy.monitor import Monitor
from pa_console.policy.pinned_rules import RefusedRulesError, RulesPins, pin_of
from pa_console.policy.rule_checks import check_mission, check_plan
from pa_console.policy.rule_seal import (
    SHIPPED,
    SHIPPED_FILE,
    content_sha256,
    seal_of,
    sign_rules,
    signature_path,
)
from pa_console.policy.rulebook import (
    CORE_IDS,
    Rulebook,
    load_rules,
    read_rule_set,
    shipped_rules,
    with_core,
)
from pa_console.schema.events import event as ev
from pa_console.schema.mission import Mission
from pa_console.schema.rule import PRIORITIES, Rule, RuleExample, RulesSeal
from pa_console.signing import KEY_VARIABLE, Signer, load_signer
from pa_console.station.assembly import load_site, open_station
from pa_console.station.clock import SteppedClock
from pa_console.station.rules_in_force import RulesWatch
from pa_console.station.station import ControlStation
from tests.cli.inside import Call
from tests.policy.book import RULES
from tests.policy.test_large import MISSION
from tests.scripted import ScriptedEngine

pytestmark = pytest.mark.invariant

HOUSE = """\
name: house
version: "2"
rules:
  - {id: ROE-70, domain: ROE, priority: critical, text: "Nobody blocks.",
     check: "!actions.exists(a, a.verb == 'block')", message: "it blocks"}
"""
LAX = """\
name: house
version: "2"
rules:
  - {id: ROE-70, domain: ROE, priority: critical, text: "Do as you like."}
"""
REFUSED = "the rules 'house' are refused"


def signed(path: Path, text: str = HOUSE, signer: Signer | None = None) -> Path:
    """Write the rule file and sign it, with this machine's key unless another is given."""
    path.write_text(text)
    sign_rules(path, read_rule_set(path)[1], signer or load_signer())
    return path


def foreign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Signer:
    """Return the signer of somebody else."""
    with monkeypatch.context() as patch:
        patch.setenv(KEY_VARIABLE, str(tmp_path / "foreign" / "key.pem"))
        return load_signer()


def attacked(way: str, path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the signed set at `path` a lesser one in the way named."""
    match way:
        case "the signature is deleted":
            signature_path(path).unlink()
        case "one uncheckable rule, unsigned":
            path.write_text(LAX)
            signature_path(path).unlink()
        case "the version is rolled back":
            signed(path, HOUSE.replace('"2"', '"1.9"'))
        case "the version is left out":
            signed(path, HOUSE.replace('version: "2"\n', ""))
        case "a foreign key":
            signed(path, LAX, foreign(tmp_path, monkeypatch))
        case "another set of the same signer":
            signed(path, LAX.replace("house", "training"))
        case _:
            raise ValueError(way)


WAYS = (
    "the signature is deleted",
    "one uncheckable rule, unsigned",
    "the version is rolled back",
    "the version is left out",
    "a foreign key",
    "another set of the same signer",
)


def decided(call: Call, *words: str) -> tuple[int, str]:
    done = call("mission", "Close the gap.", "--approve", "auto", *words)
    return done.code, done.said


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("way", WAYS)
def test_a_headless_mission_refuses_a_lesser_set_and_says_why(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    path = signed(tmp_path / "house.yaml")
    assert "warning" not in decided(call, "--rules", str(path))[1]
    attacked(way, path, tmp_path, monkeypatch)
    code, said = decided(call, "--rules", str(path))
    assert code == 2
    assert "are refused" in said
    assert "--accept-rules" in said
    again, _ = decided(call, "--rules", "checkpoint")
    assert again != 2


@pytest.mark.usefixtures("engine")
def test_the_environment_cannot_choose_a_lesser_set(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert decided(call)[0] != 2
    lax = tmp_path / "lax.yaml"
    lax.write_text(LAX)
    monkeypatch.setenv("PA_CONSOLE_RULES", str(lax))
    code, said = decided(call)
    assert (code, REFUSED in said) == (2, True)


@pytest.mark.usefixtures("engine")
def test_what_was_accepted_is_said_in_banner_log_report_and_again_next_time(
    call: Call, tmp_path: Path
) -> None:
    path, log = signed(tmp_path / "house.yaml"), tmp_path / "session.jsonl"
    decided(call, "--rules", str(path))
    path.write_text(LAX)
    signature_path(path).unlink()
    for words in (["--accept-rules"], []):
        code, said = decided(call, "--rules", str(path), "--log", str(log), *words)
        assert code != 2
        assert "accepted by the operator although: 'house' version '2', not signed" in said.replace(
            "version 2", "version '2'"
        )
        assert "no critical rule of this set is checked" in said
        records = [json.loads(line) for line in log.read_text().splitlines()]
        data = {record["kind"]: record["data"] for record in records}
        assert "not signed" in data["session_started"]["rules_seal"]["accepted"]
        assert any("although" in told for told in data["mission_started"]["rules_warnings"])
        assert "accepted by the operator although" in data["mission_reported"]["text"]
        log.unlink()
    path.write_text(LAX.replace("as you like", "what you want"))
    assert decided(call, "--rules", str(path))[0] == 2


def test_an_evaluation_with_rules_of_its_own_says_so_and_pins_nothing(
    call: Call, tmp_path: Path
) -> None:
    pins = RulesPins()
    shipped = load_rules(RULES)
    pins.admit(shipped.name, shipped.seal, accept=False)
    before = pins.read()
    lax = tmp_path / "lax.yaml"
    lax.write_text(LAX)
    done = call("eval", "--rules", str(lax), "--only", "no such mission", "--out", str(tmp_path))
    assert "warning: a session would refuse the rules of this evaluation" in done.said
    assert pins.read() == before


def watching(path: Path) -> ControlStation:
    pins = RulesPins()
    site = load_site("checkpoint", str(path), pins=pins)
    watch = RulesWatch(path, pins=pins)
    return open_station(site, ScriptedEngine([]).engine(), SteppedClock(), watch=watch)


async def reloaded(station: ControlStation, *, accept: bool = False) -> list[ev.EventPayload]:
    await station.reload_rules()
    if accept:
        await station.accept_rules()
    await station.close()
    async with aclosing(station.run()) as events:
        return [e.data async for e in events if e.data.kind in ("rules_replaced", "noticed")]


@pytest.mark.parametrize("way", WAYS)
async def test_a_live_console_keeps_its_set_until_the_operator_accepts_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    path = signed(tmp_path / "house.yaml")
    station = watching(path)
    attacked(way, path, tmp_path, monkeypatch)
    await station.reload_rules()
    assert station.rules_offered
    told = await reloaded(station)
    assert not any(isinstance(data, ev.RulesReplaced) for data in told)
    notice = told[-1]
    assert isinstance(notice, ev.Noticed)
    assert (notice.level, "stays in force" in notice.text) == ("alarm", True)
    station = watching(signed(path))
    attacked(way, path, tmp_path, monkeypatch)
    replaced, said = (await reloaded(station, accept=True))[-2:]
    assert isinstance(replaced, ev.RulesReplaced)
    assert replaced.rules_seal.accepted
    assert isinstance(said, ev.Noticed)
    assert "accepted by the operator although" in said.text


async def test_a_live_console_without_a_pin_holds_a_set_against_the_one_in_force(
    tmp_path: Path,
) -> None:
    path = signed(tmp_path / "house.yaml")
    engine = ScriptedEngine([]).engine()
    site = load_site("checkpoint", str(path))
    station = open_station(site, engine, SteppedClock(), watch=RulesWatch(path))
    signature_path(path).unlink()
    (told,) = await reloaded(station)
    assert isinstance(told, ev.Noticed)
    assert "stays in force" in told.text


def test_a_newer_set_of_the_same_signer_is_taken_and_then_pinned(tmp_path: Path) -> None:
    path, pins = signed(tmp_path / "house.yaml"), RulesPins(tmp_path / "pin.json")
    for version in ("2", "2.1", "10"):
        signed(path, HOUSE.replace('"2"', f'"{version}"'))
        load_site("checkpoint", str(path), pins=pins)
    signed(path, HOUSE.replace('"2"', '"9"'))
    with pytest.raises(RefusedRulesError, match="its version is 9, lower than 10"):
        load_site("checkpoint", str(path), pins=pins)


def test_a_pin_that_cannot_be_read_stops_all_but_nothing_is_lost(tmp_path: Path) -> None:
    file = tmp_path / "pin.json"
    file.write_text("{")
    with pytest.raises(RefusedRulesError, match=r"pin\.json"):
        load_site("checkpoint", "checkpoint", pins=RulesPins(file))
    assert file.read_text() == "{"


VERSIONS = st.sampled_from(("", "1", "2", "2.1", "10"))


def a_set(name: str, version: str, content: str, key: str) -> tuple[str, RulesSeal]:
    standing = "unknown key" if key else "not signed"
    return name, RulesSeal(version=version, content_sha256=content * 64, standing=standing, key=key)


SETS = st.builds(
    a_set,
    st.sampled_from(("house", "other")),
    VERSIONS,
    st.sampled_from("abc"),
    st.sampled_from(("", "SHA256:one", "SHA256:two")),
)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(history=st.lists(st.tuples(SETS, st.booleans()), max_size=12))
def test_no_history_takes_a_signed_set_s_place_without_an_acceptance(
    tmp_path_factory: pytest.TempPathFactory,
    history: list[tuple[tuple[str, RulesSeal], bool]],
) -> None:
    pins = RulesPins(tmp_path_factory.mktemp("pins") / "pin.json")
    for (name, seal), accept in history:
        before = pins.read()
        try:
            taken = pins.admit(name, seal, accept=accept)
        except RefusedRulesError:
            assert not accept
            assert pins.read() == before
            continue
        assert pins.read() == pin_of(name, taken)
        if before is not None and before.signer and seal.key != before.signer:
            assert accept
            assert taken.accepted


# The shipped set and the core


def test_the_package_pins_the_shipped_file_and_its_core() -> None:
    rule_set = read_rule_set(RULES)[1]
    assert content_sha256(rule_set) == SHIPPED.content_sha256, "run: pa-console rules pin --write"
    source = SHIPPED_FILE.read_text(encoding="utf-8")
    assert source == shipped_rules(rule_set).text, "run: pa-console rules pin --write"
    assert seal_of(RULES, rule_set).standing == "shipped"
    by_id = {rule.id: rule.model_copy(update={"examples": ()}) for rule in rule_set.rules}
    assert tuple(by_id[name] for name in CORE_IDS) == SHIPPED.core


def test_a_set_of_the_shipped_name_with_other_content_is_not_the_shipped_one(
    tmp_path: Path,
) -> None:
    path = tmp_path / "checkpoint.yaml"
    path.write_text(RULES.read_text().replace("priority: critical", "priority: medium", 1))
    assert load_rules(path).seal.standing == "not signed"
    pins = RulesPins(tmp_path / "pin.json")
    load_site("checkpoint", "checkpoint", pins=pins)
    with pytest.raises(RefusedRulesError):
        load_site("checkpoint", str(path), pins=pins)


RULE_SET = read_rule_set(RULES)[1]
BROKEN = [
    (rule.id, example)
    for rule in RULE_SET.rules
    if rule.id in CORE_IDS
    for example in rule.examples
    if example.expect == "fail" and not example.moments
]
WEAKER = st.sampled_from(
    (None, {"check": "true"}, {"check": "[]"}, {"priority": "medium"}, {"applies": "false"},
     {"check": "1 / 0 == 1"}, {"order": ()}, {"check": None, "applies": None, "message": ""})
)  # fmt: skip


def weakened(changes: dict[str, dict[str, object] | None]) -> Rulebook:
    """Return the shipped rules with some of the core changed, or left out where it is None."""
    from pa_console.policy.rulebook import Compiler  # noqa: PLC0415

    compiler = Compiler()
    kept: list[Rule] = []
    for rule in RULE_SET.rules:
        if rule.id not in changes:
            kept.append(rule)
        elif (change := changes[rule.id]) is not None:
            kept.append(rule.model_copy(update=change))
    return Rulebook("weak", "", tuple(compiler.rule(rule) for rule in kept))


@settings(deadline=None, max_examples=60)
@given(
    changes=st.dictionaries(st.sampled_from(CORE_IDS), WEAKER, min_size=1),
    case=st.sampled_from(BROKEN),
)
def test_no_file_weakens_the_core(
    changes: dict[str, dict[str, object] | None], case: tuple[str, RuleExample]
) -> None:
    name, example = case
    book = with_core(weakened(changes))
    plan_ = example_plan(example)
    rehearsal = example_rehearsal(example, plan_)
    seen = example_sightings(example, rehearsal.before.time_s)
    mission = Mission(id="M1", text=example.mission or MISSION_TEXT, created=MISSION.created)
    found = check_plan(
        book, plan=plan_, rehearsal=rehearsal, mission=mission, world=WORLD,
        monitor=Monitor(book, WORLD, seen),
    )  # fmt: skip
    (one,) = (finding for finding in found if finding.rule_id == name)
    core = next(rule for rule in SHIPPED.core if rule.id == name)
    assert one.blocking
    assert PRIORITIES.index(one.priority) <= PRIORITIES.index(core.priority)
    if example.mission and name in ("ROE-01", "ROE-05"):
        assert any(finding.blocking for finding in check_mission(book, mission, WORLD))


def test_a_file_adds_to_the_core(tmp_path: Path) -> None:
    rules = yaml.safe_load(RULES.read_text())
    (roe,) = (rule for rule in rules["rules"] if rule["id"] == "CAP-01")
    roe["check"] = "size(actions) == 0"
    path = tmp_path / "stricter.yaml"
    path.write_text(yaml.safe_dump(rules))
    example = next(e for e in roe["examples"] if e["expect"] == "pass")
    shown = RuleExample.model_validate_json(json.dumps(example))
    plan_ = example_plan(shown)
    book = with_core(load_rules(path))
    found = check_plan(
        book, plan=plan_, rehearsal=example_rehearsal(shown, plan_), mission=MISSION, world=WORLD
    )
    assert next(f for f in found if f.rule_id == "CAP-01").status == "violates"


def test_a_set_without_a_critical_check_is_said_so(call: Call, tmp_path: Path) -> None:
    path = tmp_path / "lax.yaml"
    path.write_text(LAX)
    for words in (("rules", "list", "--rules"), ("rules", "check")):
        said = call(*words, str(path)).err
        assert "no critical rule of this set is checked by software" in " ".join(said.split())
    assert "critical" not in call("rules", "check", str(RULES)).err
