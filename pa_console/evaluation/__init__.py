"""Mission sets, benchmarks and their tables."""
