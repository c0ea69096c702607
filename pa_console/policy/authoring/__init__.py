"""Tools for writing rules: edit, save, compare, run examples, lint."""
