"""What the run of a mission uses: questions about its order, and a plan that waits."""
