"""Benchmarks: what `make bench` runs; every figure of the manual comes from one of them."""
