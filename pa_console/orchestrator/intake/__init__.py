"""Step 1: alarms become missions, missions wait in their order (WF-04, WF-05)."""
