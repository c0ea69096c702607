"""What the policy browser and the rule editor show of rules, and what they edit them with."""
