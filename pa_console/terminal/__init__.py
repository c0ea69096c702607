"""The terminal without a screen: lines for missions, approvals and consoles."""
