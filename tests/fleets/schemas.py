"""The official schemas of VDA 5050 3.0.0 (MIT, see vda5050/LICENSE.txt), as validators."""

import json
from functools import cache
from pathlib import Path

from jsonschema import Draft202012Validator
from jsonschema.validators import validator_for

FOLDER = Path(__file__).parent / "vda5050"
TOPICS = tuple(sorted(path.stem for path in FOLDER.glob("*.schema")))


@cache
def validator(topic: str) -> Draft202012Validator:
    schema = json.loads((FOLDER / f"{topic}.schema").read_text("utf-8"))
    kind = validator_for(schema)
    assert kind is Draft202012Validator
    return Draft202012Validator(schema, format_checker=Draft202012Validator.FORMAT_CHECKER)


def problems(topic: str, payload: bytes) -> list[str]:
    """Return what the standard has against a message on `topic`."""
    found = validator(topic).iter_errors(json.loads(payload))
    return [f"{'.'.join(map(str, error.absolute_path))}: {error.message}" for error in found]
