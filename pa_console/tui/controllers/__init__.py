"""What the operator can do, one controller a concern; the registry names who carries what out."""
