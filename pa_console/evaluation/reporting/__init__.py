"""The report of an evaluation: statistics, tables, figures, and the pages that hold them."""
