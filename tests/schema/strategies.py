"""Hypothesis strategies for every schema model, derived from the models' own fields."""

import types
from datetime import UTC, datetime
from functools import cache
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, MaxLen, MinLen
from hypothesis import strategies as st
from pydantic import BaseModel

from pa_console.schema.command import COMMANDS
from pa_console.schema.events.event import Event, EventPayload
from pa_console.schema.mission import Ban, Schedule, StandingOrder, SubjectKind
from pa_console.schema.plan import Action
from pa_console.schema.rule import Priority, Rule, RuleSet

PAYLOADS: tuple[type[BaseModel], ...] = get_args(get_args(EventPayload)[0])
FRAMES = ("NorthGate", "EastGate", "Checkpoint", "Base")
TEXT = st.text(st.characters(codec="utf-8"), max_size=12)
BIG = 1_000_000


def actions() -> st.SearchStrategy[Action]:
    """Any action that the vocabulary allows."""
    commands = [
        f"{verb} {frame}" if spec.takes_frame else verb
        for verb, spec in COMMANDS.items()
        for frame in FRAMES
    ]
    names = st.from_regex(r"\A[A-Z][a-z]{1,5}_T0[1-9]\Z")
    return st.builds(Action, agent=names, command=st.sampled_from(commands))


def rule_sets() -> st.SearchStrategy[RuleSet]:
    """Rule sets with one rule; what a rule's fields may be together is a matter of its own."""
    rule = st.builds(Rule, id=st.just("WF-01"), domain=st.just("WF"), priority=values(Priority),
                     text=TEXT.filter(bool))  # fmt: skip
    return st.builds(RuleSet, name=TEXT, rules=st.tuples(rule))


@cache
def models(model: type[BaseModel]) -> st.SearchStrategy[Any]:
    """Any valid value of `model`."""
    if model is Action:
        return actions()
    if model is RuleSet:
        return rule_sets()
    fields = {
        name: values(field.annotation, field.metadata) for name, field in model.model_fields.items()
    }
    if model is StandingOrder:
        none = {
            "each": st.none(),
            "condition": st.just(""),
            "schedule": st.none(),
            "ban": st.none(),
        }
        triggers = (
            none | {"each": values(SubjectKind), "condition": TEXT.filter(bool)},
            none | {"schedule": models(Schedule)},
            none | {"ban": models(Ban)},
        )
        return st.one_of(*(st.builds(model, **{**fields, **trigger}) for trigger in triggers))
    return st.builds(model, **fields)


def events() -> st.SearchStrategy[Event]:
    """Any event."""
    return models(Event)


def values(annotation: Any, metadata: Any = ()) -> st.SearchStrategy[Any]:
    """Any value that a field of type `annotation` takes."""
    origin, args = get_origin(annotation), get_args(annotation)
    metadata = [part for item in metadata for part in getattr(item, "metadata", (item,))]
    if origin is Annotated:
        return values(args[0], (*args[1:], *metadata))
    if origin is Literal:
        return st.sampled_from(args)
    if origin in (Union, types.UnionType):
        return st.one_of([values(arg) for arg in args])
    if origin is tuple and args[-1] is Ellipsis:
        least = _bound(metadata, MinLen, "min_length", 0)
        return st.lists(values(args[0]), min_size=least, max_size=least + 2).map(tuple)
    if origin is tuple:
        return st.tuples(*(values(arg) for arg in args))
    if origin is dict:
        return st.dictionaries(values(args[0]), values(args[1]), max_size=2)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        model = annotation
        return st.deferred(lambda: models(model))
    return _scalars(annotation, metadata)


def _scalars(annotation: Any, metadata: Any) -> st.SearchStrategy[Any]:
    pattern: str | None = next((p for m in metadata if (p := getattr(m, "pattern", None))), None)
    if pattern is not None:
        most = next((n for m in metadata if (n := getattr(m, "max_length", None))), None)
        return st.from_regex(rf"\A{pattern.strip('^$')}\Z").map(lambda text: text[:most])
    if annotation is str:
        most = _bound(metadata, MaxLen, "max_length", 12)
        least = _bound(metadata, MinLen, "min_length", 0)
        return st.text(st.characters(codec="utf-8"), min_size=least, max_size=min(most, 12))
    if annotation is float:
        least = _bound(metadata, Ge, "ge", _bound(metadata, Gt, "gt", None))
        return st.floats(
            least,
            _bound(metadata, Le, "le", None),
            exclude_min=any(isinstance(item, Gt) for item in metadata),
            allow_nan=False,
            allow_infinity=False,
        )
    if annotation is int:
        least, most = _bound(metadata, Ge, "ge", -BIG), _bound(metadata, Le, "le", BIG)
        return st.integers(least, most)
    simple: dict[Any, st.SearchStrategy[Any]] = {
        bool: st.booleans(),
        type(None): st.none(),
        datetime: st.datetimes(datetime(2000, 1, 1), datetime(2100, 1, 1), timezones=st.just(UTC)),
    }
    return simple[annotation]


def _bound(metadata: Any, kind: type, attribute: str, default: Any) -> Any:
    return next((getattr(m, attribute) for m in metadata if isinstance(m, kind)), default)
