"""Tells a pressed key from a typed text while no field takes it."""

TEXT_S = 0.5
"""Two different keys that print, a letter among them, this close together are text."""


class TypedText:
    """The keys that print, as long as each follows the one before closely.

    The same key again and again is no text, and neither are digits and signs without a letter.
    """

    def __init__(self) -> None:
        self.keys = ""
        """The keys typed without a pause."""
        self.is_text = False
        """True if they are a text, no key of which is a command; so is the Enter at its end."""
        self._last_s = 0.0

    def add(self, character: str, time_s: float) -> None:
        """Take note of a key that prints, pressed at `time_s` seconds."""
        goes_on = bool(self.keys) and time_s - self._last_s < TEXT_S
        self.keys = self.keys + character if goes_on else character
        self._last_s = time_s
        letters = any(key.isalpha() for key in self.keys)
        self.is_text = (goes_on and self.is_text) or (letters and len(set(self.keys)) > 1)

    def add_in_field(self, character: str, time_s: float) -> None:
        """Take note of a key that went into a field: what follows it outside is text as well."""
        self.add(character, time_s)
        self.is_text = True

    def goes_on(self, time_s: float) -> bool:
        """Return whether a key at `time_s` seconds follows the one before closely."""
        return bool(self.keys) and time_s - self._last_s < TEXT_S

    def forget(self) -> None:
        """Begin anew: a key that prints nothing came between, or the mouse."""
        self.keys, self.is_text = "", False
