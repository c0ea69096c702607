"""The machine's key is made once, for its owner alone, and never replaced behind one's back."""

import stat
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization as form
from cryptography.hazmat.primitives.asymmetric import ec

from pa_console.signing import (
    KEY_VARIABLE,
    SigningError,
    fingerprint,
    is_signature,
    known_keys,
    load_signer,
)


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where the key will be, in a folder that is not there yet."""
    path = tmp_path / "config" / "key.pem"
    monkeypatch.setenv(KEY_VARIABLE, str(path))
    return path


def test_the_key_is_made_on_first_use_for_its_owner_alone(key: Path) -> None:
    assert known_keys() == frozenset()
    assert not key.exists()
    signer = load_signer()
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert load_signer().public == signer.public
    assert known_keys() == {fingerprint(signer.public)}
    assert signer.fingerprint.startswith("SHA256:")
    assert len(signer.fingerprint) == 50


def test_consoles_that_start_at_once_get_the_same_key(key: Path) -> None:
    with ThreadPoolExecutor(8) as consoles:
        made = [consoles.submit(load_signer) for _ in range(16)]
    assert len({started.result().public for started in made}) == 1
    assert not list(key.parent.glob("*.new"))


def test_a_signature_is_of_one_message_by_one_key(key: Path) -> None:
    signer = load_signer()
    signature = signer.sign(b"message")
    assert is_signature(signature, b"message", signer.public)
    assert not is_signature(signature, b"massage", signer.public)
    assert not is_signature("00" * 64, b"message", signer.public)
    assert not is_signature(signature, b"message", "00" * 32)
    assert not is_signature("rubbish", b"message", "rubbish")


def test_a_key_that_cannot_be_read_is_kept_and_named(key: Path) -> None:
    key.parent.mkdir()
    elsewhere = ec.generate_private_key(ec.SECP256R1()).private_bytes(
        form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption()
    )
    for content, problem in ((b"rubbish", "not an unencrypted"), (elsewhere, "not an Ed25519")):
        key.write_bytes(content)
        key.chmod(0o600)
        for use in (load_signer, known_keys):
            with pytest.raises(SigningError, match=problem) as caught:
                use()
            assert str(key) in str(caught.value)
        assert key.read_bytes() == content


def test_a_folder_that_cannot_be_made_is_named_with_a_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv(KEY_VARIABLE, str(tmp_path / "file" / "key.pem"))
    with pytest.raises(SigningError, match=KEY_VARIABLE):
        load_signer()
