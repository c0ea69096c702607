"""Models on another machine: servers with the OpenAI interface."""
