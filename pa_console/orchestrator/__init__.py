"""The eight steps from mission to report, as a stream of typed events."""
