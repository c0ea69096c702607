"""Attacks and faults that were once found to succeed; each must fail for ever."""
