"""Mission sets, benchmarks and their tables, and the effects of changed rules."""
