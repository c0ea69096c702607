"""Sessions that were recorded: what each was about, how it ended, whether its log is sound."""
