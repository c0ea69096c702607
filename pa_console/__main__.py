"""The command `pa-console` as `python -m pa_console`."""

from pa_console.cli import main

if __name__ == "__main__":
    main()
