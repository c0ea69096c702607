"""The models of this machine: a worker process holds each, and the engine is its parent."""
