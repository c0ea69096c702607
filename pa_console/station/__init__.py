"""The loop around missions: queue, clock, alarms, answers, and joined consoles."""
