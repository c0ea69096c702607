"""Tests of the trainer itself need the extra `train`; without it they are not collected."""

from importlib.util import find_spec

collect_ignore = [] if find_spec("torch") and find_spec("gguf") else ["lora"]
