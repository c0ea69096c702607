"""The public names of the Python API; `import pa_console as pa` gives them."""
