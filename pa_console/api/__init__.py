"""What a program does with PA Console; `import pa_console as pa` gives the names."""
