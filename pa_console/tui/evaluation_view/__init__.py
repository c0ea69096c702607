"""What the evaluation screen shows: runs, filters, details and tables as rows."""
