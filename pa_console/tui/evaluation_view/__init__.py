"""The content of the evaluation screen: runs, filters, details and tables as rows."""
