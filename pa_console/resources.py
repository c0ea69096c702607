"""The worlds, rules and model catalogue that are installed with the package."""

import sys
from collections.abc import Generator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

from pa_console.schema.document import DocumentError

_PACKAGE = Path(__file__).resolve().parent


def data_folder() -> Path:
    """Return the folder that holds `worlds/`, `rules/` and `models/`.

    It is `pa_console/data` in an installed package and the repository itself in a checkout.
    """
    installed = _PACKAGE / "data"
    return installed if installed.is_dir() else _PACKAGE.parent


def install_hint(extra: str) -> str:
    """Return the command that adds an `extra` to this installation of the program.

    It uses pip, pipx, or pip in a clone of the repository.
    """
    prefix, root = Path(sys.prefix), _PACKAGE.parent
    if (root / "pyproject.toml").is_file():
        inside = prefix.is_relative_to(root)
        pip = (prefix.relative_to(root) if inside else prefix) / "bin" / "pip"
        return f"{pip} install --editable '{'.' if inside else root}[{extra}]'"
    if prefix.parent.parts[-2:] == ("pipx", "venvs"):
        return f"pipx runpip {prefix.name} install 'pa-console[{extra}]'"
    return f"pip install 'pa-console[{extra}]'"


def missing_library(module: str, extra: str, need: str) -> str:
    """Return a sentence with the command that installs `module`; '' if it is installed.

    The command installs `extra`; `need` begins the sentence, such as `alerts need`. The module is
    not imported.
    """
    return "" if find_spec(module) else _not_installed(module, extra, need)


@contextmanager
def naming_what_is_missing(extra: str, need: str = "this needs") -> Generator[None]:
    """Raise ValueError with the `extra` to install if an import in the block fails."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise ValueError(_not_installed(error.name, extra, need)) from error


def _not_installed(module: str | None, extra: str, need: str) -> str:
    return f"{need} a library that is not installed ({module}): {install_hint(extra)}"


def find_data(kind: str, name: str, file: str) -> Path:
    """Return the path that `name` means: a path of the user, or the name of an installed item.

    `find_data("worlds", "checkpoint", "world.yaml")` is the installed checkpoint. If `name` is an
    existing file, its path is returned; if it is a folder that contains `file`, the path of that
    file. The returned path may not exist; opening it then raises an error that names it.
    """
    given = Path(name).expanduser()
    if given.is_file():
        return given
    if given.is_dir() and (given / file).is_file():
        return given / file
    folder = data_folder() / kind
    candidates = [folder / name / file, folder / f"{name}.yaml", folder / name]
    return next((path for path in candidates if path.is_file()), given)


def existing_data(kind: str, name: str, file: str) -> Path:
    """Return the path of `name` as `find_data` does; raise DocumentError if it does not exist.

    The error lists the installed names.
    """
    path = find_data(kind, name, file)
    if path.exists():
        return path
    folder = data_folder() / kind
    folders = {path.parent.name for path in folder.glob(f"*/{file}")}
    names = ", ".join(sorted(folders | {path.stem for path in folder.glob("*.yaml")}))
    raise DocumentError(
        name, 0, "", f"No such file, and nothing installed has this name; installed: {names}"
    )
