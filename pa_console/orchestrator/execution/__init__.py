"""Step 7: dispatch, follow, verify by telemetry; the last gate before the link."""
