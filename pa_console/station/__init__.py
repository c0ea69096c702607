"""The station: its mission queue, clock, alarms and answers, and joined consoles."""
