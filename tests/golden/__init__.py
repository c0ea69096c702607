"""Golden tests: what the code base does, recorded, and held still while its modules move."""
