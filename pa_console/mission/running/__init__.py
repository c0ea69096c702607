"""Parts of a mission's run: questions about its order, and the plan that awaits a decision."""
