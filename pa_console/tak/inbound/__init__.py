"""What a TAK server sends: read with care, bounded, told as reports that nobody has verified."""
