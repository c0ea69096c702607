"""Standing orders, timed orders, orders in steps, patrols, and changes to such orders."""
