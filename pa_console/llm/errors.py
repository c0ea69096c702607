"""The errors of a model or its engine, worded for the person at the console."""


class ModelError(Exception):
    """A model that is unknown, missing, or not the file that the catalogue pins."""


class PullError(ModelError):
    """A model that could not be fetched; says what failed at each source and what to do."""


class EngineError(Exception):
    """A generation that did not happen; asking again with the same prompt may not help."""


class EngineDiedError(EngineError):
    """The worker process ended while it was needed; the next generation starts a new one."""


class ModelUnavailableError(EngineError):
    """The model cannot be loaded."""


class PromptRefusedError(EngineError):
    """The prompt does not fit in the model's context, or its grammar is not valid."""


class ServerError(EngineError):
    """A model's server gave no answer that can be used; `status` is that of HTTP, 0 without one."""

    def __init__(self, why: str, status: int = 0) -> None:
        super().__init__(why)
        self.status = status
