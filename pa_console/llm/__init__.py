"""The models: catalogue, local worker process, constrained decoding, servers, planner and judge."""
