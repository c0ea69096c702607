"""Orders of a form of their own: standing, timed, in steps, patrols, and what changes them."""
