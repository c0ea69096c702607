"""Execution: the premises of a running plan, dispatch and resends, assets under manual control."""
