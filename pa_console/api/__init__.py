"""The public names of the Python API, provided by `import pa_console as pa`."""
