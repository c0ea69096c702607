"""Models on another machine: servers that speak the OpenAI interface."""
