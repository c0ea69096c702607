"""What the benchmark asks of our decoder and of bare llama.cpp, and the speeds that come back."""

from collections.abc import Iterable

from pa_console.schema.base import StrictModel


class MeasureSpeed(StrictModel):
    """One prompt, read from an empty cache, and an answer.

    With `bare_tokens`, bare llama.cpp writes so many tokens instead of our decoder.
    """

    system: str
    user: str
    grammar: str
    max_tokens: int
    bare_tokens: int | None = None


class Speed(StrictModel):
    """Seconds of the prompt, and (tokens, seconds) of every evaluated step of the answer.

    A step of one token was chosen by the model. A step of several was one chosen token, if any,
    and those that the grammar forced after it; choosing them is part of the step's time.
    """

    batch: int
    """Prompt tokens evaluated at once."""
    prompt_tokens: int
    prompt_s: float
    steps: tuple[tuple[int, float], ...]
    written: int = 0
    chosen: int = 0

    @property
    def prompt_rate(self) -> float:
        """Prompt tokens a second."""
        return self.prompt_tokens / self.prompt_s if self.prompt_s > 0.0 else 0.0

    @property
    def rate(self) -> float:
        """Tokens a second over all steps, 0 without any."""
        return _rate(self.steps)

    @property
    def decoded_rate(self) -> float:
        """Tokens a second over the steps of one token."""
        return _rate(step for step in self.steps if step[0] == 1)

    @property
    def forced_rate(self) -> float:
        """Tokens a second over the steps of several."""
        return _rate(step for step in self.steps if step[0] > 1)


def _rate(steps: Iterable[tuple[int, float]]) -> float:
    tokens, seconds = 0, 0.0
    for step_tokens, step_s in steps:
        tokens += step_tokens
        seconds += step_s
    return tokens / seconds if seconds > 0.0 else 0.0
