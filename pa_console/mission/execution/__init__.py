"""Execution: the premises of a running plan, dispatch and resends, and manual control."""
