"""From runs to tables, figures and the report of an evaluation."""
