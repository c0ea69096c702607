"""The content of the policy browser and the rule editor, and their tools."""
