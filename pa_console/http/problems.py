"""Problem details of refused requests (RFC 9457): the field, and the remedy."""

from typing import Annotated

from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field

MEDIA_TYPE = "application/problem+json"


class ProblemDetails(BaseModel):
    """The reason why a request was refused."""

    type: Annotated[str, Field(description="a name of the kind of problem, urn:pa-console:...")]
    title: str
    status: int
    detail: str
    field: Annotated[str, Field(description="what of the request is wrong; '' for all of it")] = ""
    remedy: Annotated[str, Field(description="what to do about it")] = ""


class ProblemError(Exception):
    """A request that is refused; `kind` ends its type, and `after_s` is when to try again."""

    def __init__(
        self,
        status: int,
        kind: str,
        detail: str,
        *,
        field: str = "",
        remedy: str = "",
        after_s: int = 0,
    ) -> None:
        super().__init__(detail)
        self.details = ProblemDetails(
            type=f"urn:pa-console:problem:{kind}",
            title=kind.replace("-", " ").capitalize(),
            status=status,
            detail=detail,
            field=field,
            remedy=remedy,
        )
        self.headers: dict[str, str] = {}
        if status == 401:
            self.headers["WWW-Authenticate"] = 'Bearer realm="pa-console"'
        if after_s:
            self.headers["Retry-After"] = str(after_s)

    def response(self) -> JSONResponse:
        """Return the response for the client."""
        return JSONResponse(
            self.details.model_dump(),
            status_code=self.details.status,
            media_type=MEDIA_TYPE,
            headers=self.headers,
        )


def internal_error() -> ProblemError:
    """Return the response for an internal defect, without its details."""
    return ProblemError(
        500,
        "internal-error",
        "the program has a defect; nothing was carried out by this request, as far as is known",
        remedy="look at /v1/state before you go on; STOP works as before",
    )
