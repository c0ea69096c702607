"""The picture that the station builds from the reports that arrive; never from the truth."""
