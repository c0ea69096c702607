"""Writes `.constraints.txt` anew: every library that `make` installs, with its hashes.

Run `python .ci/pins.py` after a change of the dependencies in pyproject.toml; it needs uv
(`pip install uv`). The file has a section for each target.
"""

import re
import subprocess
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = ROOT / "pyproject.toml"
PINS = ROOT / ".constraints.txt"
SECTIONS = {
    "console": (), "core-test": ("console",), "test": ("console", "core-test"),
    "lint": ("console", "core-test", "test"), "site": (), "audit": (),
}  # fmt: skip
"""The section of each target, and the sections that it comes on top of."""
EXTRAS = {"core-test": "core-test", "test": "test", "lint": "dev"}
ALONE = {"site": "docs", "audit": "audit"}
"""The extra of each section that is installed without the console."""
HEAD = """\
# What `make` installs, for Python 3.11 and newer; python .ci/pins.py writes this file.
"""


def main() -> None:
    """Resolve everything together, then tell which part of it each target needs."""
    config = tomllib.loads(PROJECT.read_text(encoding="utf-8"))
    extras = config["project"]["optional-dependencies"]
    with tempfile.TemporaryDirectory() as folder:
        build, whole = Path(folder) / "build.in", Path(folder) / "whole.txt"
        build.write_text("\n".join(config["build-system"]["requires"]), encoding="utf-8")
        whole.write_text(
            "".join(
                _resolve(PROJECT, build, *(f"--extra={name}" for name in ("dev", *ALONE.values())))
            ),
            encoding="utf-8",
        )
        text, pins = HEAD, dict[str, list[str]]()
        for section, below in SECTIONS.items():
            there = {pin for name in below for pin in pins[name]}
            asked: tuple[str | Path, ...] = (PROJECT, build, *_extra(section))
            if section in ALONE:
                alone = Path(folder) / f"{section}.in"
                alone.write_text("\n".join(extras[ALONE[section]]), encoding="utf-8")
                asked = (alone,)
            found = _resolve(*asked, "--constraint", whole)
            pins[section] = [pin for pin in found if pin not in there]
            text += f"\n# {section}\n{''.join(pins[section])}"
    PINS.write_text(text, encoding="utf-8")


def _extra(section: str) -> tuple[str, ...]:
    return ("--extra", EXTRAS[section]) if section in EXTRAS else ()


def _resolve(*asked: str | Path) -> list[str]:
    """Return the pins of what is asked for, each with its hashes."""
    command = [
        "uv", "pip", "compile", *map(str, asked), "--universal", "--generate-hashes",
        "--python-version", "3.11", "--no-header", "--no-annotate", "--no-emit-index-url",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return re.findall(r"^[a-z0-9].*?[^\\]\n", done.stdout, re.DOTALL | re.MULTILINE)


if __name__ == "__main__":
    main()
