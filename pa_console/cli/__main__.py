"""`python -m pa_console.cli` is `pa-console`."""

from pa_console.cli.main import main

main()
