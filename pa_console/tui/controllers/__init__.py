"""The operator's actions, one controller a concern; the registry names their controllers."""
