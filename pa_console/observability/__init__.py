"""What others see of a session: its missions as traces, and its numbers as metrics."""
