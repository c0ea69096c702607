"""Parts of a mission's run: questions about its order, and a plan that waits for a decision."""
