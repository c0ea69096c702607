"""Whether a plan is right: checked, rehearsed, carried out and strictly scored."""
