"""The local LLM: catalogue, worker process, constrained decoding, planner and judge."""
