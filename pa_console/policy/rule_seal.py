"""The canonical form of a rule set, its hash, and its signature `RULES.sig`."""

import hashlib
import json
import os
from pathlib import Path

from pa_console.schema.base import StrictModel
from pa_console.schema.document import Document, DocumentError
from pa_console.schema.rule import SHORT, Rule, RuleSet, RulesSeal, RulesSignature, Workflow
from pa_console.signing import Signer, fingerprint, is_signature, known_keys, named_keys

Plain = dict[str, object]

SHIPPED_FILE = Path(__file__).with_name("shipped_rules.json")

PURPOSE = b"pa-console rule set\n"


class ShippedRules(StrictModel):
    """The rules that the package itself contains; `rules pin --write` writes their file."""

    name: str
    content_sha256: str
    """The hash of the content of an unchanged set called `name`."""
    core: tuple[Rule, ...]
    """The rules that a file can add to but not weaken (`rulebook.py`)."""

    @property
    def text(self) -> str:
        """The text of the file."""
        return self.model_dump_json(indent=1, exclude_defaults=True) + "\n"


SHIPPED = ShippedRules.model_validate_json(SHIPPED_FILE.read_bytes())


def content_sha256(rule_set: RuleSet) -> str:
    """Return the SHA-256 of the whole content of `rule_set`, 64 hexadecimal digits.

    The hash covers name, version, source, every field of every rule and workflow, and the order of
    rules, workflows and the lists in them. It does not cover comments, white space, quoting, the
    order of keys, or whether a default is written out.
    """
    return hashlib.sha256(canonical(plain_set(rule_set)).encode()).hexdigest()


def plain_set(rule_set: RuleSet) -> Plain:
    """Return every field of `rule_set` that differs from its default, as plain JSON values."""
    return {
        **plain_head(rule_set),
        "rules": [plain_rule(rule) for rule in rule_set.rules],
        "workflows": [plain_workflow(workflow) for workflow in rule_set.workflows],
    }


def plain_head(rule_set: RuleSet) -> Plain:
    """Return the head of `rule_set`, without its rules and workflows."""
    return rule_set.model_dump(exclude={"rules", "workflows"}, exclude_defaults=True)


def plain_rule(rule: Rule) -> Plain:
    """Return every field of `rule` that differs from its default."""
    return rule.model_dump(exclude_defaults=True)


def plain_workflow(workflow: Workflow) -> Plain:
    """Return every field of `workflow` that differs from its default; `ends` are ordered pairs.

    The first end that holds counts, so the order of the ends is part of their meaning.
    """
    plain = workflow.model_dump(exclude_defaults=True)
    if workflow.ends:
        plain["ends"] = list(workflow.ends.items())
    return plain


def canonical(value: object) -> str:
    """Return `value` as canonical JSON: keys sorted, ASCII, compact."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"))


class AlteredRulesError(ValueError):
    """A rule set that was changed after it was signed; the message has the problem and remedy."""


def signature_path(rules: Path) -> Path:
    """Return the path of the signature of the rule file `rules`."""
    return rules.with_name(rules.name + ".sig")


def sign_rules(path: Path, rule_set: RuleSet, signer: Signer) -> RulesSignature:
    """Sign `rule_set`, read from `path`, and write the signature beside it; raises OSError.

    An existing signature stays until the new one is complete.
    """
    content = content_sha256(rule_set)
    message = _message(rule_set.name, rule_set.version, content)
    signature = RulesSignature(
        name=rule_set.name,
        version=rule_set.version,
        content_sha256=content,
        key=signer.public,
        signature=signer.sign(message),
    )
    target = signature_path(path)
    new = target.with_name(target.name + ".new")
    new.write_text(signature.model_dump_json(indent=2) + "\n", encoding="utf-8")
    os.replace(new, target)
    return signature


def seal_of(path: Path, rule_set: RuleSet) -> RulesSeal:
    """Return the seal of `rule_set`, read from `path`; `altered` if its signature does not match.

    The shipped set is recognized by its content, whose hash is in the package. A signature file
    that cannot be read counts as altered too. Raises SigningError if this machine's own keys cannot
    be read.
    """
    decided = any(rule.priority == "critical" and rule.decidable for rule in rule_set.rules)
    unsigned = RulesSeal(
        version=rule_set.version,
        content_sha256=content_sha256(rule_set),
        no_critical_check=not decided,
    )
    if (rule_set.name, unsigned.content_sha256) == (SHIPPED.name, SHIPPED.content_sha256):
        return unsigned.model_copy(update={"standing": "shipped"})
    place = signature_path(path)
    if not os.path.lexists(place):
        return unsigned
    try:
        signature = Document.read(place).parse(RulesSignature)
    except DocumentError as error:
        return _altered(unsigned, f"its signature cannot be read: {error}")
    message = _message(signature.name, signature.version, signature.content_sha256)
    if not is_signature(signature.signature, message, signature.key):
        return _altered(unsigned, f"{place} was edited: the signature does not match its key")
    signed = (signature.name, signature.version, signature.content_sha256)
    if signed != (rule_set.name, rule_set.version, unsigned.content_sha256):
        return _altered(unsigned, f"the signature is for {_set_words(*signed)}, not for this set")
    key = fingerprint(signature.key)
    if key in known_keys():
        return unsigned.model_copy(update={"standing": "own key", "key": key})
    name = named_keys().get(key)
    standing = "known key" if name is not None else "unknown key"
    return unsigned.model_copy(update={"standing": standing, "key": key, "signer": name or ""})


def refuse_altered(path: Path, seal: RulesSeal) -> None:
    """Raise AlteredRulesError if the rules at `path` differ from their signature."""
    if seal.altered:
        raise AlteredRulesError(
            f"{path}: ALTERED since it was signed: {seal.problem}. Restore the signed file; or "
            f"review the changes and sign it again: pa-console rules sign {path}; or start "
            "console, mission or eval with --unsigned, which the session's log will state"
        )


def _altered(seal: RulesSeal, problem: str) -> RulesSeal:
    return seal.model_copy(update={"standing": "altered", "problem": problem})


def _set_words(name: str, version: str, content: str) -> str:
    return f"{name!r} {f'version {version}' if version else 'without a version'}, {content[:SHORT]}"


def _message(name: str, version: str, content: str) -> bytes:
    """Return the bytes to sign; they cannot be confused with those of any other signature."""
    return PURPOSE + canonical({"content": content, "name": name, "version": version}).encode()
