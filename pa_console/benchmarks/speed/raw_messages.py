"""What the benchmark asks of our decoder and of bare llama.cpp, and the speeds that come back."""

from pa_console.schema.base import StrictModel


class Written(StrictModel):
    """The tokens of an answer."""

    read: tuple[int, ...] = ()
    """Those at its beginning that the grammar forces: they are read together with the prompt."""
    tokens: tuple[int, ...] = ()
    """The rest."""


class MeasureSpeed(StrictModel):
    """One prompt, read from an empty cache, and an answer.

    With `bare`, bare llama.cpp writes these very tokens instead of our decoder.
    """

    system: str
    user: str
    grammar: str
    max_tokens: int
    bare: Written | None = None


class Speed(StrictModel):
    """Seconds of the prompt and of the answer, in which choosing the tokens is contained."""

    batch: int
    """Prompt tokens evaluated at once."""
    prompt_tokens: int
    prompt_s: float
    answer: Written
    answer_s: float
    """Seconds of `answer.tokens`."""
    evaluations: int
    """How often the model was evaluated for them."""
    chosen: int = 0
    """Tokens that the model chose; the others were forced by the grammar."""
    guessed: int = 0
    """Those of the chosen ones that had been guessed, and so cost no evaluation of their own."""
