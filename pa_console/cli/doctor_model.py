"""What `doctor` says of the model's files and of the process that loads them."""

from pa_console.cli.doctor_checks import Check
from pa_console.llm.adapters import check_adapters
from pa_console.llm.cache import hash_file
from pa_console.llm.catalog import ModelEntry
from pa_console.llm.confinement import Restriction, try_out
from pa_console.llm.errors import ModelError
from pa_console.llm.prepare import How, find_recorded
from pa_console.tui.words import count

PINNED = "SHA-256 as the catalogue pins it"


def check_files(entry: ModelEntry) -> Check:
    """Hash everything that is loaded for a model, and say what each was compared with."""
    path, pull = entry.local_file, f"pa-console models pull {entry.name}"
    if path is None:
        return Check("model", "missing", f"{entry.name} is not here ({entry.size_mb} MB)", pull)
    try:
        digest = entry.check(path)
        adapters = check_adapters(entry.name, entry.adapters)
    except (ModelError, OSError) as error:
        return Check("model", "missing", str(error), f"rm '{path}'; {pull}")
    known = entry.sha256 is not None
    said = [f"{path}: {PINNED if known else 'no hash is known that it could be held against'}"]
    if entry.how is not None:
        good, words = _prepared(entry, entry.how, digest)
        if not good:
            return Check("model", "missing", f"{entry.name}: {words}", pull)
        said.append(words)
    if files := {item.path for item in adapters}:
        said.append(f"{count(len(files), 'adapter')}: {PINNED}")
    found = f"{entry.name}: {'; '.join(said)}"
    if not known:
        remedy = "choose a model of the catalogue that has one"
        return Check("model", "warning", found, remedy)
    return Check("model", "ok", found)


def _prepared(entry: ModelEntry, how: How, source_sha256: str) -> tuple[bool, str]:
    """Return whether the prepared file may be loaded, or is yet to be made, and why."""
    path, pin = entry.prepared_file, entry.pin(how)
    held = "the catalogue's pin" if pin else "no pin: this machine's key signs its hash then"
    if path is None:
        return True, f"{how} weights: made at the first start, held against {held}"
    if pin:
        digest = hash_file(path)
        if digest == pin:
            return True, f"{path}, which is loaded: {PINNED} for {how}"
        return False, (
            f"{path}: not the {how} weights that the catalogue pins: its SHA-256 is {digest}, "
            f"pinned is {pin}; it is never loaded, the next start makes it again"
        )
    if find_recorded(entry.stem, how, source_sha256) is not None:
        return True, (
            f"{path}, which is loaded: SHA-256 as in the record that this machine's key signed "
            f"when it was made; the catalogue pins none for {how}"
        )
    return False, (
        f"{path}: no record signed with this machine's key fits it, and the catalogue pins no "
        f"{how} weights; it is never loaded, the next start makes it again"
    )


def check_confinement() -> Check:
    """Try in a process like the model's what it must not be able to do."""
    return confinement_words(try_out())


def confinement_words(restrictions: tuple[Restriction, ...]) -> Check:
    """Say what holds for the model's process, and what does not, and why."""
    held = [item.what for item in restrictions if not item.missing]
    missing = [f"not kept from it: {i.what} ({i.missing})" for i in restrictions if i.missing]
    found = "; ".join([*missing, *held])
    if not missing:
        return Check("model's process", "ok", f"{found}; tried")
    remedy = "on Linux 4.17 or newer, on x86-64 or ARM64, all of it holds"
    return Check("model's process", "warning", found, remedy)
