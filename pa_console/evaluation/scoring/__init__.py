"""The strict scorer: what a run truly came to, judged without any code of the safeguards."""
