"""Turns a system and a user message into tokens, in the format the model was trained on.

Only the worker process imports this.
"""

import re

from llama_cpp.llama_chat_format import Jinja2ChatFormatter

from pa_console.llm.models.catalogue import ChatFormat
from pa_console.llm.worker.runtime import Runtime

FORMATS: dict[ChatFormat, str] = {
    "chatml": (
        "{% for message in messages %}<|im_start|>{{ message.role }}\n"
        "{{ message.content }}<|im_end|>\n{% endfor %}{{ '<|im_start|>assistant\n' }}"
    ),
    "plain": "{% for message in messages %}{{ message.content }}\n\n{% endfor %}{{ 'Answer:\n' }}",
}
"""Named formats; a model of format `template` brings its own in the GGUF metadata."""

SYSTEM, USER = "\ue000", "\ue001"
"""The placeholders of messages while the template is rendered, so that a message is never read as
part of the template: no text can forge a control token or another role's turn."""


class ChatPrompt:
    """The chat format of one model."""

    def __init__(self, runtime: Runtime, chat: ChatFormat) -> None:
        self._runtime = runtime
        template = runtime.metadata("tokenizer.chat_template") if chat == "template" else None
        if template is None:
            template = FORMATS["plain" if chat == "template" else chat]
        formatter = Jinja2ChatFormatter(
            template,
            eos_token=runtime.token_text(runtime.end_token),
            bos_token=runtime.token_text(runtime.start_token),
        )
        try:
            self._frame = formatter(
                messages=[
                    {"role": "system", "content": SYSTEM},
                    {"role": "user", "content": USER},
                ]
            ).prompt
        except Exception:  # a template raises what it likes when it has no system role
            both = f"{SYSTEM}\n\n{USER}"
            self._frame = formatter(messages=[{"role": "user", "content": both}]).prompt

    def tokens(self, system: str, user: str) -> list[int]:
        """Return the whole prompt as tokens, up to where the model answers."""
        texts = {SYSTEM: system, USER: user}
        tokens: list[int] = []
        for part in re.split(f"([{SYSTEM}{USER}])", self._frame):
            if part in texts:
                tokens += self._runtime.tokenise(texts[part], special=False)
            elif part:
                tokens += self._runtime.tokenise(part, special=True)
        start = self._runtime.start_token
        if self._runtime.wants_start_token and tokens[:1] != [start]:
            tokens.insert(0, start)
        return tokens

    def closing(self) -> list[int]:
        """Return what stands between the end of the user's message and the model's answer."""
        return self._runtime.tokenise(self._frame.rpartition(USER)[2], special=True)
