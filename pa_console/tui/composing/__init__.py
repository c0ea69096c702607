"""Helps to write an order: names that complete, slots, orders that are given often."""
