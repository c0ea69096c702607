"""The console, driven by a scripted station and looked at through a pilot."""
