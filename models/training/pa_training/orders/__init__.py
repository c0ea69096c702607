"""Orders in the words of people, with their meanings in canonical words."""
