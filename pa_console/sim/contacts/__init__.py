"""The truth about vehicles and persons at the checkpoint."""
