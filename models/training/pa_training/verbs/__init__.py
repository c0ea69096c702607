"""What the verbs of `python -m pa_training` do."""
