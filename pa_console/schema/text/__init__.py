"""Text for people: numbers in words, and characters that would hide or move other text."""
