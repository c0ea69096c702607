"""Mission sets, benchmarks and their tables; what changed rules would change."""
