"""VDA 5050, version 3: the messages between a fleet control and its robots, as typed values."""
