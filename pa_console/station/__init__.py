"""The loop around missions: queue, clock, alarms, answers, and consoles that join."""
