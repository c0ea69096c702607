"""The terminal without the full screen: lines for missions, approvals and consoles."""
