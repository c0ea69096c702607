"""Random and hostile plans against the safeguards, with an oracle of its own."""
