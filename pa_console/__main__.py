"""`python -m pa_console` is the command `pa-console`."""

from pa_console.cli import main

if __name__ == "__main__":
    main()
