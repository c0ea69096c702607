"""The models of this machine: each runs in a worker process, which the engine starts."""
